"""Two runs part where a comparison of all their steps, one by one, says so."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from experiments.journal import diff_command
from experiments.journal.diff import Comparison, differences
from services.wire.actions import ACTION_NAMES
from services.wire.definition import Definition
from services.wire.definition_file import load
from services.wire.keys import Keys
from services.wire.messages import JournalEpisode

EPISODES, SEED = 5, 3


def definition(*overrides: str) -> Definition:
    return load("chamfered-q-softmax", ("limits.move_limit=120", *overrides))


@pytest.fixture
def first(record_run: Callable[..., Any]) -> Any:
    return record_run(definition(), SEED, EPISODES)


@pytest.fixture
def other(record_run: Callable[..., Any]) -> Any:
    """Learns twice as fast; the forces are the same as long as the moves are."""
    return record_run(definition("learner.alpha=0.9", "title=other"), SEED, EPISODES)


def of(a: Any, b: Any, journal_b: list[JournalEpisode] | None = None, **more: Any) -> Comparison:
    comparison = Comparison(a.record, b.record, **more)
    for pair in zip(a.journal, journal_b or b.journal, strict=True):
        comparison.add(*pair)
    return comparison


def brute_force(a: Any, b: Any) -> Any:
    """Return episode, index and field of the first value that is not the same, from plain lists."""
    fields = ("step", "force_n", "torque_nm", "state", "action", "reward", "policy_version")
    rows = [
        [
            (one.episode, i, f, getattr(step, f))
            for one in run.journal
            for i, step in enumerate(one.steps)
            for f in fields
        ]
        for run in (a, b)
    ]
    return next(in_a[:3] for in_a, in_b in zip(*rows, strict=False) if in_a != in_b)


def test_run_is_the_same_as_itself(first: Any) -> None:
    found = of(first, first)
    assert (found.parting, found.settings, found.pairs, found.courses()) == (None, [], [], None)
    assert found.episodes == EPISODES


def test_runs_of_other_settings_part_where_all_steps_say_so(first: Any, other: Any) -> None:
    found = of(first, other)
    assert {one.field: (one.a, one.b) for one in found.settings} == {
        "learner.alpha": (first.record.definition.learner.alpha, 0.9),
        "title": (first.record.definition.title, "other"),
    }
    parting = found.parting
    assert parting is not None
    episode, index, field = brute_force(first, other)
    assert (parting.episode, parting.field) == (episode, field) == (episode, "action")
    steps = first.journal[episode].steps[index], other.journal[episode].steps[index]
    assert parting.step == steps[0].step == steps[1].step
    assert parting.decision == first.journal[episode].first_decision + index
    assert (parting.a, parting.b) == tuple(ACTION_NAMES[step.action] for step in steps)
    assert str(parting).endswith(f"action: {parting.a} in A, {parting.b} in B")


def test_runs_of_other_seeds_part_and_go_on(first: Any, record_run: Callable[..., Any]) -> None:
    second = record_run(definition(), SEED + 1, EPISODES)
    found = of(first, second)
    assert [tuple(one) for one in found.settings] == [("seed", SEED, SEED + 1)]
    assert found.parting is not None
    pairs = [
        (a.summary, b.summary)
        for a, b in zip(first.journal, second.journal, strict=True)
        if a.episode >= found.parting.episode
    ]
    same = sum(a.outcome == b.outcome for a, b in pairs)
    assert tuple(found.outcomes()) == (same, len(pairs) - same)
    same = sum(a.episode_return == b.episode_return for a, b in pairs)
    assert tuple(found.returns()) == (same, len(pairs) - same)
    courses = found.courses()
    assert courses is not None
    for course, of_run in zip(courses, zip(*pairs, strict=True), strict=True):
        assert course.episodes == len(pairs)
        assert course.episode_return == pytest.approx(sum(one.episode_return for one in of_run) / len(pairs))
        assert course.force_n == pytest.approx(sum(one.mean_force_n for one in of_run) / len(pairs))
        assert course.success == sum(one.outcome == "inserted" for one in of_run) / len(pairs)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("step", 999),
        ("force_n", (1.0, 2.0, 3.0)),
        ("torque_nm", (0.1, 0.2, 0.3)),
        ("state", 77),
        ("action", 8),
        ("reward", -7.5),
        ("policy_version", 9999),
    ],
)
def test_changed_step_is_the_parting(first: Any, field: str, value: object) -> None:
    entry = first.journal[2]
    steps = list(entry.steps)
    index = next(i for i, step in enumerate(steps) if i and step.action != 8)
    steps[index] = replace(steps[index], **{field: value})
    journal = [*first.journal[:2], replace(entry, steps=tuple(steps)), *first.journal[3:]]
    parting = of(first, first, journal).parting
    assert parting is not None
    place = (2, entry.steps[index].step, entry.first_decision + index, field)
    assert parting[:4] == place
    assert parting.b == (ACTION_NAMES[8] if field == "action" else value)


def test_lengths_and_summaries_count_too(first: Any) -> None:
    entry = first.journal[1]
    for field, value in (("outcome", "no_progress"), ("episode_return", 1.0), ("peak_torque_nm", 1.0)):
        changed = replace(entry, summary=replace(entry.summary, **{field: value}))
        parting = of(first, first, [first.journal[0], changed, *first.journal[2:]]).parting
        assert parting is not None
        assert parting == (1, None, None, field, getattr(entry.summary, field), value)
    shorter = replace(entry, steps=entry.steps[:-1])
    parting = of(first, first, [first.journal[0], shorter, *first.journal[2:]]).parting
    assert parting == (1, None, None, "decisions", len(entry.steps), len(entry.steps) - 1)


def test_policy_versions_are_counted_from_the_beginning_of_a_run(first: Any) -> None:
    """A run that began with a skill counts on from there; that alone is no parting."""
    journal = [
        replace(one, steps=tuple(replace(step, policy_version=step.policy_version + 500) for step in one.steps))
        for one in first.journal
    ]
    assert of(first, first, journal, first_versions=(0, 500)).parting is None
    parting = of(first, first, journal).parting
    assert parting is not None
    assert (parting.field, parting.a, parting.b) == ("policy_version", 0, 500)


def test_kinds_of_settings_that_only_one_run_has_are_told(first: Any) -> None:
    second = replace(first.record, definition=definition("policy.kind=epsilon_greedy"), skill_sha256="1" * 64)
    found = {one.field: (one.a, one.b) for one in differences(first.record, second)}
    assert found["policy.kind"] == ("softmax", "epsilon_greedy")
    assert found["policy.epsilon"] == (None, 0.1)
    assert found["policy.beta"][1] is None
    assert found["skill_sha256"] == (None, "1" * 64)


# -- the command ------------------------------------------------------------------------------------------------------


def asked(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    status = diff_command.main(words)
    out, err = capsys.readouterr()
    return status, out, err


def test_command_compares_two_runs_of_one_store(
    first: Any, other: Any, store_of: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = store_of(tmp_path / "store.sqlite", first, other)
    status, out, err = asked(capsys, first.record.run[:6], other.record.run, "--store", str(store))
    assert (status, err) == (1, "")
    assert "learner.alpha" in out
    assert f"parting: {of(first, other).parting}" in out
    assert out.splitlines()[-1] == "different"
    status, out, _ = asked(capsys, first.record.run, other.record.run, "--store", str(store), "--json")
    found = json.loads(out)
    assert (status, found["same"], found["a"]["run"], found["b"]["run"]) == (
        1,
        False,
        first.record.run,
        other.record.run,
    )
    digests = {one["part"]: (one["a"], one["b"]) for one in found["digests"]}
    assert digests == {part: (first.digests[-1][part], other.digests[-1][part]) for part in first.digests[-1]}
    assert found["mismatches"] == {"a": {}, "b": {}}
    assert asked(capsys, first.record.run, first.record.run, "--store", str(store))[0] == 0


def test_command_compares_two_stores_and_runs_of_two_lengths(
    first: Any,
    record_run: Callable[..., Any],
    store_of: Callable[..., Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    shorter = record_run(definition(), SEED, 3)
    a, b = store_of(tmp_path / "a.sqlite", first), store_of(tmp_path / "b.sqlite", shorter)
    words = ("--store", str(a), "--store-b", str(b))
    status, out, _ = asked(capsys, *words)
    assert status == 1
    assert "no parting: all steps of the 3 episodes that both have are the same" in out
    found = json.loads(asked(capsys, *words, "--json")[1])
    assert (found["a"]["episodes"], found["b"]["episodes"], found["parting"]) == (EPISODES, 3, None)
    assert {one["part"]: one["a"] for one in found["digests"]} == first.digests[3] == shorter.digests[3]
    assert all(one["same"] for one in found["digests"])
    assert asked(capsys, "--store", str(a), "--store-b", str(a))[0] == 0


def test_runs_that_differ_in_their_names_alone_have_the_same_log(
    first: Any,
    record_run: Callable[..., Any],
    store_of: Callable[..., Path],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    renamed = record_run(definition("title=renamed"), SEED, EPISODES)
    store = store_of(tmp_path / "store.sqlite", first, renamed)
    status, out, _ = asked(capsys, first.record.run, renamed.record.run, "--store", str(store))
    assert status == 1
    assert "the same but for the run's name" in out
    assert "no parting" in out


def test_changed_journal_is_said_to_contradict_itself(
    first: Any, store_of: Callable[..., Path], keep: Callable[..., None], tmp_path: Path, capsys: Any
) -> None:
    a, b = store_of(tmp_path / "a.sqlite", first), store_of(tmp_path / "b.sqlite", first)
    entry = first.journal[2]
    step = replace(entry.steps[1], reward=-7.5)
    changed = replace(entry, steps=(entry.steps[0], step, *entry.steps[2:]))
    keep(b, {Keys("a").journal(first.record.run, 2): changed})
    status, out, _ = asked(capsys, "--store", str(a), "--store-b", str(b))
    assert status == 1
    assert f"parting: episode 2, step {step.step}, decision {entry.first_decision + 1}: reward: " in out
    assert "journal of B contradicts itself (treenail replay): episode 2, " in out
    assert "journal of A" not in out


def test_command_wants_two_runs(
    first: Any, store_of: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    store = store_of(tmp_path / "store.sqlite", first)
    status, _, err = asked(capsys, "--store", str(store))
    assert status == 2
    assert err.startswith("treenail diff: RUN_B: expected a second run, or --store-b with one, got neither; ")
    assert first.record.run in err
    assert asked(capsys, "zz", first.record.run, "--store", str(store))[0] == 2
