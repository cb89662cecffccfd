"""The emulated DSP does what the public facts say, and shares no arithmetic with the driver."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import services.sensor_jr3.emulator.loads as loads_module
from services.rules.settings import SettingError
from services.sensor_jr3 import memory_map as jr3
from services.sensor_jr3.emulator.__main__ import constant_load
from services.sensor_jr3.emulator.card import EmulatedCard
from services.sensor_jr3.emulator.dsp import Dsp, Sensor
from services.sensor_jr3.emulator.loads import COLUMNS, recording, transformed
from services.sensor_jr3.stream import pace_of

FOLDER = Path(loads_module.__file__).parent
FORBIDDEN = {
    "services.rules.ft_counts",
    "services.rules.mount",
    "services.sensor_jr3.transform",
    "services.sensor_jr3.stream",
}


def counts(bench: Any, number: int) -> list[int]:
    return [word - 65536 if word >= 32768 else word for word in bench.read(jr3.filter_address(number), 6)]


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.py")), ids=lambda path: str(path.name))
def test_it_imports_nothing_that_the_driver_reckons_with(path: Path) -> None:
    modules = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            modules |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
    assert not modules & FORBIDDEN
    assert not any(name.startswith("services.sensor_jr3.driver") for name in modules)


def test_filter_0_shows_a_load_at_once(bench: Callable[..., Any]) -> None:
    card = bench()
    card.dsp.set_load((0.0, 0.0, 16.25, 3.385, 0.0, 0.0))
    assert counts(card, 0) == [0, 0, 2048, 11092, 0, 0]
    assert counts(card, 1) == [0] * 6


@pytest.mark.parametrize("number", [1, 2, 3])
def test_a_filter_lets_half_the_power_through_at_its_cut_off(bench: Callable[..., Any], number: int) -> None:
    card = bench()
    cut_off_hz = 500.0 / 4 ** (number - 1)
    amplitude, peak = 60.0, 0
    steps = round(8000 / cut_off_hz)
    for step in range(12 * steps):
        card.dsp.set_load((amplitude * math.sin(2 * math.pi * cut_off_hz * step / 8000), 0.0, 0.0, 0.0, 0.0, 0.0))
        card.dsp.step()
        if step >= 8 * steps:
            peak = max(peak, abs(counts(card, number)[0]))
    # Each filter also goes through those before it, of four times the cut-off each.
    share = peak / (amplitude / 65 * 16384)
    assert 0.62 < share < 0.75


@pytest.mark.parametrize("number", range(1, 7))
def test_every_filter_gets_there_in_the_end_exactly(bench: Callable[..., Any], number: int) -> None:
    card = bench()
    card.dsp.set_load((6.5, -6.5, 13.0, 0.5, -0.5, 5.0))
    card.go(0.01 * 4 ** (number - 1))
    assert counts(card, number) == counts(card, 0) == [1638, -1638, 1638, 1638, -1638, 16384]


def test_a_slower_filter_lags_behind_a_faster_one(bench: Callable[..., Any]) -> None:
    card = bench()
    card.dsp.set_load((32.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    card.go(0.01)
    shown = [counts(card, number)[0] for number in range(7)]
    assert shown == sorted(shown, reverse=True)
    assert shown[0] > shown[3] > shown[5] >= 0


def test_counters_step_at_a_quarter_of_the_one_before_and_wrap(bench: Callable[..., Any]) -> None:
    card = bench()
    card.go(0.512)
    assert card.read(jr3.counter_address(1), 6) == [4096, 1024, 256, 64, 16, 4]
    card.dsp.skip(65536 - 4096)
    assert card.read(jr3.counter_address(1), 6) == [0, 16384, 4096, 1024, 256, 64]
    card.go(0.001)
    assert card.read(jr3.counter_address(1), 1) == [8]


def test_commands_take_their_time_and_say_busy(bench: Callable[..., Any]) -> None:
    card = bench()
    card.write(0xE7, 0x0500)
    assert card.read(0xE7, 1) == [0x0500]
    assert card.read(0xF1, 1) == [jr3.BUSY]
    card.go(0.003)
    assert card.read(0xE7, 1) == [0x0500]
    card.go(0.002)
    assert card.read(0xE7, 1) == [0]
    assert card.read(0xF1, 1) == [0]


@pytest.mark.parametrize("code", [0x0001, 0x0510, 0x0610, 0x0701, 0x0B00, 0x7F00])
def test_an_unknown_command_ends_in_a_negative_number(bench: Callable[..., Any], code: int) -> None:
    card = bench()
    card.write(0xE7, code)
    card.go(0.01)
    assert card.read(0xE7, 1)[0] >= 0x8000


def test_saturation_is_of_the_raw_channels_not_of_what_is_shown(bench: Callable[..., Any]) -> None:
    card = bench()
    card.dsp.set_load((120.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    card.write(0xE7, jr3.RESET_OFFSETS)
    card.go(0.01)
    assert counts(card, 0)[0] == 0
    assert card.read(0xF0, 2) == [1, 0], "near saturation, though it shows no load"
    card.dsp.set_load((131.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert card.read(0xF0, 2) == [1, 1]


def test_words_of_the_dsp_cannot_be_written(bench: Callable[..., Any]) -> None:
    card = bench()
    for address in (0x90, 0xF5, 0xF8, 0xFC, 0xE8):
        before = card.read(address, 1)
        card.write(address, 77)
        assert card.read(address, 1) == before


def test_the_copyright_is_in_the_high_bytes(bench: Callable[..., Any]) -> None:
    found = bench().read(0x40, 4)
    assert [word & 0xFF for word in found] == [0] * 4
    assert bytes(word >> 8 for word in found) == b"C EM"


def test_version_is_in_hundredths(bench: Callable[..., Any]) -> None:
    assert bench().read(0xF5, 1) == [0x012E]  # 3.02


def test_vectors_are_magnitudes(bench: Callable[..., Any]) -> None:
    card = bench(full_scales=(100, 100, 100, 50, 50, 50))
    card.dsp.set_load((30.0, 40.0, 0.0, 0.0, 0.3, 0.4))
    force, moment = card.read(0x96, 2)
    assert (force, moment) == (8192, 1639)  # 983 and 1311 counts: of the words, not of the load


def test_a_sensor_put_in_anew_calibrates_and_zeroes_itself(bench: Callable[..., Any]) -> None:
    card = bench(calibration_steps=80, zeroes_itself=True)
    card.dsp.set_load((10.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    card.fault("pull")
    card.go(0.001)
    before = card.read(jr3.counter_address(1), 1)
    assert card.read(0xF1, 1)[0] & jr3.WATCHDOG
    card.go(0.01)
    assert card.read(jr3.counter_address(1), 1) == before
    card.fault("pull", 0)
    card.go(0.005)
    assert card.read(0xF1, 1) == [jr3.CALIBRATION_BAD]
    assert card.read(0xF8, 2) == [0, 0]
    card.go(0.006)
    assert card.read(0xF1, 1) == [0]
    assert card.read(0xF8, 2) == [4711, 1205]
    assert counts(card, 0)[0] == 0


def test_another_sensor_leaves_a_bit_that_stays_until_it_is_cleared(bench: Callable[..., Any]) -> None:
    card = bench(calibration_steps=0)
    card.fault("change")
    card.go(0.01)
    assert card.read(0xF1, 1) == [jr3.SENSOR_CHANGED]
    assert card.read(0xF8, 1) != [4711]
    card.write(0xF1, 0)
    assert card.read(0xF1, 1) == [0]


def test_no_card_reads_ffff_and_takes_nothing(bench: Callable[..., Any]) -> None:
    card = bench()
    card.fault("no_card")
    card.write(0x88, 5)
    assert card.read(0, 0x400) == [0xFFFF] * 0x400
    card.fault("no_card", 0)
    assert card.read(0x88, 1) == [0]


def test_a_zero_stays_zero_in_new_axes_and_full_scales(bench: Callable[..., Any]) -> None:
    card = bench()
    card.dsp.set_load((10.0, 20.0, 30.0, 1.0, 2.0, 3.0))
    card.write(0xE7, jr3.RESET_OFFSETS)
    card.go(0.01)
    for at, word in enumerate([6, 0x4000, 3, 100, 0]):
        card.write(0x200 + at, word)
    card.write(0xE7, jr3.USE_TRANSFORM)
    card.go(0.01)
    assert all(abs(count) <= 2 for count in counts(card, 0))
    for at, word in enumerate([130, 130, 260, 100, 100, 100]):
        card.write(0x80 + at, word)
    card.write(0xE7, jr3.SET_FULL_SCALES)
    card.go(0.01)
    assert all(abs(count) <= 2 for count in counts(card, 0))


def test_links_move_turn_and_negate() -> None:
    load = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    # 100 mm up along z, a force along x has a torque of -0.1 N m about y there.
    assert transformed(load, [(3, 1000)], 1) == pytest.approx((1.0, 0.0, 0.0, 0.0, -0.1, 0.0))
    assert transformed(load, [(6, 0x4000)], 1) == pytest.approx((0.0, -1.0, 0.0, 0.0, 0.0, 0.0))
    assert transformed(load, [(7, 0)], 1) == (-1.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def test_a_recording_is_played_and_its_last_line_holds(tmp_path: Path) -> None:
    file = tmp_path / "load.csv"
    text = f"{','.join(COLUMNS)}\n0.5,1,0,0,0,0,0\n1.0,2,0,0,0,0,0.5\n\n"
    file.write_text(text, encoding="utf-8-sig")  # with the mark and the blank line of an editor
    played = recording(file)
    assert [played.at(t_s)[0] for t_s in (0.0, 0.5, 0.99, 1.0, 100.0)] == [0.0, 1.0, 1.0, 2.0, 2.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "line 1: expected t_s,fx_n"),
        ("a,b\n", "line 1: expected t_s,fx_n"),
        (f"{','.join(COLUMNS)}\n0,1,2\n", "line 2: expected 7 numbers with commas between, got 3"),
        (f"{','.join(COLUMNS)}\n1,0,0,0,0,0,0\n0.5,0,0,0,0,0,0\n", "line 3: expected times that rise from 0, got 0.5"),
        (f"{','.join(COLUMNS)}\n0,nan,0,0,0,0,0\n", "line 2"),
        (f"{','.join(COLUMNS)}\n0,1_0,0,0,0,0,0\n", "line 2: expected a number, such as -1.5, got '1_0'"),
        (f"{','.join(COLUMNS)}\n", "expected a load below the columns' names"),
    ],
)
def test_a_recording_that_cannot_be_played_is_refused(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "load.csv"
    file.write_text(text)
    with pytest.raises(SettingError, match=message):
        recording(file)


def test_a_constant_load_is_any_six_numbers() -> None:
    assert constant_load("0,0,0,0,0,0") == (0.0,) * 6
    assert constant_load("1,-2e1, .5,0,0,0") == (1.0, -20.0, 0.5, 0.0, 0.0, 0.0)
    for text in ("0,0,0", "", "1_0,0,0,0,0,0", "nan,0,0,0,0,0", "1e6,0,0,0,0,0"):
        with pytest.raises(SettingError, match=r"^--load: expected "):
            constant_load(text)


@pytest.mark.parametrize("rate_hz", [500, 1000, 8000])
def test_samples_of_a_motion_are_played_one_for_each_that_is_taken_at_that_rate(rate_hz: int) -> None:
    now_s = [0.0]
    card = EmulatedCard(Dsp(Sensor(full_scales=(200,) * 6, calibration_steps=0)), clock=lambda: now_s[0])
    pace = pace_of(rate_hz)
    address, data = jr3.counter_address(pace.counter), jr3.filter_address(0)
    card.collect(address, data, 0.0)
    played = [(200 * number / 16384, 0.0, 0.0, 0.0, 0.0, 0.0) for number in range(5)]
    card.play(played, rate_hz)
    now_s[0] += 23 / rate_hz
    taken = [sample.counts[0] for sample in card.collect(address, data, 0.0).samples][:: pace.every]
    assert len(taken) >= 20
    assert taken[1:21] == [(taken[1] + number) % 5 for number in range(20)], "each once in a round, none left out"


def test_filters_that_nobody_reads_may_stand_still() -> None:
    still, moving = (Dsp(Sensor(filters=filters)) for filters in (False, True))
    for dsp in (still, moving):
        dsp.set_load((30.0, 0.0, 0.0, 0.0, 0.0, 0.0))
        for _ in range(100):
            dsp.step()
    assert counts(still, 0) == counts(moving, 0)
    assert counts(still, 1) == [0] * 6 != counts(moving, 1)
