"""A run under way is given up for a skill only when somebody agrees."""

from __future__ import annotations

import argparse
import io
import sys

import pytest

from services.wire.definition_file import definition_sha256, load, run_id
from services.wire.errors import CellError
from services.wire.messages import Experiment
from treenail.commands.checkpoint import _agreed


class Keyboard(io.StringIO):
    """Somebody at a terminal."""

    def isatty(self) -> bool:
        return True


def running(phase: str = "running") -> Experiment:
    definition = load("chamfered-q-softmax")
    return Experiment(
        run=run_id(definition, 0),
        seed=0,
        definition=definition,
        definition_sha256=definition_sha256(definition),
        skill_sha256="ab" * 32,
        first_policy_version=0,
        episodes=2000,
        episodes_done=80,
        decisions=900,
        phase=phase,
    )


def asked(yes: bool = False) -> argparse.Namespace:
    return argparse.Namespace(yes=yes)


def test_without_a_terminal_it_takes_yes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("y\n"))
    with pytest.raises(CellError, match="under way, 80 of 2000 episodes done: expected --yes"):
        _agreed(running(), None, asked())
    assert _agreed(running(), None, asked(yes=True)) == running().run


@pytest.mark.parametrize(("answer", "agreed"), [("y", True), ("YES", True), ("n", False), ("", False), ("x", False)])
def test_in_a_terminal_it_is_asked(monkeypatch: pytest.MonkeyPatch, answer: str, agreed: bool) -> None:
    monkeypatch.setattr(sys, "stdin", Keyboard(f"{answer}\n"))
    if agreed:
        assert _agreed(running(), None, asked()) == running().run
    else:
        with pytest.raises(CellError, match="it goes on, nothing was changed"):
            _agreed(running(), None, asked())


def test_nothing_is_asked_where_nothing_is_given_up() -> None:
    assert _agreed(None, None, asked()) is None
    assert _agreed(running("finished"), None, asked()) is None
