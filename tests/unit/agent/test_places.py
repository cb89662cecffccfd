"""Visits of places by dead reckoning over moves."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from services.agent.places import Places
from services.wire.actions import increments
from services.wire.definition import Moves, NamedMove

PLUS_X, MINUS_X, PLUS_Y, MINUS_Y, INSERT = range(5)


def visits(places: Places, episode: int = 0) -> list[int]:
    return [int(count) for count in places.ahead(episode)]


def test_a_place_is_visited_when_a_move_leads_to_it() -> None:
    places = Places(Moves())
    assert visits(places) == [0] * 9
    for action in (PLUS_X, MINUS_X, PLUS_X, PLUS_Y):
        places.took(action)
    assert visits(places) == [0, 0, 0, 2, 0, 0, 0, 0, 0]
    for action in (MINUS_X, INSERT):
        places.took(action)
    assert visits(places) == [0] * 9  # one deeper, nothing was visited


def test_an_episode_begins_with_no_place_visited() -> None:
    places = Places(Moves())
    places.ahead(3)
    for action in (PLUS_X, MINUS_X):
        places.took(action)
    assert visits(places, 3)[PLUS_X] == 1
    assert visits(places, 4) == [0] * 9


def test_moves_of_any_size_and_in_several_axes_add_up() -> None:
    moves = Moves(
        list=(
            NamedMove(name="far", x_mm=0.3, z_mm=-0.1),
            NamedMove(name="near", x_mm=0.1),
            NamedMove(name="back", x_mm=-0.1),
            NamedMove(name="in", z_mm=0.1),
            NamedMove(name="turn", ry_deg=0.25),
        )
    )
    places = Places(moves)
    assert visits(places) == [0] * 5
    for action in (0, 3, 2, 2):  # to 0.1 mm aside, over 0.3 and 0.2
        places.took(action)
    assert visits(places) == [0, 1, 0, 0, 0]
    places.took(4)
    assert visits(places) == [0] * 5


@given(st.lists(st.integers(0, 10), max_size=60))
def test_visits_are_those_of_the_sums_of_moves(made: list[int]) -> None:
    moves = Moves(actions=11)
    places, came_to = Places(moves), list[tuple[int, ...]]()
    steps = [tuple(round(10_000 * part) for part in step) for step in increments(moves)]
    here: tuple[int, ...] = (0,) * 6
    places.ahead(0)
    for action in made:
        places.took(action)
        here = tuple(a + b for a, b in zip(here, steps[action], strict=True))
        came_to.append(here)
    after = [tuple(a + b for a, b in zip(here, step, strict=True)) for step in steps]
    assert visits(places) == [came_to.count(place) for place in after]
