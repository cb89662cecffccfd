"""A campaign's plan is a function of its seed, and holds what was asked for."""

from __future__ import annotations

from collections import Counter

import pytest

from experiments.chaos.plan import FAR, KILLING, KINDS, LATEST, LINK, MOST_AT_ONCE, SERVICES, make
from services.wire.errors import TreenailError


def test_the_same_seed_gives_the_same_plan() -> None:
    assert make(7, 50, 3) == make(7, 50, 3)
    assert make(7, 50, 3) != make(8, 50, 3)


@pytest.mark.parametrize(("seed", "kills", "others"), [(0, 20, 1), (1, 1, 1), (2, 500, 10), (3, 13, 0), (4, 0, 2)])
def test_it_holds_what_was_asked_for(seed: int, kills: int, others: int) -> None:
    plan = make(seed, kills, others)
    assert plan.kills == kills
    counts = Counter(one.kind for one in plan.disturbances)
    assert {kind: counts[kind] for kind in KINDS if kind not in KILLING} == dict.fromkeys(
        (kind for kind in KINDS if kind not in KILLING), others
    )
    assert all(1 <= one.after <= LATEST for one in plan.disturbances)
    assert all(len(section.disturbances) <= MOST_AT_ONCE for section in plan.sections)


def test_nobody_is_spared() -> None:
    victims = Counter(name for one in make(3, 100, 0).disturbances if one.kind == "kill" for name in one.victims)
    assert set(victims) == set(SERVICES)
    assert max(victims.values()) - min(victims.values()) <= 1


def test_several_at_once_are_several_others() -> None:
    plan = make(5, 200, 0)
    several = [one.victims for one in plan.disturbances if one.kind in ("several", "again")]
    assert several
    assert all(len(set(victims)) == len(victims) >= 2 for victims in several)


def test_messages_are_hit_behind_a_tap_and_cells_without_one_are_disturbed_too() -> None:
    plan = make(6, 200, 5)
    for section in plan.sections:
        assert section.far in (None, *FAR)
        assert section.far is not None or not {one.kind for one in section.disturbances} & set(LINK)
        assert any(one.killed for one in section.disturbances)
    assert {section.far for section in plan.sections} >= {None, "agent", "classifier"}


def test_only_what_is_named_is_done() -> None:
    plan = make(1, 9, 2, ["kill", "cut"], ["agent", "store"])
    assert Counter(one.kind for one in plan.disturbances) == {"kill": 9, "cut": 2}
    assert {name for one in plan.disturbances for name in one.victims} == {"agent", "store"}
    assert all(section.far is None for section in make(1, 9, 2, ["kill", "freeze"]).sections)
    assert make(1, 9, 0, ["several"]).kills in (9, 10)


@pytest.mark.parametrize(
    ("kills", "others", "kinds", "services", "expected"),
    [
        (1, 1, ["kill", "flood"], ["agent"], "--kinds: expected some of kill, several, .*got kill, flood"),
        (1, 1, ["kill", "kill"], ["agent"], "--kinds: .* each once"),
        (1, 1, ["kill"], ["robot"], "--services: expected some of router, .*got robot"),
        (-1, 1, ["kill"], ["agent"], "--kills and --others: expected 0 or more, got -1 and 1"),
        (0, 1, ["kill"], ["agent"], "expected something to do"),
    ],
)
def test_what_cannot_be_planned_is_refused(
    kills: int, others: int, kinds: list[str], services: list[str], expected: str
) -> None:
    with pytest.raises(TreenailError, match=expected):
        make(0, kills, others, kinds, services)
