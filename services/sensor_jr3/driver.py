"""The driver of a JR3 receiver: presence, start-up, commands, scale. Pure over a ``Memory``: no clock, thread or port.

What takes time is a generator of the seconds to wait before it goes on, so that whoever runs it stays able to work.
Never run on hardware yet; what public sources leave open is a setting or a line of ``memory_map``.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

from services.rules.ft_counts import AXES, LEAST_COUNTS, UNITS, CountsError, FtCounts
from services.rules.settings import SettingError, check, setting
from services.sensor_jr3 import memory_map as jr3
from services.sensor_jr3.card import ChangedError, CommandError, Memory, NoCardError, NoSensorError, hexadecimal, signed
from services.sensor_jr3.status import USELESS, troubles
from services.sensor_jr3.transform import Link, words
from services.wire.errors import TreenailError
from services.wire.message_base import LARGEST_COMPONENT

ZERO = ("no", "reset", "filter0")
COMMAND_TIMEOUT_S = 1.0
"""A transform takes a real card some 4 ms; comedi waits 20 to 40 ms for commands."""
_COMMAND_POLL_S = 0.002
_SENSOR_POLL_S = 0.1
_NO_CARD = 0xFFFF
"""What a bus reads where nobody answers."""
_FIRST, _LAST = jr3.address_of("default_full_scales"), jr3.address_of("thickness")
_SLOT = 0


@dataclass(frozen=True)
class Setup:
    """How a card is to be set up."""

    full_scales: tuple[int, ...] | Literal["default", "keep"] = "default"
    """Fx Fy Fz Mx My Mz in the card's unit; those the sensor calls its default; or those in use."""
    transform: tuple[Link, ...] | None = ()
    """Links of the card's own transform, the identity for none; None leaves the one in use."""
    offset_set: int | None = setting(None, "set of offsets to use (default: as it is)", within=(0, 15))
    zero: str = setting("no", "take the load as zero", choices=ZERO, nargs="?", const="reset")
    """``reset`` has the card take the present load as zero; ``filter0`` adds what filter 0 shows to the offsets."""
    units: str | None = setting(None, "unit system, instead of what the card says", choices=tuple(UNITS))
    settle_s: float = setting(10.0, "time for the sensor to settle", within=(0.0, 3600.0))
    """Once its calibration is in; comedi waits 10 s after each start."""
    sensor_timeout_s: float = setting(30.0, "time for it to show up", within=(0.001, 3600.0))

    def __post_init__(self) -> None:
        """Raise SettingError for what cannot be used."""
        check(self, SettingError)


class Identity(NamedTuple):
    """What must stay as it is while samples are read with one scale."""

    serial: int
    model: int
    units: int
    full_scales: tuple[int, ...]
    transform: int


class Driver:
    """One card. Run ``start`` to its end before ``scale`` is asked for; ``check`` now and then."""

    def __init__(self, memory: Memory, setup: Setup) -> None:
        self._memory = memory
        self._setup = setup
        self._identity: Identity | None = None
        self._scale: FtCounts | None = None

    @property
    def scale(self) -> FtCounts:
        """What counts are worth. Raises CommandError before the start is done."""
        if self._scale is None:
            raise CommandError("sensor: expected a card that was set up, got one that was not")
        return self._scale

    def start(self) -> Iterator[float]:
        """Set the card up in comedi's order, giving the seconds to wait. Raises CardError or SettingError."""
        setup = self._setup
        self._identity = self._scale = None
        yield from self._await_sensor()
        yield setup.settle_s
        self.presence()
        # It stays set until somebody clears it; what it tells is being acted upon.
        self._memory.write(jr3.address_of("errors"), 0)
        if setup.transform is not None:
            yield from self.set_transform(_SLOT, setup.transform)
        if setup.full_scales == "default":
            yield from self._use_full_scales(self.default_full_scales(), NoSensorError)
        elif setup.full_scales != "keep":
            yield from self.set_full_scales(setup.full_scales)
        if setup.offset_set is not None:
            yield from self.command(jr3.USE_OFFSETS + setup.offset_set)
        if setup.zero == "reset":
            yield from self.command(jr3.RESET_OFFSETS)
        elif setup.zero == "filter0":
            yield from self.zero_by_filter0()
        block = self._block()
        self._scale = self._scale_in(block)
        self._identity = _identity_in(block)
        self.check()

    def presence(self) -> None:
        """Raise NoCardError when nobody answers at the address, NoSensorError when the sensor does not work."""
        block = self._block()
        _check_card(block)
        if faults := troubles(_word(block, "errors")):
            raise NoSensorError(f"sensor: expected one that works, got errors {_errors(block)}: {faults}")
        if not (_word(block, "model") and _word(block, "serial")):
            got = f"model {_word(block, 'model')}, serial {_word(block, 'serial')}"
            raise NoSensorError(f"sensor: expected one whose calibration is in, got {got}")

    def check(self) -> None:
        """Raise what ``presence`` does, and ChangedError when the card is no longer as it was set up."""
        self.presence()
        block = self._block()
        if _word(block, "errors") & jr3.SENSOR_CHANGED:
            raise ChangedError("sensor: expected the one that was set up, got another one (the card's change bit)")
        identity = _identity_in(block)
        if self._identity is not None and identity != self._identity:
            raise ChangedError(f"card: expected it as it was set up, {self._identity}, got {identity}")

    def default_full_scales(self) -> tuple[int, ...]:
        """Return what the sensor calls its default, in the card's unit."""
        return _signed_words(self._block(), "default_full_scales")

    def full_scales(self) -> tuple[int, ...]:
        """Return the six full scales in use, in the card's unit."""
        return _signed_words(self._block(), "full_scales")[:6]

    def recommended_full_scales(self) -> tuple[tuple[int, ...], tuple[int, ...]]:
        """Return the smallest and the largest that the sensor advises, in the card's unit."""
        block = self._block()
        return _signed_words(block, "min_full_scales"), _signed_words(block, "max_full_scales")

    def set_full_scales(self, wanted: Sequence[int]) -> Iterator[float]:
        """Set six full scales in the card's unit. Raises SettingError for what a card cannot take, CommandError."""
        yield from self._use_full_scales(tuple(wanted), SettingError)

    def set_transform(self, slot: int, links: tuple[Link, ...]) -> Iterator[float]:
        """Write a transform into a slot, 0 to 15, and use it; the card turns its offsets with it."""
        start = jr3.address_of("transforms", slot * jr3.TRANSFORM_SLOT_WORDS)
        unit = UNITS[self._units_in(self._block())]
        yield from self.command(jr3.USE_TRANSFORM + slot, {start: words(links, unit.length_mm)})
        if (got := self._memory.read(jr3.address_of("transform_in_use"), 1)[0]) != slot:
            raise CommandError(f"transform: expected slot {slot} to be in use, got {got}")

    def set_offsets(self, offsets: Sequence[int]) -> Iterator[float]:
        """Set six offsets in counts, -32768 to 32767: they are subtracted. Raises SettingError, CommandError."""
        if len(offsets) != 6 or not all(-32768 <= offset <= 32767 for offset in offsets):
            raise SettingError(f"offsets: expected six from -32768 to 32767, got {list(offsets)}")
        yield from self.command(jr3.SET_OFFSETS, {jr3.address_of("offsets"): list(offsets)})

    def zero_by_filter0(self) -> Iterator[float]:
        """Make what filter 0 shows now the new zero."""
        block = self._block()
        shown = zip(_signed_words(block, "offsets"), _signed_words(block, "filter0")[:6], strict=True)
        yield from self.set_offsets([offset + value for offset, value in shown])

    def command(self, code: int, operands: dict[int, list[int]] | None = None) -> Iterator[float]:
        """Write operands, then the command word; wait until the card has made it 0. Raises CommandError."""
        where = jr3.address_of("command0")
        # Two programs that write commands at once would each take the other's 0 for its own.
        yield from self._await_done(where, f"another command before {hexadecimal(code)}")
        for start, values in (operands or {}).items():
            for index, value in enumerate(values):
                self._memory.write(start + index, value & 0xFFFF)
        self._memory.write(where, code)
        yield from self._await_done(where, hexadecimal(code))

    def _use_full_scales(self, wanted: tuple[int, ...], error: type[TreenailError]) -> Iterator[float]:
        """``error`` is raised for scales that a card cannot take: whose they are tells whose fault it is."""
        least, _ = self.recommended_full_scales()
        for axis, value, low in zip(AXES, wanted, least, strict=True):
            # The manual's limit: below 0.4 % of the smallest, the DSP's arithmetic overflows.
            if not (max(1.0, 0.004 * low) <= value <= 32767):
                raise error(f"full scale {axis}: expected {max(1.0, 0.004 * low):g} to 32767, got {value}")
        yield from self.command(jr3.SET_FULL_SCALES, {jr3.address_of("full_scales"): list(wanted)})
        if (got := self.full_scales()) != wanted:
            raise CommandError(f"full scales: expected {list(wanted)} to be in use, got {list(got)}")

    def _await_done(self, where: int, what: str) -> Iterator[float]:
        waited_s = 0.0
        while (reply := signed(self._memory.read(where, 1)[0])) != 0:
            if reply == -1:
                _check_card(self._block())
            if reply < 0:
                raise CommandError(f"command {what}: expected 0 in {hexadecimal(where)} when done, got {reply}")
            if waited_s >= COMMAND_TIMEOUT_S:
                expected = f"expected 0 in {hexadecimal(where)} within {COMMAND_TIMEOUT_S:g} s"
                raise CommandError(f"command {what}: {expected}, got {hexadecimal(reply)}")
            yield _COMMAND_POLL_S
            waited_s += _COMMAND_POLL_S

    def _await_sensor(self) -> Iterator[float]:
        waited_s = 0.0
        while True:
            try:
                return self.presence()
            except NoSensorError as error:
                if waited_s >= self._setup.sensor_timeout_s:
                    raise NoSensorError(f"{error}, after {self._setup.sensor_timeout_s:g} s") from None
            yield _SENSOR_POLL_S
            waited_s += _SENSOR_POLL_S

    def _block(self) -> list[int]:
        return self._memory.read(_FIRST, _LAST - _FIRST + 1)

    def _units_in(self, block: list[int]) -> str:
        told = self._setup.units
        code = str(_word(block, "units"))
        if told is None and code not in UNITS:
            raise NoSensorError(f"units: expected code 0 to 3 in the card, got {code}; a setting can say which it is")
        return code if told is None else told

    def _scale_in(self, block: list[int]) -> FtCounts:
        bits = _word(block, "adc_bits")
        usual = bits if 8 <= bits <= 16 else 16  # it bounds only what is simulated; the card itself tells saturation
        try:
            scale = FtCounts(self._units_in(block), _signed_words(block, "full_scales")[:6], usual)
        except CountsError as error:
            raise NoSensorError(str(error)) from None
        force_n, torque_nm = scale.read((LEAST_COUNTS,) * len(AXES))
        if min(*force_n, *torque_nm) < -LARGEST_COMPONENT:
            expected = f"expected full scales of at most {LARGEST_COMPONENT / 2:g} N and N m"
            raise NoSensorError(f"card: {expected}, got {scale.full_scales} ({UNITS[scale.units].words})")
        return scale


def _word(block: list[int], name: str) -> int:
    return block[jr3.address_of(name) - _FIRST]


def _signed_words(block: list[int], name: str) -> tuple[int, ...]:
    start = jr3.address_of(name) - _FIRST
    return tuple(signed(word) for word in block[start : start + jr3.FIELDS[name].length])


def _errors(block: list[int]) -> str:
    return hexadecimal(_word(block, "errors") & USELESS)


def _identity_in(block: list[int]) -> Identity:
    scales = _signed_words(block, "full_scales")[:6]
    transform = _word(block, "transform_in_use")
    return Identity(_word(block, "serial"), _word(block, "model"), _word(block, "units"), scales, transform)


def _check_card(block: list[int]) -> None:
    names = ("software_version", "serial", "model")
    if all(_word(block, name) == _NO_CARD for name in names):
        raise NoCardError("card: expected a JR3 receiver, got FFFF everywhere: nothing answers at this address")
