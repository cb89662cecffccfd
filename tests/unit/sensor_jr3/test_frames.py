"""Transforms of the card and the mounting in the wrist: golden words, signs, and what is refused."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.rules import mount
from services.rules.mount import Mount
from services.rules.settings import SettingError
from services.sensor_jr3 import transform
from services.sensor_jr3.emulator.loads import transformed
from services.sensor_jr3.transform import Link

TENTH_MM = Fraction(1, 10)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", [0]),
        ("RX 45", [4, 0x2000, 0]),  # an integer division that truncates gives 1FFF: 44.99 deg
        ("RY -90", [5, 0xC000, 0]),
        ("RZ 180", [6, 0x8000, 0]),
        ("RZ -180", [6, 0x8000, 0]),
        ("TZ 12.5, RX 180", [3, 125, 4, 0x8000, 0]),
        ("tx -0.1", [1, 0xFFFF, 0]),
        ("NEG", [7, 0, 0]),
    ],
)
def test_links_become_words(text: str, words: list[int]) -> None:
    assert transform.words(transform.parse(text), TENTH_MM) == words


def test_a_translation_is_in_the_card_s_unit_of_length() -> None:
    assert transform.words((Link(3, 25.4),), Fraction("0.0254")) == [3, 1000, 0]


@pytest.mark.parametrize(
    "text", ["XX 3", "RX", "RX fast", "NEG 3", "RX 181", "RX nan", "TX 4000", ", ".join(["RX 1"] * 8)]
)
def test_links_that_no_slot_holds_are_refused(text: str) -> None:
    with pytest.raises(SettingError, match="transform: "):
        transform.words(transform.parse(text), TENTH_MM)


def test_a_mounting_of_nothing_passes_every_bit() -> None:
    force_n, torque_nm = (0.1, -0.0, 3.0), (1e-300, 2.0, -7.0)
    found = Mount().to_tool(force_n, torque_nm)
    assert repr(found) == repr((force_n, torque_nm))


def test_a_quarter_turn_is_exact() -> None:
    # The sensor's x axis points along the tool's y.
    force_n, torque_nm = Mount(rz_deg=90.0).to_tool((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))
    assert force_n == (-2.0, 1.0, 3.0)
    assert torque_nm == (-5.0, 4.0, 6.0)


def test_turns_are_made_one_after_another_about_their_own_axes() -> None:
    force_n, _ = Mount(rx_deg=90.0, rz_deg=90.0).to_tool((1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert force_n == (0.0, 0.0, 1.0)


def test_another_point_of_reference_takes_the_lever_s_torque_away() -> None:
    # 10 N along x, felt 50 mm above the sensor's origin: 0.5 N m about y there, nothing at the point itself.
    _, torque_nm = Mount(z_mm=50.0).to_tool((10.0, 0.0, 0.0), (0.0, 0.5, 0.0))
    assert torque_nm == pytest.approx((0.0, 0.0, 0.0))


THREE = st.tuples(*[st.floats(-100.0, 100.0)] * 3)


@given(THREE, THREE, THREE)
def test_torques_about_another_point_are_those_of_the_cross_product(
    point_mm: tuple[float, float, float], force_n: tuple[float, float, float], torque_nm: tuple[float, float, float]
) -> None:
    expected = np.subtract(torque_nm, np.cross(np.multiply(point_mm, 1e-3), force_n))
    assert Mount(*point_mm).to_tool(force_n, torque_nm)[1] == pytest.approx(tuple(expected), abs=1e-9)
    # The card's own translations, of 0.1 mm in unit code 1, mean the same.
    links = [(1 + axis, round(10 * one)) for axis, one in enumerate(point_mm)]
    expected = np.subtract(torque_nm, np.cross([amount * 1e-4 for _, amount in links], force_n))
    assert transformed((*force_n, *torque_nm), links, 1)[3:] == pytest.approx(tuple(expected), abs=1e-9)


def test_negate_turns_all_signs() -> None:
    assert Mount(negate=True).to_tool((1.0, -2.0, 3.0), (4.0, 5.0, -6.0)) == ((-1.0, 2.0, -3.0), (-4.0, -5.0, 6.0))


@given(
    st.tuples(*[st.floats(-180.0, 180.0)] * 3),
    st.tuples(*[st.floats(-100.0, 100.0)] * 3),
)
def test_no_turn_changes_a_magnitude(turn: tuple[float, float, float], force_n: tuple[float, float, float]) -> None:
    found, _ = Mount(0.0, 0.0, 0.0, *turn).to_tool(force_n, (0.0, 0.0, 0.0))
    assert math.hypot(*found) == pytest.approx(math.hypot(*force_n), abs=1e-9)


def test_a_mounting_is_read_from_text() -> None:
    assert mount.parse("0,0,12.5,0,90,0", True) == Mount(0.0, 0.0, 12.5, 0.0, 90.0, 0.0, True)


@pytest.mark.parametrize("text", ["", "1,2,3", "a,0,0,0,0,0", "0,0,2000,0,0,0", "0,0,0,0,0,400", "nan,0,0,0,0,0"])
def test_a_mounting_that_cannot_be_is_refused(text: str) -> None:
    with pytest.raises(SettingError, match="mount: expected x,y,z,rx,ry,rz"):
        mount.parse(text, False)
