"""Counts and loads: golden vectors both ways, and two independent implementations that must agree on every bit."""

from __future__ import annotations

import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.rules.ft_counts import UNITS, CountsError, FtCounts
from services.sensor_jr3.emulator.loads import nearest_counts

SCALES = (65, 65, 130, 50, 50, 50)
NEWTONS = FtCounts("1", SCALES)
POUNDS = FtCounts("0", (15, 15, 30, 50, 50, 50))


def test_golden_force_in_newtons() -> None:
    force_n, _ = NEWTONS.read((0, 0, 2048, 0, 0, 0))
    assert force_n == (0.0, 0.0, 16.25)
    assert NEWTONS.count((0.0, 0.0, 16.25), (0.0, 0.0, 0.0)).counts == (0, 0, 2048, 0, 0, 0)


def test_golden_moment_is_newton_metres_times_ten_in_the_card() -> None:
    # 33.85 is what a reader who forgets the ten takes for N m, as the thesis very probably did.
    _, torque_nm = NEWTONS.read((0, 0, 0, 11092, 0, 0))
    assert torque_nm[0] == 11092 * 50 / 163840
    assert round(torque_nm[0], 3) == 3.385
    assert NEWTONS.count((0.0, 0.0, 0.0), (3.385, 0.0, 0.0)).counts[3] == 11092


def test_golden_pounds() -> None:
    force_n, _ = POUNDS.read((-16384, 0, 0, 0, 0, 0))
    assert round(force_n[0], 2) == -66.72
    assert POUNDS.count((-66.72, 0.0, 0.0), (0.0, 0.0, 0.0)).counts[0] == -16383  # 66.72 is rounded, 66.7233 is not
    assert POUNDS.count(force_n, (0.0, 0.0, 0.0)).counts[0] == -16384


@pytest.mark.parametrize(
    ("units", "force_n", "torque_nm"),
    [
        ("0", 4.4482216152605, 0.1129848290276167),
        ("1", 1.0, 0.1),
        ("2", 0.980665, 0.0980665),
        ("2-kgf", 9.80665, 0.0980665),
        ("3", 4448.2216152605, 112.9848290276167),
    ],
)
def test_one_unit_at_full_scale(units: str, force_n: float, torque_nm: float) -> None:
    force, torque = FtCounts(units, (1, 1, 1, 1, 1, 1)).read((16384,) * 6)
    assert force == (force_n,) * 3
    assert torque == (torque_nm,) * 3


@given(
    st.sampled_from(["0", "1", "2", "3"]),
    st.lists(st.integers(1, 32767), min_size=6, max_size=6),
    st.lists(st.integers(-32768, 32767), min_size=6, max_size=6),
)
def test_what_was_read_counts_as_what_it_was(units: str, scales: list[int], counts: list[int]) -> None:
    scale = FtCounts(units, tuple(scales))
    force_n, torque_nm = scale.read(counts)
    assert scale.count(force_n, torque_nm).counts == tuple(counts)
    assert nearest_counts((*force_n, *torque_nm), scales, int(units)) == counts
    again_force_n, again_torque_nm, _ = scale.quantised(force_n, torque_nm)
    assert (again_force_n, again_torque_nm) == (force_n, torque_nm)


@given(
    st.sampled_from(["0", "1", "2", "3"]),
    st.lists(st.floats(-200.0, 200.0), min_size=6, max_size=6),
)
def test_driver_s_and_emulator_s_arithmetic_agree_on_every_load(units: str, load: list[float]) -> None:
    scales = (70, 70, 140, 60, 60, 60)
    counted = FtCounts(units, scales).count(load[:3], load[3:])
    found = nearest_counts((load[0], load[1], load[2], load[3], load[4], load[5]), scales, int(units))
    assert counted.counts == tuple(max(-32768, min(32767, count)) for count in found)
    assert counted.saturated == any(abs(count) >= 32764 for count in found)


def test_a_load_between_two_counts_takes_the_even_one() -> None:
    half = 65 / 16384 / 2
    assert [NEWTONS.count((half * k, 0.0, 0.0), (0.0, 0.0, 0.0)).counts[0] for k in (1, 3, 5, -1, -3)] == [
        0,
        2,
        2,
        0,
        -2,
    ]


@given(st.integers(-32768, 32767), st.integers(1, 32767))
def test_a_count_reads_as_the_nearest_float_there_is(count: int, scale: int) -> None:
    force_n, torque_nm = FtCounts("0", (scale,) * 6).read((count,) * 6)
    pound_n = Fraction("4.4482216152605")
    for value, worth in ((force_n[0], pound_n), (torque_nm[0], pound_n * Fraction("0.0254"))):
        exact = Fraction(count * scale, 16384) * worth
        for other in (math.nextafter(value, math.inf), math.nextafter(value, -math.inf)):
            assert abs(Fraction(value) - exact) <= abs(Fraction(other) - exact)


def test_saturation_is_told_and_never_clipped_in_silence() -> None:
    least = 32764 * 65 / 16384
    for force_n, saturated in ((least, True), (32763 * 65 / 16384, False), (-least, True), (1e4, True)):
        counted = NEWTONS.count((force_n, 0.0, 0.0), (0.0, 0.0, 0.0))
        assert counted.saturated is saturated
    assert NEWTONS.count((1e4, -1e4, 0.0), (0.0, 0.0, 0.0)).counts[:2] == (32767, -32768)


def test_a_resolution_is_what_the_page_says() -> None:
    force_n, torque_nm = NEWTONS.read((1, 1, 1, 1, 1, 1))
    assert (round(force_n[0] * 1e3, 2), round(force_n[2] * 1e3, 2), round(torque_nm[0] * 1e3, 3)) == (3.97, 7.93, 0.305)


@pytest.mark.parametrize(
    ("units", "scales", "bits", "message"),
    [
        ("4", SCALES, 14, "units: expected one of"),
        ("1", (65, 65, 130, 50, 50), 14, "full scales: expected six"),
        ("1", (0, 65, 130, 50, 50, 50), 14, "full scales"),
        ("1", (40000, 65, 130, 50, 50, 50), 14, "full scales"),
        ("1", SCALES, 17, "ADC bits: expected 8 to 16, got 17"),
    ],
)
def test_scales_that_no_card_has_are_refused(units: str, scales: tuple[int, ...], bits: int, message: str) -> None:
    with pytest.raises(CountsError, match=message):
        FtCounts(units, scales, bits)


def test_every_unit_says_how_sure_it_is() -> None:
    assert {name: unit.confidence for name, unit in UNITS.items()} == {
        "0": "S",
        "1": "S",
        "2": "L",
        "2-kgf": "L",
        "3": "L",
    }
