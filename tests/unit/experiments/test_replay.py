"""A run rebuilt from its journal alone is the run, and whatever was changed in the journal is found, at its place."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from experiments.journal import replay_command
from experiments.journal.checks import reward_trouble, summary_troubles
from experiments.journal.replay import Mismatch, Replay
from experiments.journal.witnesses import Compared, Witnesses
from services.cell.stored import StoredCheckpoint
from services.rules.results import RunResult, summary
from services.rules.swaps import planned
from services.wire.actions import INSERT
from services.wire.codec import contract_sha256
from services.wire.definition import Definition, InsertionReward
from services.wire.definition_file import load
from services.wire.errors import BadPayloadError, DivergedError, GapError
from services.wire.keys import Keys
from services.wire.messages import Checkpoint, EpisodeSummary, JournalEpisode, JournalStep, QTable

SHIPPED = ("chamfered-q-softmax", "chamfered-sarsa-softmax", "paper2-random-start", "chamferless-q-egreedy")
"""Both learners, both reward functions, three policies, with and without a random start."""
SHORT = ("limits.move_limit=120",)
EPISODES, SEED = 5, 3


def definition(name: str = SHIPPED[0]) -> Definition:
    return load(name, SHORT)


@pytest.fixture
def first(record_run: Callable[..., Any]) -> Any:
    """A run that began with nothing learnt."""
    return record_run(definition(), SEED, EPISODES)


def replayed(recorded: Any, journal: list[JournalEpisode] | None = None, **wanted: Any) -> Replay:
    replay = Replay(recorded.record, recorded.began_with, **wanted)
    for entry in recorded.journal if journal is None else journal:
        replay.fold(entry)
    return replay


def changed(journal: list[JournalEpisode], episode: int, index: int | None, **fields: Any) -> list[JournalEpisode]:
    """Return a journal with some fields of one step, or of the summary, changed."""
    entry = journal[episode]
    if index is None:
        assert entry.summary is not None
        entry = replace(entry, summary=replace(entry.summary, **fields))
    else:
        step = replace(entry.steps[index], **fields)
        entry = replace(entry, steps=(*entry.steps[:index], step, *entry.steps[index + 1 :]))
    return [*journal[:episode], entry, *journal[episode + 1 :]]


# -- what is as it was ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SHIPPED)
def test_rebuilt_run_is_the_run_after_every_episode(record_run: Callable[..., Any], name: str) -> None:
    recorded = record_run(definition(name), SEED, EPISODES)
    assert len({digests["q_table"] for digests in recorded.digests}) > 3, "a run that learns nothing proves nothing"
    replay = Replay(recorded.record, at_episodes=range(EPISODES + 1))
    for entry, digests in zip(recorded.journal, recorded.digests[1:], strict=True):
        replay.fold(entry)
        assert replay.digests() == digests
    assert replay.first_mismatch is None
    found = [replay.moments[episode] for episode in range(EPISODES + 1)]
    assert [moment.q_table for moment in found] == [digests["q_table"] for digests in recorded.digests]
    assert [moment.art2 for moment in found] == [digests["art2"] for digests in recorded.digests]


def test_rebuilt_run_began_with_its_skill_and_with_no_other(record_run: Callable[..., Any], first: Any) -> None:
    skill = first.run.learnt()
    second = record_run(definition(), SEED + 1, EPISODES, skill)
    replay = replayed(second)
    assert replay.digests() == second.digests[-1]
    assert replay.first_mismatch is None
    assert replay.agent.learner.version == skill.version + replay.decisions
    with pytest.raises(DivergedError, match=rf"skill: expected {skill.sha256}, got None"):
        Replay(second.record)
    with pytest.raises(DivergedError, match="skill: expected None"):
        Replay(first.record, skill)


def test_memory_of_each_state_is_that_of_the_workers(first: Any) -> None:
    rows = replayed(first).states()
    learner, network = first.run.agent.learner, first.run.classifier.network
    assert [row.state for row in rows] == list(range(network.states))
    assert [row.felt for row in rows] == network.counts.tolist()
    assert [list(row.prototype) for row in rows] == network.prototypes.tolist()
    assert [list(row.q) for row in rows][: learner.states] == learner.q.tolist()
    assert sum(row.visits for row in rows) == learner.version
    for row in rows:
        assert row.value == max(row.q)
        assert row.visits == sum(row.visits_by_action)


# -- what is not ------------------------------------------------------------------------------------------------------


def a_step(journal: list[JournalEpisode], holds: Callable[[JournalStep], bool]) -> tuple[int, int]:
    """Return episode and index of a step in the midst of the journal that is not an episode's first or last."""
    for entry in journal[2:]:
        for index, step in enumerate(entry.steps[1:-1], start=1):
            if holds(step):
                return entry.episode, index
    raise AssertionError("no such step in the journal")


CHANGES: dict[str, Callable[[JournalStep], dict[str, Any]]] = {
    "state": lambda step: {"state": (step.state or 0) + 1},
    "action": lambda step: {"action": INSERT if step.action != INSERT else 0},
    "policy_version": lambda step: {"policy_version": (step.policy_version or 0) - 1},
    "reward": lambda step: {"reward": (step.reward or 0.0) - 1e-9},
    "step": lambda step: {"step": 0},
    "force_n": lambda step: {"force_n": (0.0, 0.0, 0.01)},
}


@pytest.mark.parametrize("field", CHANGES)
def test_changed_step_is_found_at_its_place(first: Any, field: str) -> None:
    episode, index = a_step(first.journal, lambda step: step.action != INSERT)
    step = first.journal[episode].steps[index]
    replay = replayed(first, changed(first.journal, episode, index, **CHANGES[field](step)))
    found = replay.first_mismatch
    assert found is not None
    now = CHANGES[field](step).get("step", step.step)
    decision = first.journal[episode].first_decision + index
    assert (found.episode, found.step, found.decision, found.field) == (episode, now, decision, field)
    assert str(found).startswith(f"episode {episode}, step {now}, decision {decision}: {field}: expected ")
    assert replay.mismatches[field] >= 1


def test_changed_reward_spoils_the_q_table_alone(first: Any) -> None:
    episode, index = a_step(first.journal, lambda step: True)
    journal = changed(first.journal, episode, index, reward=-7.5)
    replay = replayed(first, journal, at_episodes=(episode, EPISODES))
    assert replay.first_mismatch is not None
    assert replay.first_mismatch.got == "-7.5"
    before, after = first.digests[episode], first.digests[-1]
    assert replay.moments[episode].q_table == before["q_table"]
    found = replay.digests()
    assert found["q_table"] != after["q_table"]
    assert (found["art2"], found["episodes"]) == (after["art2"], after["episodes"])


@pytest.mark.parametrize("name", ["chamfered-q-softmax", "paper2-random-start"])
def test_reward_that_the_definition_does_not_give_is_found_at_each_step(
    record_run: Callable[..., Any], name: str
) -> None:
    """By the force before and after where the reward asks for it, unless the episode ended with that very move."""
    recorded = record_run(definition(name), SEED, EPISODES)
    reward = recorded.record.definition.reward
    values = (-1.0, 0.0) if name == "chamfered-q-softmax" else (reward.fell, reward.rose, reward.otherwise)
    asked = 0
    for entry in recorded.journal:
        for index, step in enumerate(entry.steps[:-1]):
            touches = entry.steps[index + 1].step == step.step + 1
            for value in values:
                steps = changed([entry], 0, index, reward=value)[0].steps
                found = reward_trouble(recorded.record.definition, steps, index, entry.summary)
                if value == step.reward:
                    assert found is None
                elif touches or name == "chamfered-q-softmax" or value == reward.rose:
                    assert found is not None and found.got == repr(value)
                    asked += 1
    assert asked > 100


def test_a_price_of_force_is_held_against_the_force_after_the_move_as_far_as_the_journal_tells_it(
    record_run: Callable[..., Any],
) -> None:
    settings = load("suite-round", (*SHORT, "shaping.price_per_n=0.0"))
    contact_n = settings.limits.contact_force_n
    assert isinstance(settings.reward, InsertionReward)
    price = settings.reward.force_per_n
    assert price > 0.0
    seen = set()
    for entry in record_run(settings, SEED, 30).journal:
        for index in range(len(entry.steps)):
            assert reward_trouble(settings, entry.steps, index, entry.summary) is None
        for index, step in enumerate(entry.steps[:-1]):
            at_once = entry.steps[index + 1].step == step.step + 1
            seen.add(at_once)
            most = 0.0 if step.action == INSERT else -1.0
            least = most - price * contact_n
            for value, fits in ((most + 0.01, False), (least - 0.01, at_once and step.reward == least - 0.01)):
                steps = changed([entry], 0, index, reward=value)[0].steps
                assert (reward_trouble(settings, steps, index, entry.summary) is None) == fits
            no_reward = changed([entry], 0, index, reward=None)[0].steps
            assert reward_trouble(settings, no_reward, index, entry.summary) is not None
    assert seen == {True, False}


@pytest.mark.parametrize(
    ("numbers", "inserted", "moves", "possible"),
    [
        (range(4, 25), None, 25, True),
        (range(5, 25), None, 25, False),
        (range(4, 25), 14, 25, False),
        ((*range(3, 10), *range(11, 25)), None, 25, False),
        (range(4, 25), None, 26, False),
    ],
    ids=["21 in a row", "20 in a row", "one in +Z among them", "guidance among them", "guidance after them"],
)
def test_episode_ends_for_want_of_progress_after_so_many_moves_without(
    first: Any, numbers: Iterable[int], inserted: int | None, moves: int, possible: bool
) -> None:
    limits = replace(first.record.definition.limits, no_progress_moves=20)
    steps = [
        JournalStep(step=number, force_n=(0, 0, 1), torque_nm=(0, 0, 0), action=INSERT if number == inserted else 0)
        for number in numbers
    ]
    summary = replace(first.journal[0].summary, outcome="no_progress", moves=moves)
    troubles = summary_troubles(replace(first.record.definition, limits=limits), steps, summary, 0)
    assert ("outcome" in [trouble.field for trouble in troubles]) == (not possible)


def test_changed_force_spoils_the_classes_alone(first: Any) -> None:
    episode, index = a_step(first.journal, lambda step: True)
    x, y, z = first.journal[episode].steps[index].force_n
    journal = changed(first.journal, episode, index, force_n=(x, y, z * 1.000001))
    found = replayed(first, journal).digests()
    assert found["art2"] != first.digests[-1]["art2"]
    assert found["q_table"] == first.digests[-1]["q_table"]


RECOMPUTED = ("run", "episode", "episode_return", "decisions", "states", "outcome")
BOUNDED = ("moves", "mean_force_n", "peak_force_n", "mean_torque_nm", "peak_torque_nm")


def beyond(summary: EpisodeSummary, field: str) -> list[Any]:
    """Return values that the field of a summary cannot have, the nearest there are where it is recomputed."""
    value = getattr(summary, field)
    values: dict[str, list[Any]] = {
        "run": ["x-s1"],
        "outcome": [other for other in ("inserted", "collision", "no_progress", "move_limit") if other != value],
        "moves": [121, summary.decisions - 1],
        "mean_force_n": [summary.peak_force_n * 1.01, 0.0],
        "mean_torque_nm": [summary.peak_torque_nm * 1.01, 0.0],
        "peak_force_n": [summary.mean_force_n * 0.99, 1000.0 if summary.outcome != "collision" else 9.9],
        "peak_torque_nm": [summary.mean_torque_nm * 0.99, 1e6],
    }
    if field == "episode_return":
        return [math.nextafter(value, -math.inf), math.nextafter(value, math.inf), -value or 1.0]
    return values[field] if field in values else [value + 1, value - 1 if value else 2]


@pytest.mark.parametrize("name", SHIPPED)
def test_every_field_of_a_summary_is_recomputed_or_bounded(record_run: Callable[..., Any], name: str) -> None:
    """In every episode, by itself: the one changed number is what differs, and it is named or what it contradicts."""
    assert {*RECOMPUTED, *BOUNDED} == set(EpisodeSummary.__struct_fields__)
    recorded = record_run(definition(name), SEED, EPISODES)
    for field in EpisodeSummary.__struct_fields__:
        for entry in recorded.journal:
            for value in beyond(entry.summary, field):
                where = f"episode {entry.episode}: {field} {value} instead of {getattr(entry.summary, field)}"
                journal = list(recorded.journal)
                journal[entry.episode] = replace(entry, summary=replace(entry.summary, **{field: value}))
                if field in ("run", "episode"):
                    with pytest.raises(BadPayloadError, match="expected its summary"):
                        replayed(recorded, journal)
                    continue
                found = replayed(recorded, journal).first_mismatch
                assert found is not None and found.episode == entry.episode, where
                assert field in ("outcome", "moves") or found.field in (field, field.replace("peak", "mean")), where


def test_documentation_says_what_is_recomputed_and_what_is_bounded() -> None:
    text = (Path(__file__).parents[3] / "docs" / "replay.md").read_text()
    rows = [line.split("|") for line in text.splitlines() if line.startswith("| `")]
    told = {name.strip(" `"): row[2].strip() for row in rows for name in row[1].split(",")}
    assert told == {**dict.fromkeys(RECOMPUTED, "recomputed"), **dict.fromkeys(BOUNDED, "bounded")}


def test_moves_of_an_insertion_are_those_that_its_depth_takes(record_run: Callable[..., Any]) -> None:
    recorded = record_run(load("paper2-random-start"), SEED, EPISODES)
    inserted = [entry for entry in recorded.journal if entry.summary.outcome == "inserted"]
    assert inserted and replayed(recorded).first_mismatch is None
    for entry in inserted:
        for moves in (entry.summary.moves - 1, entry.summary.moves + 1):
            assert replayed(recorded, changed(recorded.journal, entry.episode, None, moves=moves)).mismatches


def one_episode(first: Any, forces_n: Iterable[float], **summary: Any) -> list[str]:
    """Return what is wrong with an episode that had so many decisions in a row, after one move of guidance."""
    steps = [
        JournalStep(step=number, force_n=(0, 0, force_n), torque_nm=(0, 0, 0), state=0, action=0, reward=-1.0)
        for number, force_n in enumerate(forces_n, start=1)
    ]
    fields: dict[str, Any] = {
        "decisions": len(steps),
        "episode_return": -1.0 * len(steps),
        "states": 1,
        "moves": len(steps) + 1,
    }
    fields |= {"mean_torque_nm": 0.0, "peak_torque_nm": 0.0, "outcome": "move_limit", **summary}
    limits = replace(first.record.definition.limits, move_limit=fields["moves"], no_progress_moves=0)
    made = replace(first.journal[0].summary, **fields)
    return [found.field for found in summary_troubles(replace(first.record.definition, limits=limits), steps, made, 0)]


def test_mean_is_recomputed_to_the_bit_where_the_last_motion_alone_is_not_recorded_and_had_the_peak(first: Any) -> None:
    forces_n = [0.1 + 0.3 * number for number in range(1, 12)]
    mean = sum([*forces_n, 7.7]) / 12
    assert one_episode(first, forces_n, peak_force_n=7.7, mean_force_n=mean) == []
    for other in (math.nextafter(mean, 0.0), math.nextafter(mean, 9.0)):
        assert one_episode(first, forces_n, peak_force_n=7.7, mean_force_n=other) == ["mean_force_n"]


def test_mean_has_no_more_room_than_guidance_and_the_last_motion(first: Any) -> None:
    """Ten motions of guidance, each below contact, in an episode whose greatest force a decision followed upon."""
    forces_n = [4.0, 3.0]
    most_n = 7.0 + 4.0 + 9 * 0.3
    for sum_n, possible in ((6.9, False), (7.1, True), (most_n - 0.01, True), (most_n + 0.01, False)):
        found = one_episode(first, forces_n, moves=12, peak_force_n=4.0, mean_force_n=sum_n / 12)
        assert found == ([] if possible else ["mean_force_n"])
    assert one_episode(first, forces_n, moves=12, peak_force_n=math.nextafter(4.0, 0.0), mean_force_n=0.6) == [
        "peak_force_n"
    ]


def test_summary_without_a_move_has_felt_nothing(first: Any) -> None:
    fields = {
        "moves": 0,
        "outcome": "collision",
        "episode_return": first.record.definition.reward.collision,
        "states": 0,
    }
    still = {"mean_force_n": 0.0, "peak_force_n": 0.0}
    assert one_episode(first, (), **fields, **still) == []
    for name in still:
        assert one_episode(first, (), **fields, **{**still, name: 1e-9}) == [name]
    assert "outcome" in one_episode(first, (), **{**fields, "outcome": "move_limit", "episode_return": 0.0}, **still)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"fresh": ("agent",)}, "swap 1: fresh: expected"),
        ({"learner": None}, "swap 1: changes: expected"),
    ],
)
def test_swap_that_cannot_have_been_made_is_refused(first: Any, fields: dict[str, Any], words: str) -> None:
    good = planned(first.record.run, first.record.definition, ["2:agent:learner=sarsa", "3:agent:alpha=0.01"], EPISODES)
    Replay(first.record, swaps=good)
    with pytest.raises(DivergedError, match=words):
        Replay(first.record, swaps=(replace(good[0], **fields), good[1]))
    with pytest.raises(DivergedError, match="swap 2: episode: expected 4, got 3"):
        Replay(first.record, swaps=(replace(good[0], episode=4), good[1]))


def test_gap_and_unfinished_entries_are_errors_in_one_line(first: Any) -> None:
    run, journal = first.record.run, first.journal
    with pytest.raises(GapError, match=rf"^run {run}, episode 2: episode: expected 2, got 3$"):
        replayed(first, [*journal[:2], *journal[3:]])
    later = replace(journal[2], first_decision=journal[2].first_decision + 1)
    with pytest.raises(GapError, match="first_decision: expected"):
        replayed(first, [*journal[:2], later])
    with pytest.raises(GapError, match="run: expected"):
        replayed(first, [replace(journal[0], run="another-s1")])
    with pytest.raises(BadPayloadError, match=r"episode 0: expected its summary, got none$"):
        replayed(first, [replace(journal[0], summary=None)])
    with pytest.raises(BadPayloadError, match="expected its summary, got that of episode 1"):
        replayed(first, [replace(journal[0], summary=journal[1].summary)])
    for field in ("state", "action", "policy_version", "reward"):
        with pytest.raises(BadPayloadError, match=rf"^run {run}, episode 1, step \d+: expected state, action"):
            replayed(first, changed(journal, 1, 0, **{field: None}))
    with pytest.raises(BadPayloadError, match="expected an action below 9, got 9"):
        replayed(first, changed(journal, 1, 0, action=9))


def test_record_that_contradicts_itself_is_refused(first: Any) -> None:
    for fields, words in (
        ({"seed": SEED + 1}, "name: expected"),
        ({"definition": load(SHIPPED[1])}, "definition_sha256: expected"),
        ({"run": "x-s1"}, "name: expected"),
    ):
        with pytest.raises(DivergedError, match=words):
            Replay(replace(first.record, **fields))


# -- what else knows --------------------------------------------------------------------------------------------------


def named(checkpoints: list[Checkpoint]) -> list[StoredCheckpoint]:
    return [StoredCheckpoint(f"checkpoint/{one.run}/{one.service}/{one.episode:08d}", one, 0) for one in checkpoints]


def compared(recorded: Any, witnesses: Witnesses, until: int | None = None) -> list[Compared]:
    replay = witnesses.replay(recorded.record, recorded.began_with)
    for entry in recorded.journal[:until]:
        replay.fold(entry)
    return witnesses.compared(replay, recorded.began_with, until)


def test_checkpoints_are_compared_at_their_episodes(first: Any) -> None:
    witnesses = Witnesses(named(first.checkpoints))
    found = compared(first, witnesses)
    assert [(one.part, one.place, one.equal) for one in found] == [
        (part, f"before episode {episode}", True) for episode in (2, 4) for part in ("q_table", "art2")
    ]
    assert [one.found for one in found] == [
        first.digests[episode][part] for episode in (2, 4) for part in ("q_table", "art2")
    ]
    assert len(compared(first, witnesses, until=3)) == 2
    assert compared(first, witnesses, until=1) == []


def test_checkpoint_of_another_moment_differs(first: Any) -> None:
    earlier, later = first.checkpoints[0], first.checkpoints[2]
    assert earlier.service == later.service == "agent"
    (memory, *places) = compared(first, Witnesses(named([replace(later, snapshot=earlier.snapshot)])))
    assert (memory.part, memory.equal, memory.found) == ("q_table", False, first.digests[2]["q_table"])
    of_place = {one.part: (one.rebuilt, one.equal) for one in places}
    assert of_place["fold_decisions"] == (str(later.decisions), False)
    assert of_place["fold_episode"] == (str(later.episode - 1), False)
    (broken,) = compared(first, Witnesses(named([replace(later, snapshot={**later.snapshot, "version": 1})])))
    assert broken.equal is False
    assert broken.found.startswith("cannot be restored: ")


def flipped(value: Any) -> Any:
    """Return a number, or the bytes of many, with its smallest digit another one."""
    return value + 1 if isinstance(value, int) else bytes([value[0] ^ 1]) + value[1:]


def test_every_number_of_a_checkpoint_is_compared(first: Any) -> None:
    for one in first.checkpoints[:2]:
        for field, value in one.snapshot.items():
            found = compared(first, Witnesses(named([replace(one, snapshot={**one.snapshot, field: flipped(value)})])))
            assert any(row.equal is False for row in found), field
        others = {"decisions": one.decisions + 1, "contract_sha256": "0" * 64, "run": "x-s1", "service": "sim"}
        for field, value in {**others, "episode": one.episode + 1}.items():
            (there,) = named([one])
            found = compared(first, Witnesses([there._replace(checkpoint=replace(one, **{field: value}))]))
            assert any(row.equal is False for row in found), field
        assert one.service == "agent" or set(others) | {"episode", "snapshot"} == set(Checkpoint.__struct_fields__)


def test_newest_episode_is_that_of_the_journal(first: Any) -> None:
    newest = first.journal[-1]
    assert [one.equal for one in compared(first, Witnesses(newest=newest))] == [True]
    assert compared(first, Witnesses(newest=newest), until=EPISODES - 1) == []
    (bad,) = changed([newest], 0, None, mean_force_n=math.nextafter(newest.summary.mean_force_n, 0.0))
    (row,) = compared(first, Witnesses(newest=bad))
    assert (row.witness, row.equal) == (f"journal/{first.record.run}/latest", False)


def test_every_figure_of_a_summary_file_is_compared(first: Any) -> None:
    good: Any = json.loads(run_summary(first))["runs"][0]
    assert all(one.equal for one in compared(first, Witnesses(summary=good)))
    changes = {**good, "steady_from": 0, "failures_per_10": [EPISODES + 1], "digests": {**good["digests"], "art2": ""}}
    for block in ("first_10", "last_quarter"):
        for name, value in good[block].items():
            bad: Any = {**good, block: {**good[block], name: math.nextafter(value, math.inf)}}
            assert [one.part for one in compared(first, Witnesses(summary=bad)) if not one.equal] == [block]
    for name in ("seed", "states", "collisions", "episodes"):
        changes[name] = good[name] + 1
    for name in good.keys() - {"first_10", "last_quarter"}:
        bad = {**good, name: changes[name]}
        assert not all(one.equal for one in compared(first, Witnesses(summary=bad))), name


def test_checkpoint_may_be_one_episode_ahead_of_the_journal_and_no_more(first: Any) -> None:
    newest = first.checkpoints[-1]
    for ahead, verdict in ((1, None), (2, False)):
        (one,) = compared(first, Witnesses(named([replace(newest, episode=EPISODES + ahead)])))
        assert (one.rebuilt, one.equal) == (None, verdict)


def test_living_agent_is_compared_at_its_version(first: Any) -> None:
    """Also in the midst of an episode: the digest is that at the agent's policy version."""
    half = Replay(first.record)
    half.fold(first.journal[0])
    under_way = replace(first.journal[1], steps=first.journal[1].steps[:7], summary=None)
    half.agent.replay(under_way)
    learner = half.agent.learner
    table = QTable(
        run=first.record.run,
        decisions=half.agent.decisions,
        policy_version=learner.version,
        actions=(),
        q=(),
        visits=(),
        best_action=(),
        digest=learner.digest(),
    )
    (one,) = compared(first, Witnesses(table=table))
    assert (one.witness, one.place, one.equal) == ("agent, living", f"at version {learner.version}", True)
    (one,) = compared(first, Witnesses(table=replace(table, policy_version=learner.version + 1)))
    assert one.equal is False
    (one,) = compared(first, Witnesses(table=replace(table, policy_version=10**6)))
    assert (one.rebuilt, one.equal) == (None, None)


# -- the command ------------------------------------------------------------------------------------------------------


def run_summary(recorded: Any, episodes: int = EPISODES) -> str:
    """Return the ``summary.json`` of a run's first episodes."""
    done = tuple(entry.summary for entry in recorded.journal[:episodes])
    result = RunResult(recorded.record.seed, done, recorded.digests[episodes])
    return json.dumps(summary(recorded.record.definition, recorded.record.definition_sha256, [result]))


@pytest.fixture
def store(first: Any, store_of: Callable[..., Path], tmp_path: Path) -> Path:
    return store_of(tmp_path / "store.sqlite", first)


def asked(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    status = replay_command.main(words)
    out, err = capsys.readouterr()
    return status, out, err


def test_command_prints_what_is_rebuilt_and_that_it_is_equal(
    first: Any, store: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store.with_name("summary.json").write_text(run_summary(first, 4))
    status, out, err = asked(capsys, "--store", str(store))
    assert (status, err) == (0, "")
    lines = out.splitlines()
    name = first.record.definition.name
    assert lines[0] == f"run {first.record.run}: {name}, seed {SEED}, began with nothing learnt"
    assert lines[1].startswith(f"{EPISODES} episodes, {first.run.decisions} decisions, ")
    assert dict(line.split() for line in lines[2:5]) == first.digests[-1]
    assert out.count("before episode 2 to 4") == 2
    assert out.count("summary.json") == 3
    bounded = f"1 of {EPISODES} episodes, which nothing else tells, are within their bounds"
    assert lines[-1] == f"equal; means and peaks of {bounded}"
    store.with_name("summary.json").write_text(run_summary(first))
    assert asked(capsys, "--store", str(store))[1].splitlines()[-1] == "equal"
    store.with_name("summary.json").write_text(run_summary(first, 4))
    assert (status, out) == asked(capsys, first.record.run[:5], "--store", str(store.parent))[:2]


def test_command_as_json_until_an_episode(first: Any, store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for until in (0, 3):
        status, out, _ = asked(capsys, "--store", str(store), "--until", str(until), "--json")
        found = json.loads(out)
        assert (status, found["equal"], found["episodes"]) == (0, True, until)
        assert found["digests"] == first.digests[until]
        assert len(found["states"]) == len(replayed(first, first.journal[:until]).states())
        assert {one["place"] for one in found["compared"]} == ({"before episode 2"} if until else set())


def test_command_shows_the_memory_as_it_was(first: Any, store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, _ = asked(capsys, "--store", str(store), "--until", "3")
    assert status == 0
    assert "Memory before episode 3" in out
    for row in replayed(first, first.journal[:3]).states():
        cells = [str(row.state), row.best_action, f"{row.value:.2f}", str(row.visits), str(row.felt)]
        assert any([cell.strip() for cell in line.split("│")[1:-1]] == cells for line in out.splitlines())


def test_command_names_a_changed_reward_and_what_it_spoils(
    first: Any, store: Path, keep: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    store.with_name("summary.json").write_text(run_summary(first))
    journal = changed(first.journal, 2, 1, reward=-7.5)
    keep(store, {Keys("a").journal(first.record.run, 2): journal[2]})
    status, out, _ = asked(capsys, "--store", str(store))
    assert status == 1
    decision = journal[2].first_decision + 1
    assert f"first mismatch: episode 2, step {journal[2].steps[1].step}, decision {decision}: reward: expected" in out
    verdicts = {tuple(line.split("│")[1:3]): line.split("│")[-2].strip() for line in out.splitlines() if "│" in line}
    found = {(what.strip().split("/")[-2:][0], part.strip()): verdict for (what, part), verdict in verdicts.items()}
    assert found[("summary.json", "q_table")] == "DIFFERS"
    assert found[("summary.json", "art2")] == found[("summary.json", "episodes")] == "equal"
    assert found[("classifier", "art2")] == "3 equal"
    assert out.splitlines()[-1] == "DIFFERS"
    _, out, _ = asked(capsys, "--store", str(store), "--json")
    rows = [one for one in json.loads(out)["compared"] if one["part"] == "q_table"]
    assert [(one["witness"].split("/")[-1], one["equal"]) for one in rows] == [
        ("00000002", True), ("00000004", False), ("latest", False), ("summary.json", False)
    ]  # fmt: skip
    assert Mismatch(**json.loads(out)["first_mismatch"]).got == "-7.5"


def test_only_the_summary_of_this_run_counts(first: Any, store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = store.with_name("summary.json")
    other.write_text(run_summary(first).replace(f'"seed": {SEED}', '"seed": 77'))
    status, out, err = asked(capsys, "--store", str(store))
    assert (status, "summary.json" in out) == (0, False)
    assert err.startswith(f"not compared: {other}: expected definition ") and len(err.splitlines()) == 1
    status, _, err = asked(capsys, "--store", str(store), "--summary", str(other))
    assert status == 2
    assert err.startswith(f"treenail replay: {other}: expected definition ")
    assert "with seed 77" in err
    for content in ("{}", "no JSON", "\xff"):
        other.write_bytes(content.encode("latin-1"))
        status, _, err = asked(capsys, "--store", str(store), "--summary", str(other))
        assert (status, len(err.splitlines())) == (2, 1)
        status, _, err = asked(capsys, "--store", str(store))
        assert status == 0 and err.startswith(f"not compared: {other}: expected a summary of results: ")
    longer = json.loads(run_summary(first))
    longer["runs"][0]["episodes"] = EPISODES + 1
    other.write_text(json.dumps(longer))
    assert asked(capsys, "--store", str(store))[0] == 1


def test_run_of_another_contract_is_said_in_one_line(
    first: Any, store: Path, keep: Callable[..., None], capsys: pytest.CaptureFixture[str]
) -> None:
    keep(store, {Keys("a").run_record(first.record.run): replace(first.record, contract_sha256="0" * 64)})
    status, out, err = asked(capsys, "--store", str(store))
    assert (status, out) == (2, "")
    expected = f"run {first.record.run}: expected contract {contract_sha256()[:12]}, got 000000000000;"
    assert err == f"treenail replay: {expected} use the version of Treenail that recorded it\n"
