"""Moves within bounds at the task: made as they are, written down, counted as what they are, refused beyond."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from msgspec.structs import replace

from services.task.insertion import Insertion
from services.wire.actions import INSERT, Increment
from services.wire.definition import Continuous, Definition
from services.wire.errors import TreenailError
from services.wire.messages import Action, Motion, Move, Moved, Observation, Reward

RUN = "test-s0"
MOST = Continuous(x_mm=0.25, y_mm=0.25, z_mm=0.25, rx_deg=0.5)


@pytest.fixture
def settings(exact: Callable[..., Definition]) -> Definition:
    plain = exact(no_progress_moves=2)
    return replace(plain, moves=replace(plain.moves, continuous=MOST))


class At:
    """A task in contact after its first motion."""

    def __init__(self, settings: Definition) -> None:
        self.task = Insertion(settings, RUN, 0)
        self.task.home(0, 0)
        then = self.task.feel(Moved(run=RUN, episode=0, step=0, arrived_t_ns=0), (0.0, 0.0, -1.0), (0.0, 0.0, 0.0)).then
        assert isinstance(then, Observation)
        self.observation, self.reward = then, None

    def told(self, increment: Motion | None, action: int) -> Action:
        asked = self.observation
        place: dict[str, Any] = {"run": RUN, "episode": 0, "step": asked.step, "decision": asked.decision}
        return Action(**place, state=0, action=action, policy_version=0, increment=increment)

    def go(self, increment: Increment, action: int) -> tuple[Move, Reward | None]:
        """Decide, make the move, and feel 1 N."""
        move = self.task.act(self.told(increment, action))
        moved = Moved(run=RUN, episode=0, step=move.step, arrived_t_ns=0, dz_mm=move.dz_mm)
        felt = self.task.feel(moved, (0.0, 0.0, -1.0), (0.0, 0.0, 0.0))
        if isinstance(felt.then, Observation):
            self.observation = felt.then
        return move, felt.reward


def test_a_move_is_made_and_written_down_as_it_is(settings: Definition) -> None:
    at, increment = At(settings), Increment(0.0123, -0.2, 0.05, 0.25)
    move, reward = at.go(increment, 0)
    assert move == Move(run=RUN, episode=0, step=1, dx_mm=0.0123, dy_mm=-0.2, dz_mm=0.05, rx_deg=0.25)
    assert reward is not None and reward.reward == -1.0, "less than half a step is none of insertion"
    step = at.task.record().steps[0]
    assert (step.action, step.increment) == (0, increment)


def test_from_half_a_step_on_it_counts_as_insertion(settings: Definition) -> None:
    move, reward = At(settings).go(Increment(dx_mm=0.1, dz_mm=0.125), INSERT)
    assert move.dz_mm == 0.125 and reward is not None and reward.reward == 0.0


def test_creeping_deeper_is_no_progress(settings: Definition) -> None:
    at = At(settings)
    creep = Increment(dz_mm=0.0001)
    assert [at.go(creep, 0)[1] for _ in range(2)][-1] is not None
    _, reward = at.go(creep, 0)
    assert reward is not None and (reward.reward, reward.terminal) == (-50.0, "no_progress")


def test_a_listed_move_may_be_decided_for_as_well(settings: Definition) -> None:
    at = At(settings)
    assert at.task.act(at.told(None, 1)).dx_mm == -0.25
    assert at.task.record().steps[0].increment is None


@pytest.mark.parametrize(
    ("increment", "action", "words"),
    [
        ((0.26, 0.0, 0.0, 0.0, 0.0, 0.0), 0, "increment: dx_mm: expected -0.25 to 0.25, as moves.continuous says, got"),
        ((0.0, 0.0, 0.0, 0.0, 0.1, 0.0), 0, "increment: ry_deg: expected -0 to 0"),
        ((0.0, 0.0, 0.25, 0.0, 0.0, 0.0), 0, f"action: expected {INSERT}, as which such a move counts, got 0"),
        ((0.0, 0.0, 0.0, 0.0, 0.0, 0.0), INSERT, f"action: expected 0, as which such a move counts, got {INSERT}"),
        (None, 9, "action: expected one below 9, got 9"),
    ],
)
def test_what_is_no_such_move_is_refused(settings: Definition, increment: Motion, action: int, words: str) -> None:
    at = At(settings)
    with pytest.raises(TreenailError) as error:
        at.task.act(at.told(increment, action))
    assert words in str(error.value)
    assert at.task.record().steps[0].action is None, "nothing is decided"
    at.go(Increment(), 0)


def test_without_bounds_no_increment_is_taken(exact: Callable[..., Definition]) -> None:
    at = At(exact())
    with pytest.raises(TreenailError, match=r"expected the number of a move, as moves\.continuous has no bounds"):
        at.task.act(at.told(Increment(), 0))
