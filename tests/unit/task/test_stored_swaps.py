"""What the store has of a run's swaps is taken over only if requests can have made it."""

from __future__ import annotations

from typing import Any, cast

import pytest
from msgspec.structs import replace

from services.bus.service import Service
from services.rules.swaps import planned
from services.task.swaps import Swaps
from services.wire.definition import Art2Settings, Sarsa
from services.wire.definition_file import definition_sha256, load, run_id
from services.wire.errors import CellError
from services.wire.messages import RunRecord, Swap

DEFINITION = load("chamfered-q-softmax")
RECORD = RunRecord(
    run=run_id(DEFINITION, 1),
    seed=1,
    definition=DEFINITION,
    definition_sha256=definition_sha256(DEFINITION),
    skill_sha256=None,
    contract_sha256="0f" * 32,
)
GOOD = planned(RECORD.run, DEFINITION, ["3:agent:learner=sarsa", "5:classifier:rho=0.95"], 10)


def swaps() -> Swaps:
    return Swaps(cast(Service, None), RECORD)  # taking over asks nobody


def test_what_requests_have_made_is_taken_over() -> None:
    made = swaps()
    made.resume(GOOD)
    assert made.confirmed == GOOD


@pytest.mark.parametrize(
    ("stored", "complaint"),
    [
        (GOOD[::-1], "expected episode 5 or later"),
        ((GOOD[0], replace(GOOD[1], fresh=())), r"swap 2: expected .*fresh=\('classifier', 'agent'\)"),
        ((GOOD[0], GOOD[0]), "swap 2 cannot be: swap: expected something that changes"),
        (
            (Swap(request="0" * 32, episode=3, classifier=Art2Settings(theta=0.9), fresh=("classifier", "agent")),),
            "swap 1 cannot be: swap: classifier.theta: expected less than",
        ),
        ((Swap(request="0" * 32, episode=3, learner=Sarsa(), classifier=Art2Settings()),), "got both"),
    ],
)
def test_what_no_request_can_have_made_is_refused(stored: Any, complaint: str) -> None:
    made = swaps()
    with pytest.raises(CellError, match=complaint):
        made.resume(stored)
    assert made.confirmed == ()
