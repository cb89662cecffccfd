"""What each shipped experiment learns in 20 episodes of seed 0, to the byte: a change of behaviour is seen here."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from experiments.lab.run import run_seed
from services.wire.definition_file import load, shipped

DIGESTS = json.loads((Path(__file__).parent / "experiments.json").read_text())
EPISODES = 20


def test_every_experiment_of_the_thesis_has_digests() -> None:
    assert set(DIGESTS) == {name for name in shipped() if not name.startswith("suite-")}


@pytest.mark.parametrize("name", sorted(DIGESTS))
def test_an_experiment_ends_in_the_same_bytes(name: str) -> None:
    assert run_seed(load(name), 0, EPISODES, lambda _: None).result.digests == DIGESTS[name]
