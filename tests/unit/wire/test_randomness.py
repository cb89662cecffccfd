"""What is drawn depends on seed, role, episode and step, and on nothing else."""

from __future__ import annotations

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.wire.randomness import MAX_SEED, Draws, Role, generator

places = st.tuples(st.integers(0, MAX_SEED), st.sampled_from(Role), st.integers(0, 2**31), st.integers(0, 2**31))

GOLDEN = [
    (0, Role.START_POSE, 0, 0, ("0x1.a06ff187f343ap-1", "0x1.a43d64173eee8p-2", "0x1.4da8659bc3c05p-3")),
    (0, Role.POLICY, 0, 0, ("0x1.e6901f787b486p-2", "-0x1.9c7d1ca4c05fep-1", "-0x1.089cfcd3605abp-1")),
    (1, Role.POLICY, 7, 12, ("0x1.63a9bc9475d48p-2", "0x1.4455ca5192cb2p-1", "-0x1.0c49cda5c2eecp+0")),
    (
        MAX_SEED,
        Role.SENSOR_NOISE,
        1_000_000,
        100_000,
        ("0x1.a2e0190d52afcp-1", "-0x1.be0592262c9c8p-1", "0x1.067e036616d14p-2"),
    ),
]
"""Uniform and normal numbers that a run's bytes rest on; they change only if NumPy changes what it draws."""


@pytest.mark.parametrize(("seed", "role", "episode", "step", "expected"), GOLDEN)
def test_numbers_are_what_they_always_were(
    seed: int, role: Role, episode: int, step: int, expected: tuple[str, str, str]
) -> None:
    uniform = generator(seed, role, episode, step).random()
    spread = generator(seed, role, episode, step).uniform(-1.0, 1.0, size=5).tolist()[4]
    normal = generator(seed, role, episode, step).standard_normal(6).tolist()[5]
    assert (uniform.hex(), spread.hex(), normal.hex()) == expected


@given(
    st.integers(0, MAX_SEED), st.sampled_from(Role), st.lists(st.tuples(*[st.integers(0, MAX_SEED)] * 2), min_size=1)
)
def test_draws_of_a_role_are_those_of_its_generators(seed: int, role: Role, asked: list[tuple[int, int]]) -> None:
    draws = Draws(seed, role)
    for number, (episode, step) in enumerate(asked):
        drawn, expected = draws.at(episode, step), generator(seed, role, episode, step)
        # 32-bit numbers leave half a word behind, which the next place must not find.
        assert drawn.integers(0, 9, size=3, dtype="int32").tolist() == expected.integers(0, 9, 3, "int32").tolist()
        assert drawn.standard_normal(number).tolist() == expected.standard_normal(number).tolist()
        assert drawn.random() == expected.random()


@given(st.lists(places, min_size=2, max_size=6))
def test_the_order_of_asking_does_not_matter(asked: list[tuple[int, Role, int, int]]) -> None:
    forwards = [generator(*place).random(3).tolist() for place in asked]
    backwards = [generator(*place).random(3).tolist() for place in reversed(asked)]
    assert forwards == backwards[::-1]


@given(places)
def test_drawing_from_one_generator_does_not_move_another(place: tuple[int, Role, int, int]) -> None:
    one, other = generator(*place), generator(*place)
    one.random(100)
    assert other.random() == generator(*place).random()


@given(places, places)
def test_another_place_gives_other_numbers(one: tuple[int, Role, int, int], other: tuple[int, Role, int, int]) -> None:
    same = generator(*one).random(4).tolist() == generator(*other).random(4).tolist()
    assert same == (one == other)


def test_neighbours_share_no_number() -> None:
    """The counter's low words are free, so that no draw of one step runs into the next one's."""
    around = itertools.product((0, 1), Role, (0, 1, 2), (0, 1, 2))
    drawn = [value for place in around for value in generator(*place).random(50).tolist()]
    assert len(set(drawn)) == len(drawn)


def test_large_seeds_that_differ_by_one_give_other_numbers() -> None:
    for seed in (2**53, 2**62, MAX_SEED - 1):
        assert generator(seed, Role.POLICY, 0, 0).random() != generator(seed + 1, Role.POLICY, 0, 0).random()


@pytest.mark.parametrize(("seed", "episode", "step"), [(-1, 0, 0), (MAX_SEED + 1, 0, 0), (0, -1, 0), (0, 0, -1)])
def test_a_number_out_of_range_is_refused(seed: int, episode: int, step: int) -> None:
    with pytest.raises(ValueError):
        generator(seed, Role.POLICY, episode, step)
    with pytest.raises(ValueError):
        Draws(seed, Role.POLICY).at(episode, step)
