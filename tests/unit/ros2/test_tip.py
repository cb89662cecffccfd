"""The commanded tip, followed from what is heard, against what the journal says afterwards."""

from __future__ import annotations

import numpy as np
import pytest
from msgspec.structs import replace

from experiments.export.steps import Row, Stepper
from experiments.lab.in_process import InProcessRun
from services.ros2.tip import Tip
from services.rules.poses import Pose, from_quaternion
from services.wire.definition_file import definition_sha256, load
from services.wire.messages import Action, Experiment, JournalEpisode

SEED, EPISODES = 3, 4


@pytest.fixture(scope="module")
def heard() -> tuple[Experiment, list[tuple[Action, Row]]]:
    """A run's decisions as its actions tell of them, each with the motion that follows in the journal."""
    definition = load(
        "initial",
        ["start.height_mm=0.4", "limits.move_limit=40", "limits.success_fraction=0.2", "moves.rotation_centre_mm=30"],
    )
    run = InProcessRun(definition, SEED, remember=True)
    journal: list[JournalEpisode] = [run.task.record() for _ in run.episodes(EPISODES)]
    rows = [row for episode in Stepper(definition, run.run, SEED).episodes(journal) for row in episode.rows]
    experiment = Experiment(
        run=run.run,
        seed=SEED,
        definition=definition,
        definition_sha256=definition_sha256(definition),
        skill_sha256=None,
        first_policy_version=0,
        episodes=EPISODES,
        episodes_done=0,
        decisions=0,
        phase="running",
    )
    return experiment, [(action_of(row, run.run), row) for row in rows if row.decision is not None]


def action_of(row: Row, run: str) -> Action:
    assert row.decision is not None and row.state is not None and row.action is not None
    return Action(
        run=run,
        episode=row.episode,
        step=row.motion - 1,
        decision=row.decision,
        state=row.state,
        action=row.action,
        policy_version=0,
    )


def same(tip: Pose | None, row: Row) -> bool:
    """Whether the tip is where a row's motion leads to."""
    after = row.flange.moved(row.increment, 30.0)
    return (
        tip is not None
        and np.allclose(tip.position_mm, after.position, atol=1e-9)
        and np.allclose(tip.turn, from_quaternion(after.orientation), atol=1e-9)
    )


def test_each_decision_leads_where_the_journal_says(heard: tuple[Experiment, list[tuple[Action, Row]]]) -> None:
    experiment, actions = heard
    tip = Tip(experiment)
    assert len(actions) > 20 and len({action.episode for action, _ in actions}) > 1
    for action, row in actions:
        assert same(tip.decided(action), row)


def test_who_missed_a_decision_says_nothing_until_the_next_episode(
    heard: tuple[Experiment, list[tuple[Action, Row]]],
) -> None:
    experiment, actions = heard
    tip = Tip(experiment)
    missed = next(place for place, (action, _) in enumerate(actions) if place > 2 and action.episode == 0)
    for place, (action, row) in enumerate(actions):
        if place == missed:
            continue
        said = tip.decided(action)
        if place > missed and action.episode == actions[missed][0].episode:
            assert said is None
        else:
            assert same(said, row)


def test_who_comes_late_waits_for_the_next_episode(heard: tuple[Experiment, list[tuple[Action, Row]]]) -> None:
    experiment, actions = heard
    tip = Tip(experiment)
    first = actions[3][0].episode
    for action, row in actions[3:]:
        said = tip.decided(action)
        assert said is None if action.episode == first else same(said, row)


def test_an_episode_that_begins_again_is_followed_from_its_start(
    heard: tuple[Experiment, list[tuple[Action, Row]]],
) -> None:
    experiment, actions = heard
    tip = Tip(experiment)
    for action, _ in actions[:3]:
        tip.decided(action)
    for action, row in actions[:3]:
        assert same(tip.decided(action), row)
    assert tip.decided(replace(actions[3][0], step=0)) is None, "a step that cannot be"
