"""A run whose learner proposes moves: one truth in process, in replay, in folds fed by the journal, and with swaps."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from experiments.evaluate.frozen import FrozenSkill
from experiments.export.steps import Stepper
from experiments.journal.diff import Comparison
from experiments.journal.replay import Replay
from experiments.lab.in_process import InProcessRun
from services.agent.fold import AgentFold
from services.ros2.tip import Tip
from services.rules.bounds import Bounds
from services.rules.entries import observation_in
from services.rules.plugins import PluginError
from services.rules.results import Digests, episodes_digest
from services.rules.skill import SkillError, fits, named, parse
from services.rules.skill import file_bytes as skill_bytes
from services.rules.swaps import planned
from services.wire.actions import Increment
from services.wire.definition import Definition
from services.wire.definition_file import load, run_id
from services.wire.errors import DivergedError
from services.wire.messages import Action, EpisodeSummary, Experiment, JournalEpisode, Motion

SRV = ("classifier.kind=none", "learner.kind=plugin", "learner.name=srv", "policy.kind=greedy")
BOUNDS = ("moves.continuous={x_mm=0.2, y_mm=0.2, z_mm=0.2, rx_deg=0.2, ry_deg=0.2}",)
SHORT = ("limits.move_limit=60",)
EPISODES, SEED = 4, 3


def definition(*overrides: str) -> Definition:
    return load("suite-round", (*SHORT, *BOUNDS, *SRV, *overrides))


class Recorded:
    """A run, its journal, and the digests before it and after each episode."""

    def __init__(self) -> None:
        self.run = InProcessRun(definition(), SEED)
        self.record = self.run.record
        self.journal: list[JournalEpisode] = []
        self.summaries: list[EpisodeSummary] = []
        self.digests = [self._digests()]
        for summary in self.run.episodes(EPISODES):
            self.summaries.append(summary)
            self.journal.append(self.run.task.record())
            self.digests.append(self._digests())

    def _digests(self) -> Digests:
        agent, network = self.run.agent.learner, self.run.classifier.network
        return {"q_table": agent.digest(), "art2": network.digest(), "episodes": episodes_digest(self.summaries)}


@pytest.fixture(scope="module")
def recorded() -> Recorded:
    return Recorded()


def replayed(recorded: Recorded, journal: list[JournalEpisode] | None = None) -> Replay:
    replay = Replay(recorded.record, None)
    for entry in recorded.journal if journal is None else journal:
        replay.fold(entry)
    return replay


def test_moves_are_within_bounds_and_learnt_from(recorded: Recorded) -> None:
    bounds = Bounds(recorded.record.definition)
    steps = [step for entry in recorded.journal for step in entry.steps]
    assert len(steps) > 50
    assert len({step.increment for step in steps}) > 0.9 * len(steps)
    for step in steps:
        assert step.increment is not None
        increment = Increment(*step.increment)
        assert bounds.complaint(increment) is None and step.action == bounds.counts_as(increment)
    assert len({digests["q_table"] for digests in recorded.digests}) == EPISODES + 1


def test_a_replay_from_the_journal_alone_is_the_run(recorded: Recorded) -> None:
    replay = replayed(recorded)
    assert replay.first_mismatch is None
    assert replay.digests() == recorded.digests[-1]
    (row,) = replay.states()
    assert (row.best_action, row.q) == ("", ()) and row.felt == replay.decisions


@pytest.mark.parametrize("change", [(0.0,) * 6, None])
def test_another_move_in_the_journal_is_a_mismatch(recorded: Recorded, change: Motion | None) -> None:
    entry = recorded.journal[1]
    step = replace(entry.steps[4], increment=change, action=entry.steps[4].action)
    journal = [recorded.journal[0], replace(entry, steps=(*entry.steps[:4], step, *entry.steps[5:]))]
    replay = replayed(recorded, journal)
    assert replay.mismatches["increment"] == 1
    agent = AgentFold(recorded.record.definition, recorded.record.run, SEED)
    agent.replay(journal[0])
    with pytest.raises(DivergedError, match="journal has the move"):
        agent.replay(journal[1])


def test_a_worker_killed_at_any_decision_catches_up_from_the_journal(recorded: Recorded) -> None:
    first, second = recorded.journal[:2]
    done = AgentFold(recorded.record.definition, recorded.record.run, SEED)
    done.replay(first)
    snapshot = done.snapshot()
    done.replay(second)
    for cut in (1, len(second.steps) // 2, len(second.steps) - 1):
        agent = AgentFold(recorded.record.definition, recorded.record.run, SEED)
        agent.restore(snapshot)
        agent.replay(replace(second, steps=second.steps[:cut], summary=None))
        agent.replay(second)
        assert (agent.learner.digest(), agent.version) == (done.learner.digest(), done.version)


def test_the_commanded_tip_follows_such_moves(recorded: Recorded) -> None:
    record, entry = recorded.record, recorded.journal[0]
    experiment = Experiment(
        run=record.run,
        seed=SEED,
        definition=record.definition,
        definition_sha256=record.definition_sha256,
        skill_sha256=None,
        first_policy_version=0,
        episodes=EPISODES,
        episodes_done=0,
        decisions=0,
        phase="running",
    )
    tip = Tip(experiment)
    (told,) = Stepper(record.definition, record.run, SEED).episodes([entry])
    for index, step in enumerate(entry.steps):
        asked = observation_in(entry, index)
        assert step.action is not None and step.policy_version is not None
        place = {name: getattr(asked, name) for name in ("run", "episode", "step", "decision")}
        pose = tip.decided(
            Action(**place, state=0, action=step.action, policy_version=step.policy_version, increment=step.increment)
        )
        row = told.rows[step.step]
        assert row.increment == step.increment
        after = row.flange.moved(row.increment, 0.0)
        assert pose is not None and pose.position_mm == pytest.approx(after[:3], abs=1e-9)


def test_two_runs_part_at_the_first_move_that_differs(recorded: Recorded) -> None:
    entry = recorded.journal[0]
    step = replace(entry.steps[2], increment=(0.0,) * 6)
    comparison = Comparison(recorded.record, recorded.record)
    comparison.add(entry, replace(entry, steps=(*entry.steps[:2], step, *entry.steps[3:])))
    assert comparison.parting is not None and comparison.parting.field == "increment"


def test_a_skill_of_it_travels_fits_the_same_bounds_only_and_is_applied_without_trying(recorded: Recorded) -> None:
    skill = recorded.run.learnt()
    assert parse(skill_bytes(skill)) == skill == named(skill.skill)
    settings = recorded.record.definition
    fits(skill.skill, settings)
    with pytest.raises(SkillError, match=r"moves\.continuous"):
        fits(skill.skill, definition("moves.continuous.x_mm=0.1"))
    with pytest.raises(SkillError, match="expected classifier"):
        fits(skill.skill, definition("classifier.kind=art2"))
    frozen, felt = FrozenSkill(skill, settings, SEED), observation_in(recorded.journal[0], 3)
    choice = frozen.decide(felt)
    assert choice == frozen.decide(felt) and choice.increment is not None
    assert choice.action == Bounds(settings).counts_as(choice.increment)


def test_a_run_changes_to_moves_and_back_beginning_afresh() -> None:
    begun = load("suite-round", (*SHORT, *BOUNDS, "policy.kind=greedy"))
    words = ("1:agent:learner=srv,alpha=0.02", "3:agent:learner=felt")
    swaps = planned(run_id(begun, SEED), begun, words, EPISODES)
    assert [swap.fresh for swap in swaps] == [("agent",), ("agent",)]
    run, journal = InProcessRun(begun, SEED, swaps=swaps), []
    for _ in run.episodes(EPISODES):
        journal.append(run.task.record())
    proposed = [{step.increment is not None for step in entry.steps} for entry in journal]
    assert proposed == [{False}, {True}, {True}, {False}]
    replay = Replay(run.record, None, swaps)
    for entry in journal:
        replay.fold(entry)
    assert replay.first_mismatch is None and replay.digests()["q_table"] == run.agent.learner.digest()
    with pytest.raises(PluginError, match=r"expected some in moves\.continuous"):
        planned("x-s1", load("suite-round"), ("1:agent:learner=srv,policy=greedy",), EPISODES)
