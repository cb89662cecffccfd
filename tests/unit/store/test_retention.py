"""Which keys retention removes, and above all which it never removes."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.store.retention import RetentionSettings, removable
from services.wire.keys import CONTRACT, RUN, name_of

PREFIX = "treenail/a"
Stored = list[tuple[str, str]]


def checkpoints(run: str, service: str, *numbers: int) -> Stored:
    return [(f"{PREFIX}/checkpoint/{run}/{service}/{number:08}", "5") for number in numbers]


def journal(run: str, episodes: range) -> Stored:
    return [(f"{PREFIX}/journal/{run}/{episode // 100:06}/{episode:08}", "5") for episode in episodes]


def kept_episodes(stored: Stored, settings: RetentionSettings) -> list[int]:
    removed = set(removable(stored, settings))
    return [int(key[-8:]) for key, _ in stored if "/journal/" in key and key not in removed]


def test_the_newest_checkpoints_of_each_service_stay() -> None:
    stored = checkpoints("r", "agent", 30, 10, 20) + checkpoints("r", "classifier", 5, 7)
    assert removable(stored, RetentionSettings(checkpoints=2)) == [f"{PREFIX}/checkpoint/r/agent/00000010"]


def test_the_journal_is_cut_to_its_newest_episodes() -> None:
    stored = checkpoints("r", "agent", 90, 100) + journal("r", range(100))
    assert kept_episodes(stored, RetentionSettings(journal_episodes=30)) == list(range(70, 100))


def test_the_journal_after_the_oldest_kept_checkpoint_of_any_service_stays() -> None:
    stored = checkpoints("r", "agent", 10, 40, 90) + checkpoints("r", "classifier", 60) + journal("r", range(100))
    settings = RetentionSettings(checkpoints=2, journal_episodes=5)
    assert kept_episodes(stored, settings) == list(range(40, 100))


def test_a_journal_without_a_checkpoint_stays() -> None:
    stored = journal("r", range(100)) + checkpoints("other", "agent", 90)
    assert removable(stored, RetentionSettings(journal_episodes=5)) == []


def test_a_service_with_no_numbered_checkpoint_may_need_the_whole_journal() -> None:
    latest = [(f"{PREFIX}/checkpoint/r/classifier/latest", "5")]
    stored = checkpoints("r", "agent", 90) + latest + journal("r", range(100))
    assert removable(stored, RetentionSettings(journal_episodes=5)) == []


def test_the_runs_touched_last_stay_and_older_ones_go_entirely() -> None:
    old = [
        (f"{PREFIX}/checkpoint/old/agent/latest", "1"),
        (f"{PREFIX}/journal/old/000000/00000000", "2"),
        (f"{PREFIX}/journal/old/latest", "3"),
        (f"{PREFIX}/journal/old/run", "1"),
    ]
    resumed = [(f"{PREFIX}/journal/resumed/run", "0"), (f"{PREFIX}/journal/resumed/latest", "9")]
    other_cell = [("treenail/b/journal/old/run", "1")]
    stored = old + resumed + other_cell + [(f"{PREFIX}/journal/new/run", "4")]
    assert removable(stored, RetentionSettings(runs=2)) == [key for key, _ in old]


@pytest.mark.parametrize(
    "key",
    [
        f"{PREFIX}/notes",
        "elsewhere/a/journal/r/000000/00000000",
        f"{PREFIX}/checkpoint/r/agent/7",
        f"{PREFIX}/checkpoint/r/agent/00000007/more",
        f"{PREFIX}/journal/r/00000000",
        f"{PREFIX}/journal/r/000000/{chr(0x660) * 8}",
    ],
)
def test_keys_of_another_form_are_not_touched(key: str) -> None:
    newer = [(f"{PREFIX}/journal/{run}/run", "9") for run in "xyz"]
    assert key not in removable([(key, "1"), *newer], RetentionSettings(checkpoints=1, journal_episodes=1, runs=1))


@pytest.mark.parametrize("name", ["checkpoints", "journal_episodes", "runs"])
def test_keeping_nothing_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match=f"{name}: expected from 1, got 0"):
        RetentionSettings(**{name: 0})


EPISODES = st.integers(0, 40)
CELLS, RUNS, SERVICES = (st.sampled_from(names) for names in (["a", "b"], ["r1", "r2", "r3"], ["agent", "classifier"]))
STORED_KEYS = st.one_of(
    st.builds("treenail/{}/checkpoint/{}/{}/{:08}".format, CELLS, RUNS, SERVICES, EPISODES),
    st.builds("treenail/{}/checkpoint/{}/{}/latest".format, CELLS, RUNS, SERVICES),
    st.builds(lambda c, r, e: f"treenail/{c}/journal/{r}/{e // 100:06}/{e:08}", CELLS, RUNS, EPISODES),
    st.builds("treenail/{}/journal/{}/{}".format, CELLS, RUNS, st.sampled_from(["run", "latest"])),
)
SETTINGS = st.builds(RetentionSettings, st.integers(1, 3), st.integers(1, 8), st.integers(1, 3))


def resume_points(keys: set[str], cell: str, run: str) -> dict[str, list[int]]:
    """Numbers of the checkpoints by service."""
    points: dict[str, list[int]] = {}
    for key in keys:
        _, its_cell, kind, its_run, service, *rest = key.split("/")
        if (its_cell, kind, its_run) == (cell, "checkpoint", run):
            points.setdefault(service, []).extend(int(number) for number in rest if number != "latest")
    return points


@given(st.dictionaries(STORED_KEYS, st.sampled_from("123456"), max_size=120), SETTINGS)
def test_what_is_left_is_enough_and_no_more_than_allowed(stored: dict[str, str], settings: RetentionSettings) -> None:
    removed = removable(stored.items(), settings)
    assert removed == sorted(set(removed))
    kept = set(stored) - set(removed)
    assert set(removed) <= set(stored)
    for cell in "ab":
        ages: dict[str, str] = {}
        for key, timestamp in stored.items():
            _, its_cell, _, run, *_ = key.split("/")
            if its_cell == cell:
                ages[run] = max(timestamp, ages.get(run, ""))
        living = [run for run in ages if any(key.split("/")[1:4:2] == [cell, run] for key in kept)]
        assert len(living) == min(len(ages), settings.runs)
        assert all(ages[gone] <= ages[run] for gone in ages if gone not in living for run in living)
        for run in living:
            check_run(stored, kept, cell, run, settings)


def check_run(stored: dict[str, str], kept: set[str], cell: str, run: str, settings: RetentionSettings) -> None:
    def of_journal(keys: set[str]) -> set[int]:
        return {int(key[-8:]) for key in keys if key.startswith(f"treenail/{cell}/journal/{run}/0")}

    before, after = resume_points(set(stored), cell, run), resume_points(kept, cell, run)
    for service, numbers in before.items():
        assert sorted(after[service]) == sorted(numbers)[-settings.checkpoints :]
    for key in stored:
        _, its_cell, _, its_run, *rest = key.split("/")
        if (its_cell, its_run) == (cell, run) and rest[-1] in ("run", "latest"):
            assert key in kept
    episodes, left = of_journal(set(stored)), of_journal(kept)
    complete = bool(after) and all(after.values())
    needed_from = min((min(numbers) for numbers in after.values() if numbers), default=0) if complete else 0
    assert {episode for episode in episodes if episode >= needed_from} <= left
    assert set(sorted(episodes)[-settings.journal_episodes :]) <= left
    assert all(episode >= needed_from for episode in left) or len(left) <= settings.journal_episodes


@given(st.dictionaries(STORED_KEYS, st.just("1"), max_size=60), SETTINGS)
def test_a_second_look_finds_nothing_more_whatever_the_order(
    stored: dict[str, str], settings: RetentionSettings
) -> None:
    removed = removable(stored.items(), settings)
    assert removable(reversed(stored.items()), settings) == removed
    assert removable([(key, "1") for key in stored if key not in removed], settings) == []


PARTS: dict[str, str | int] = {"service": "agent", "episode": 3, "sha256": "0f" * 32, "instance": "01-2"}


def test_all_keys_of_a_run_go_together_and_no_other_key_of_the_contract() -> None:
    of_a_run = [pattern for pattern in CONTRACT if "<run>" in pattern]
    old = [f"{PREFIX}/{name_of(pattern, run='old-s1', **PARTS)}" for pattern in of_a_run]
    others = [f"{PREFIX}/{name_of(pattern, **PARTS)}" for pattern in CONTRACT if pattern not in of_a_run]
    newer = [(f"{PREFIX}/{name_of(RUN, run='new-s1')}", "9")]
    stored = [*((key, "1") for key in (*old, *others)), *newer]
    assert removable(stored, RetentionSettings(runs=1)) == sorted(old)
