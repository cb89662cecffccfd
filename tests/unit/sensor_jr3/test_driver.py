"""The driver against the emulated DSP in virtual time: start-up, commands, faults; and against memory full of noise."""

from __future__ import annotations

import random
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.rules.settings import SettingError
from services.sensor_jr3 import memory_map as jr3
from services.sensor_jr3.card import ChangedError, CommandError, NoCardError, NoSensorError
from services.sensor_jr3.driver import COMMAND_TIMEOUT_S, Driver, Setup
from services.sensor_jr3.status import status_of
from services.sensor_jr3.transform import parse
from services.wire.errors import TreenailError

QUICK = Setup(settle_s=0.01, sensor_timeout_s=0.5)
LOAD = (1.0, -2.0, 16.25, 0.1, -0.2, 3.385)


def started(bench: Any, setup: Setup = QUICK) -> Driver:
    driver = Driver(bench, setup)
    bench.run(driver.start())
    return driver


def shown(bench: Any, driver: Driver, number: int = 0) -> tuple[float, ...]:
    words = bench.read(jr3.filter_address(number), 6)
    force_n, torque_nm = driver.scale.read([word - 65536 if word >= 32768 else word for word in words])
    return (*force_n, *torque_nm)


def test_start_up_goes_in_comedi_s_order(bench: Callable[..., Any]) -> None:
    card = bench()
    setup = Setup(
        full_scales=(60, 60, 120, 40, 40, 40), transform=parse("RX 45"), offset_set=2, zero="reset", settle_s=10.0
    )
    driver = started(card, setup)
    commands = [value for address, value in card.written if address == 0xE7]
    assert commands == [0x0500, 0x0A00, 0x0602, 0x0800]
    assert card.waited_s >= 10.0
    first_command = card.written.index((0xE7, 0x0500))
    assert card.written[0] == (0xF1, 0), "a change of sensor is noted before anything else"
    assert card.written[1:first_command] == [(0x200, 4), (0x201, 0x2000), (0x202, 0)]
    assert card.written[first_command + 1 : first_command + 7] == list(
        zip(range(0x80, 0x86), (60, 60, 120, 40, 40, 40), strict=True)
    )
    assert driver.scale.full_scales == (60, 60, 120, 40, 40, 40)
    assert all(address not in (0xE5, 0xE6) for address, _ in card.written)


def test_nothing_is_commanded_before_the_sensor_has_settled(bench: Callable[..., Any]) -> None:
    card = bench()
    waits = Driver(card, Setup(settle_s=10.0)).start()
    assert next(waits) == 10.0
    assert card.written == []


def test_a_load_is_read_in_si_units(bench: Callable[..., Any]) -> None:
    card = bench()
    driver = started(card)
    card.dsp.set_load(LOAD)
    assert shown(card, driver)[2] == 16.25
    assert all(abs(a - b) <= 130 / 16384 for a, b in zip(shown(card, driver), LOAD, strict=True))
    assert abs(shown(card, driver)[5] - 3.385) < 5.0 / 16384


@pytest.mark.parametrize("units", [0, 1, 2, 3])
def test_all_unit_codes_are_read_right(bench: Callable[..., Any], units: int) -> None:
    card = bench(units=units, full_scales=(10, 10, 10, 40, 40, 40) if units == 3 else (300, 300, 600, 900, 900, 900))
    driver = started(card)
    card.dsp.set_load(LOAD)
    unit = driver.scale.read((16384,) * 6)
    steps = [one / 16384 for one in (*unit[0], *unit[1])]
    assert all(abs(a - b) <= step for a, b, step in zip(shown(card, driver), LOAD, steps, strict=True))


def test_a_setting_overrules_the_card_s_unit_word(bench: Callable[..., Any]) -> None:
    card = bench(units=2)
    assert started(card, Setup(settle_s=0.0, units="2-kgf")).scale.units == "2-kgf"


@pytest.mark.parametrize("zero", ["reset", "filter0"])
def test_zeroing_takes_the_load_as_zero_and_only_it(bench: Callable[..., Any], zero: str) -> None:
    card = bench()
    card.dsp.set_load(LOAD)
    driver = started(card, Setup(settle_s=0.01, zero=zero))
    assert shown(card, driver) == (0.0,) * 6
    card.dsp.set_load((*LOAD[:2], LOAD[2] + 13.0, *LOAD[3:]))
    assert shown(card, driver)[:3] == pytest.approx((0.0, 0.0, 13.0), abs=0.009)


def test_offsets_are_set_used_and_refused(bench: Callable[..., Any]) -> None:
    card = bench()
    driver = started(card)
    card.run(driver.set_offsets([-100, 200, 300, 4, 5, 6]))
    assert card.read(0x90, 6) == [100, 0x10000 - 200, 0x10000 - 300, 0xFFFC, 0xFFFB, 0xFFFA]
    card.run(driver.command(jr3.USE_OFFSETS + 3))
    assert card.read(0x8E, 1) == [3]
    assert card.read(0x90, 6) == [0] * 6
    for wrong in ([0] * 5, [40000, 0, 0, 0, 0, 0]):
        with pytest.raises(SettingError, match="offsets: expected six"):
            card.run(driver.set_offsets(wrong))


def test_full_scales_are_got_set_and_bounded(bench: Callable[..., Any]) -> None:
    card = bench(full_scales=(4000, 4000, 4000, 4000, 4000, 4000))
    driver = started(card)
    assert driver.full_scales() == driver.default_full_scales() == (4000,) * 6
    assert driver.recommended_full_scales() == ((1000,) * 6, (8000,) * 6)
    card.run(driver.set_full_scales((4,) * 6))
    assert driver.full_scales() == (4,) * 6
    with pytest.raises(SettingError, match="full scale fx: expected 4 to 32767, got 3"):
        card.run(driver.set_full_scales((3,) * 6))


def test_a_transform_of_the_card_turns_what_it_shows(bench: Callable[..., Any]) -> None:
    card = bench()
    driver = started(card, Setup(settle_s=0.01, transform=parse("RZ 90")))
    card.dsp.set_load((6.5, 0.0, 0.0, 0.0, 0.0, 0.0))
    assert shown(card, driver)[:3] == pytest.approx((0.0, -6.5, 0.0), abs=0.005)
    assert card.read(0x77, 1) == [0]


def test_keep_leaves_the_card_as_it_is(bench: Callable[..., Any]) -> None:
    card = bench()
    started(card, Setup(full_scales="keep", transform=None, settle_s=0.0))
    assert card.written == [(0xF1, 0)]


# -- faults ------------------------------------------------------------------------------------------------------


def test_no_card_is_said_so_at_once(bench: Callable[..., Any]) -> None:
    card = bench()
    card.fault("no_card")
    with pytest.raises(NoCardError, match="expected a JR3 receiver, got FFFF everywhere"):
        started(card)
    assert card.waited_s == 0.0


def test_a_sensor_that_never_shows_up_is_waited_for_and_then_named(bench: Callable[..., Any]) -> None:
    card = bench()
    card.fault("pull")
    with pytest.raises(NoSensorError, match=r"C000: .*watchdog.*after 0.5 s"):
        started(card)
    assert 0.5 <= card.waited_s < 0.7


def test_a_sensor_whose_calibration_comes_in_is_waited_for(bench: Callable[..., Any]) -> None:
    card = bench()
    card.fault("change")
    driver = started(card)
    assert 0.1 <= card.waited_s < 0.5
    driver.check()
    assert card.read(0xF1, 1) == [0], "the change bit is taken note of"


def test_another_sensor_is_noticed(bench: Callable[..., Any]) -> None:
    card = bench(calibration_steps=0)
    driver = started(card)
    card.fault("change")
    card.go(0.001)
    with pytest.raises(ChangedError, match="change bit"):
        driver.check()


def test_full_scales_that_somebody_else_sets_are_noticed(bench: Callable[..., Any]) -> None:
    card = bench()
    driver = started(card)
    card.run(Driver(card, QUICK).set_full_scales((60,) * 6))
    with pytest.raises(ChangedError, match="as it was set up"):
        driver.check()


@pytest.mark.parametrize(
    ("fault", "error"), [("pull", NoSensorError), ("watchdog", NoSensorError), ("no_card", NoCardError)]
)
def test_a_check_names_what_is_wrong(bench: Callable[..., Any], fault: str, error: type[TreenailError]) -> None:
    card = bench()
    driver = started(card)
    card.fault(fault)
    with pytest.raises(error):
        driver.check()


def test_a_stalled_command_ends_in_a_clear_error(bench: Callable[..., Any]) -> None:
    card = bench()
    driver = started(card)
    card.fault("stall")
    before_s = card.waited_s
    with pytest.raises(CommandError, match="command 0800: expected 0 in 00E7 within 1 s, got 0800"):
        card.run(driver.command(jr3.RESET_OFFSETS))
    assert COMMAND_TIMEOUT_S <= card.waited_s - before_s < 1.1 * COMMAND_TIMEOUT_S


def test_a_refused_command_is_told(bench: Callable[..., Any]) -> None:
    card = bench()
    driver = started(card)
    card.fault("refuse")
    with pytest.raises(CommandError, match="command 0800: expected 0 in 00E7 when done, got -1"):
        card.run(driver.command(jr3.RESET_OFFSETS))


def test_a_command_waits_for_the_one_before(bench: Callable[..., Any]) -> None:
    card = bench()
    driver = started(card)
    card.write(0xE7, 0x0500)
    waits = driver.command(jr3.RESET_OFFSETS)
    next(waits)
    assert card.read(0xE7, 1) == [0x0500], "nothing is written over it"
    card.run(waits)
    assert card.written[-1] == (0xE7, 0x0800)


def test_scale_is_not_told_before_the_start_is_done(bench: Callable[..., Any]) -> None:
    with pytest.raises(CommandError, match="a card that was set up"):
        _ = Driver(bench(), QUICK).scale


def test_full_scales_that_no_message_can_carry_are_named(bench: Callable[..., Any]) -> None:
    card = bench(units=3, full_scales=(30, 30, 30, 30, 30, 30))
    with pytest.raises(NoSensorError, match="full scales of at most 50000 N and N m, got"):
        started(card)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"zero": "now"}, "zero: expected one of no, reset, filter0"),
        ({"offset_set": 16}, "offset_set: expected from 0 to 15, got 16"),
        ({"units": "7"}, "units: expected one of"),
        ({"settle_s": -1.0}, "settle"),
        ({"settle_s": float("nan")}, "settle"),
    ],
)
def test_a_setup_that_cannot_be_is_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingError, match=message):
        Setup(**wrong)


# -- status ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("warnings", "errors", "status"),
    [
        (0, 0, 0),
        (0, 0x0001, 1),
        (0, 0x0020, 1),
        (0x0004, 0, 2),
        (0x0004, 0x0004, 3),
        (0, 0x0400, 4),
        (0, 0x0800, 8),
        (0, 0x1000, 4),
        (0, 0x2000, 4),
        (0, 0x4000, 4),
        (0, 0x8000, 4),
        (0xFFFF, 0xFFFF, 15),
        (0xFFC0, 0, 0),  # no axis
        (0, 0x0040, 0),
    ],
)
def test_bits_become_status(warnings: int, errors: int, status: int) -> None:
    assert status_of(warnings, errors) == status


# -- noise -------------------------------------------------------------------------------------------------------


class Noise:
    """Memory that reads as anything."""

    def __init__(self, seed: int, zeros: int) -> None:
        self._random = random.Random(seed)
        self._zeros = zeros

    def read(self, address: int, count: int) -> list[int]:
        return [
            0 if self._random.random() * 100 < self._zeros else self._random.randrange(0x10000) for _ in range(count)
        ]

    def write(self, address: int, value: int) -> None:
        assert 0 <= value <= 0xFFFF


@given(st.integers(0, 2**32), st.integers(0, 100), st.sampled_from(["no", "reset", "filter0"]))
def test_noise_in_memory_is_an_error_with_a_name_or_a_scale(seed: int, zeros: int, zero: str) -> None:
    driver = Driver(Noise(seed, zeros), Setup(settle_s=0.0, sensor_timeout_s=0.5, zero=zero))
    try:
        for _, _wait in zip(range(2000), driver.start(), strict=False):
            pass
        assert all(value >= 1 for value in driver.scale.full_scales)
    except TreenailError as error:
        assert "\n" not in str(error)
