"""Key expressions of a cell."""

from __future__ import annotations

import string

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from services.wire.errors import TreenailError
from services.wire.keys import CONTRACT, STORED, Keys, name_of, named, wild
from services.wire.messages import MESSAGES


def test_every_key_lies_under_its_cell() -> None:
    keys = Keys("bench-2")
    assert keys.of("ft") == "treenail/bench-2/ft"
    assert keys.alive("agent") == "treenail/bench-2/alive/agent"
    assert keys.alive("*") == "treenail/bench-2/alive/*"
    assert keys.heartbeat("agent") == "treenail/bench-2/heartbeat/agent"
    assert keys.run_record("r-s0") == "treenail/bench-2/journal/r-s0/run"
    assert keys.journal_latest("r-s0") == "treenail/bench-2/journal/r-s0/latest"
    assert keys.checkpoint("r-s0", "agent", 40) == "treenail/bench-2/checkpoint/r-s0/agent/00000040"
    assert keys.checkpoint_latest("r-s0", "agent") == "treenail/bench-2/checkpoint/r-s0/agent/latest"


@pytest.mark.parametrize(
    ("episode", "place"),
    [
        (0, "000000/00000000"),
        (99, "000000/00000099"),
        (100, "000001/00000100"),
        (199, "000001/00000199"),
        (1_234_567, "012345/01234567"),
    ],
)
def test_an_episode_has_its_place_in_a_block(episode: int, place: str) -> None:
    assert Keys("a").journal("r", episode) == f"treenail/a/journal/r/{place}"


@given(st.lists(st.integers(0, 10**6), min_size=2, max_size=5, unique=True))
def test_journal_keys_sort_like_their_episodes(episodes: list[int]) -> None:
    keys = Keys("a")
    assert sorted(keys.journal("r", episode) for episode in episodes) == [
        keys.journal("r", episode) for episode in sorted(episodes)
    ]


@pytest.mark.parametrize("cell", ["a", "0", "a-b_c", "z" * 32])
def test_a_good_cell_name_is_taken(cell: str) -> None:
    assert Keys(cell).cell == cell


@pytest.mark.parametrize(
    "cell", ["", "A", "-a", "_a", "a/b", "a*", "**", "a b", "a\n", "ä", "z" * 33, "a?b", "a#", "$*"]
)
def test_a_bad_cell_name_is_refused(cell: str) -> None:
    with pytest.raises(TreenailError, match=r"^cell: expected 1 to 32 of a-z 0-9 - _"):
        Keys(cell)


@given(st.text(max_size=40))
def test_a_cell_name_that_is_taken_is_one_plain_part_of_a_key(cell: str) -> None:
    try:
        key = Keys(cell).of("ft")
    except TreenailError:
        return
    assert set(cell) <= set(string.ascii_lowercase + string.digits + "-_")
    assert key.split("/") == ["treenail", cell, "ft"]


def test_the_contract_names_only_types_that_exist() -> None:
    for key, row in CONTRACT.items():
        assert set(row.types) <= set(MESSAGES), key


PARTS: dict[str, str | int] = {
    "run": "0123456789abcdef-s7",
    "service": "agent",
    "episode": 12_345,
    "sha256": "0f" * 32,
    "instance": "01-2",
}


@pytest.mark.parametrize("pattern", CONTRACT)
def test_every_key_of_the_contract_is_told_by_its_name(pattern: str) -> None:
    name = name_of(pattern, **PARTS)
    key = named(name)
    assert key is not None and key.pattern == pattern
    assert all(str(PARTS[part]) in value for part, value in key.parts.items() if part != "block")
    assert zenoh.KeyExpr(wild(pattern)).includes(zenoh.KeyExpr(name))
    assert (CONTRACT[pattern].kind == "put, query") == any(
        zenoh.KeyExpr(stored).includes(zenoh.KeyExpr(name)) for stored in STORED
    )


@pytest.mark.parametrize(
    "name",
    [
        "",
        "journal",
        "journal/r-s0/swaps",
        "journal/r-s0/000001/00000007",  # of another block
        "journal/r-s0/000000/7",
        "journal/R/run",
        "checkpoint/r-s0/agent/newest",
        "checkpoint/skill/abc",
        "checkpoint/junk",
        "ft/x",
        "run\n",
    ],
)
def test_any_other_name_is_none_of_the_contract(name: str) -> None:
    assert named(name) is None
