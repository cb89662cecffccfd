"""The claims of 5.3 and 4.2.2, in small: what differs from condition to condition, and what counts as holding."""

from __future__ import annotations

from pathlib import Path

import pytest
from msgspec.structs import replace

from experiments.lab.progress import Lines
from experiments.reproduce import claims, claims_runs
from experiments.reproduce.cache import Cache
from experiments.reproduce.chapter import CannotRun, Comparisons, Table
from experiments.reproduce.claims_runs import FELT, LEARNERS, PLACES, SHAPES, TABLE, WHO, Place, Went
from experiments.reproduce.context import Context
from services.wire.definition import Wrist
from services.wire.definition_file import definition_sha256, load
from services.wire.definition_rules import contradiction


def context(folder: Path, *, kept: bool = False) -> Context:
    said: list[str] = []
    return Context(True, (0,), None, Cache(folder, said.append), Lines(said.append, lambda: 0.0), 1, 1, kept)


def went(outcomes: str, returned: float = -10.0) -> Went:
    return Went(outcomes, [0.5] * len(outcomes), [returned] * len(outcomes))


def test_a_condition_differs_from_the_first_in_what_it_says_alone() -> None:
    for who in WHO:
        for place in PLACES:
            task = claims_runs.task(place, who)
            assert contradiction(task) is None
            assert task.start == load("chamfered-q-softmax").start
            base = claims_runs.task(next(other for other in PLACES if other.claim == place.claim), who)
            assert replace(task, wrist=base.wrist, hole=base.hole) == base
            assert (task == base) == (place.condition in ("along the tool's", "upright"))
    assert definition_sha256(claims_runs.task(PLACES[0], TABLE)) == definition_sha256(load("chamfered-q-softmax"))
    assert claims_runs.task(Place("axes", "along the tool's"), FELT).wrist == Wrist()
    rule = claims_runs.task(Place("axes", "any, another with each seed"), "rule")
    assert rule.wrist.sensor_mount == "unknown"


def test_the_world_of_a_condition_is_the_same_for_all() -> None:
    for place in PLACES:
        worlds = [claims_runs.task(place, who) for who in WHO]
        for part in ("parts", "contact", "wrist", "noise", "start", "hole", "moves"):
            assert len({str(getattr(world, part)) for world in worlds}) == 1, (place, part)


def test_shapes_follow_each_other_with_the_moves_of_their_tasks() -> None:
    for who in LEARNERS:
        tasks = [claims_runs.shape(who, name) for name in SHAPES]
        assert [task.parts.shape for task in tasks] == list(SHAPES)
        assert [task.moves.count for task in tasks] == [9, 11, 11]
        assert [contradiction(task) for task in tasks] == [None] * 3
        at_one, at_random = claims_runs.starts(who)
        assert at_random.start.xy_spread_mm == 2.0 and at_one.start.xy_spread_mm == 0.0
        assert replace(at_random, start=at_one.start) == at_one


def test_who_fails_where_nothing_is_changed_shows_nothing_elsewhere() -> None:
    good, poor = went("i" * 50), went("ic" * 25)
    assert claims._as_good(went("c" * 3 + "i" * 47), good)
    assert not claims._as_good(went("c" * 4 + "i" * 46), good)
    assert not claims._as_good(poor, poor)
    assert claims._as_good(went("c" * 40 + "i" * 50), good), "the last of who learns count"
    assert not claims._as_good(went("c" * 40 + "i" * 50), good, learns=False)


def test_only_the_thesis_s_learner_is_compared_with_the_thesis() -> None:
    blocks = claims._answers([claims.Asked(who, "a thing", "so (1858)", [True, False], "why") for who in LEARNERS])
    compared, other = blocks
    assert isinstance(compared, Comparisons) and len(compared.rows) == 1
    assert isinstance(other, Table) and other.rows == [("a thing", "1 of 2 seeds")]


def test_the_chapter_runs_and_shows_what_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(claims_runs, "QUICK_PLAYED", 1)
    with pytest.raises(CannotRun, match="no run of the claims is kept"):
        claims.chapter(context(tmp_path, kept=True))
    made = claims.chapter(context(tmp_path))
    assert claims.chapter(context(tmp_path, kept=True)).blocks == made.blocks
    tables = [block for block in made.blocks if isinstance(block, Table) and len(block.head) > 2]
    assert [len(table.rows) for table in tables] == [4 * len(WHO), 4 * len(WHO), 2 * 6 + 2, 2 * 11]
    assert not [row for table in tables for row in table.rows if "not run" in row]
    assert len(made.comparisons) == 3 + 3 + 2 + 4
