"""Methods of chapter 2 that nobody teaches fit the tasks of the suite that they are tried on."""

from __future__ import annotations

import pytest

from experiments.leaderboard.methods import METHODS, RIVALS, changed, methods
from services.agent.fold import learner_of
from services.rules.plugins import proposes
from services.wire.definition_file import load


def test_they_are_on_a_board_only_where_they_are_named() -> None:
    assert methods(None) == METHODS
    assert {"srv", "rcc", "rule"} <= {method.name for method in methods(["srv", "rcc"])}


@pytest.mark.parametrize("task", ["suite-round", "suite-square"])
def test_they_fit_the_task(task: str) -> None:
    srv, rcc = (changed(load(task), method) for method in RIVALS if method.name in ("srv", "rcc"))
    assert proposes(learner_of(srv, 0))
    assert rcc.wrist.sensor_height_mm == 0.0 and rcc.wrist.stiffness_n_per_mm == 7.0
