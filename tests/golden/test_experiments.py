"""What each shipped experiment learns in 20 episodes of seed 0, to the byte: a change of behaviour is seen here."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from experiments.lab.run import run_seed
from services.wire.definition_file import load, shipped

FILE = Path(__file__).parent / "experiments.json"
DIGESTS = json.loads(FILE.read_text())
EPISODES = 20


def kept() -> set[str]:
    """Return whose digests are kept: those of the thesis. The suite's tasks may learn otherwise tomorrow."""
    return {name for name in shipped() if not name.startswith("suite-")}


def test_every_experiment_of_the_thesis_has_digests() -> None:
    assert set(DIGESTS) == kept()


@pytest.mark.parametrize("name", sorted(DIGESTS))
def test_an_experiment_ends_in_the_same_bytes(name: str) -> None:
    assert digests(name) == DIGESTS[name]


def digests(name: str) -> object:
    return run_seed(load(name), 0, EPISODES, lambda _: None).result.digests


if __name__ == "__main__":  # writes down what new experiments learn; what is written stays
    new = {name: digests(name) for name in kept() - set(DIGESTS)}
    FILE.write_text(json.dumps(dict(sorted({**DIGESTS, **new}.items())), indent=1))
