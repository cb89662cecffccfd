"""The receiver's DSP: its memory, and what happens to it 8000 times a second. Pure; time is the number of steps.

Where public sources are silent it does the likely thing: filters are of first order; the plug pulled stops the samples;
command 0800 zeroes on filter 0. Peaks, rates, load envelopes and the new minimum and maximum full scales after a
transform are not emulated.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from services.sensor_jr3 import memory_map as jr3
from services.sensor_jr3.emulator.faults import FAULTS, FIRST_FAULT
from services.sensor_jr3.emulator.loads import NO_LOAD, Load, inverse, load_of, nearest_counts, rescaled, transformed

_AT = {name: field.address for name, field in jr3.FIELDS.items()}
_WRITABLE = {field.address + index for field in jr3.MAP if field.access == "write" for index in range(field.length)}
# One pole with half the power at a sixteenth of its own rate.
_COSINE = math.cos(2.0 * math.pi / 16.0)
SHARE = _COSINE - 1.0 + math.sqrt(_COSINE * _COSINE - 4.0 * _COSINE + 3.0)
_SETTLED_COUNTS = 1e-6
_QUICK_STEPS, _SLOW_STEPS = 8, 32
"""How long commands take: 1 ms, and 4 ms for those without force data."""


@dataclass(frozen=True)
class Sensor:
    """The emulated sensor and its calibration."""

    units: int = 1
    full_scales: tuple[int, ...] = (65, 65, 130, 50, 50, 50)
    """Fx Fy Fz Mx My Mz, in the unit; of the sensor by default."""
    serial: int = 4711
    model: int = 1205
    adc_bits: int = 14
    calibration_steps: int = 16_000
    """How long calibration takes to come in after plugging in."""
    zeroes_itself: bool = True
    """Whether the load is zeroed when calibration is in, as a real card does."""
    filters: bool = True
    """Whether filters 1 to 6 follow; without, they stand still, which costs little where nobody reads them."""


class Dsp:
    """Memory and state. ``read`` and ``write`` are the bus; ``step`` is one sample."""

    def __init__(self, sensor: Sensor) -> None:
        self._sensor = sensor
        self._serial = sensor.serial
        self.words = [0] * jr3.WORDS
        self.faults = dict.fromkeys(FAULTS, 0)
        self._load: Load = NO_LOAD
        self._links: list[tuple[int, int]] = []
        self._scales = list(sensor.full_scales)
        self._offsets = [0] * 6
        self._offset_sets = [[0] * 6 for _ in range(16)]
        self._unrounded = [[0.0] * 6 for _ in range(jr3.FILTERS)]
        self._filter0 = [0] * 6
        self._settled = [False] * jr3.FILTERS
        self._steps = 0
        self._command_left = 0
        self._calibration_left = 0
        self._changed = False
        self._fill()
        self._show()

    # -- the bus -------------------------------------------------------------------------------------------------

    def read(self, address: int, count: int) -> list[int]:
        """Return words; what does not exist reads as FFFF."""
        return [self._word(at) for at in range(address, address + count)]

    def write(self, address: int, value: int) -> None:
        """Write a word; the DSP's own words cannot be written."""
        if address >= FIRST_FAULT:
            self._set_fault(address, value)
        elif address in _WRITABLE and not self.faults["no_card"]:
            self._on_write(address, value & 0xFFFF)

    def set_load(self, load: Load) -> None:
        """Have the sensor feel a load; filter 0 shows it at once."""
        if load != self._load:
            self._load = load
            self._show()

    # -- time ----------------------------------------------------------------------------------------------------

    def step(self) -> bool:
        """Take one sample; return whether there was one."""
        self._command_step()
        self._calibration_step()
        if self.faults["pull"] or self.faults["stop"] or self._calibration_left:
            self._flags()
            return False
        self._steps += 1
        for number in range(1, jr3.FILTERS):
            if self._steps % 4 ** (number - 1):
                break
            self.words[_AT["counters"] + number - 1] = (self.words[_AT["counters"] + number - 1] + 1) & 0xFFFF
            if not self._settled[number] and self._sensor.filters:
                self._filter(number)
        return True

    def skip(self, steps: int) -> None:
        """Let time go by that nobody watched: only counters go on."""
        if self.faults["pull"] or self.faults["stop"]:
            return
        for number in range(1, jr3.FILTERS):
            period = 4 ** (number - 1)
            ticks = (self._steps + steps) // period - self._steps // period
            at = _AT["counters"] + number - 1
            self.words[at] = (self.words[at] + ticks) & 0xFFFF
        self._steps += steps

    # -- details -------------------------------------------------------------------------------------------------

    def _word(self, address: int) -> int:
        if address >= FIRST_FAULT:
            return next((self.faults[name] for name, (at, _) in FAULTS.items() if at == address), 0)
        return 0xFFFF if self.faults["no_card"] or address >= jr3.WORDS else self.words[address]

    def _fill(self) -> None:
        sensor = self._sensor
        for index, character in enumerate("C EMULATED JR3\0"):
            self.words[_AT["copyright"] + index] = ord(character) << 8
        for name in ("default_full_scales", "full_scales"):
            self._put(name, list(sensor.full_scales))
        self._put("full_scales", [*sensor.full_scales, sensor.full_scales[2], sensor.full_scales[5]])
        self._put("min_full_scales", [max(1, scale // 4) for scale in sensor.full_scales])
        self._put("max_full_scales", [scale * 2 for scale in sensor.full_scales])
        self._put("near_saturation_value", [26214])
        self._put("saturation_value", [min(32767, 32768 - 2 ** (16 - sensor.adc_bits))])
        self._put("software_version", [302])
        self._put("serial", [self._serial])
        self._put("model", [sensor.model])
        self._put("units", [sensor.units])
        self._put("adc_bits", [sensor.adc_bits])
        self._put("channels", [0xFF])
        self._put("vector_axes", [0x3F])

    def _put(self, name: str, values: list[int]) -> None:
        for index, value in enumerate(values):
            self.words[_AT[name] + index] = value & 0xFFFF

    def _show(self) -> None:
        """Work out raw channels, filter 0 and flags anew; the other filters have something to follow."""
        raw = nearest_counts(self._load, self._sensor.full_scales, self._sensor.units)
        for axis, count in enumerate(raw):
            self.words[4 * (axis + 1) + 1] = _limit(count) & 0xFFFF
        self._raw = raw
        if self._command_busy():
            return
        seen = transformed(self._load, self._links, self._sensor.units)
        counts = nearest_counts(seen, self._scales, self._sensor.units)
        shown = [_limit(count - offset) for count, offset in zip(counts, self._offsets, strict=True)]
        self._filter0 = shown
        self._unrounded[0] = [float(count) for count in shown]
        self._show_filter(0)
        self._settled = [False] * jr3.FILTERS
        self._flags()

    def _filter(self, number: int) -> None:
        source, state = self._unrounded[number - 1], self._unrounded[number]
        for axis in range(6):
            state[axis] += SHARE * (source[axis] - state[axis])
        if all(abs(source[axis] - state[axis]) < _SETTLED_COUNTS for axis in range(6)):
            state[:] = source
            self._settled[number] = number == 1 or self._settled[number - 1]
        self._show_filter(number)

    def _show_filter(self, number: int) -> None:
        counts = [round(value) for value in self._unrounded[number]]
        start = jr3.filter_address(number)
        for axis, count in enumerate(counts):
            self.words[start + axis] = count & 0xFFFF
        scales = self.words[_AT["full_scales"] : _AT["full_scales"] + 8]
        for vector, (first, last) in enumerate(((0, 3), (3, 6))):
            squares = sum((counts[axis] * self._scales[axis]) ** 2 for axis in range(first, last))
            self.words[start + 6 + vector] = _limit(round(math.sqrt(squares) / max(1, scales[6 + vector]))) & 0xFFFF

    def _flags(self) -> None:
        """Set error and warning bits; the one of a changed sensor stays until it is written over."""
        axes = [abs(count) for count in self._raw]
        saturated = _bits(axes, self.words[_AT["saturation_value"]])
        near = _bits(axes, self.words[_AT["near_saturation_value"]])
        errors = jr3.AXIS_BITS if self.faults["saturate"] else saturated
        errors |= jr3.SENSOR_CHANGED * self._changed
        errors |= jr3.BUSY * self._command_busy()
        errors |= jr3.CALIBRATION_BAD * bool(self._calibration_left)
        errors |= (jr3.WATCHDOG | jr3.WATCHDOG2) * bool(self.faults["pull"])
        errors |= jr3.WATCHDOG * bool(self.faults["watchdog"])
        self.words[_AT["errors"]] = errors
        self.words[_AT["warnings"]] = jr3.AXIS_BITS if self.faults["near"] else near

    def _set_fault(self, address: int, value: int) -> None:
        name = next((name for name, (at, _) in FAULTS.items() if at == address), None)
        if name is None:
            return
        was, self.faults[name] = self.faults[name], value
        if name == "change" and value:
            self._serial = self._serial % 0xFFF0 + 1
            self._changed = True
        if (name == "change" and value) or (name == "pull" and was and not value):
            self._plug_in()
        self._flags()

    def _plug_in(self) -> None:
        self._put("serial", [0])
        self._put("model", [0])
        self._calibration_left = max(1, self._sensor.calibration_steps)

    def _calibration_step(self) -> None:
        if not self._calibration_left or self.faults["pull"]:
            return
        self._calibration_left -= 1
        if self._calibration_left:
            return
        self._put("serial", [self._serial])
        self._put("model", [self._sensor.model])
        if self._sensor.zeroes_itself:
            self._zero()
        self._show()

    def _on_write(self, address: int, value: int) -> None:
        if address == _AT["errors"]:
            self._changed = self._changed and bool(value & jr3.SENSOR_CHANGED)
            self._flags()
            return
        self.words[address] = value
        if address == _AT["command0"]:
            slow = value & 0xFF00 in (jr3.USE_TRANSFORM, jr3.SET_FULL_SCALES)
            self._command_left = _SLOW_STEPS if slow else _QUICK_STEPS
            self._flags()
        elif 0 <= address - _AT["offsets"] < 6:
            self._take_offsets()

    def _command_busy(self) -> bool:
        return self._command_left > 0 and self.words[_AT["command0"]] & 0xFF00 in (
            jr3.USE_TRANSFORM,
            jr3.SET_FULL_SCALES,
        )

    def _command_step(self) -> None:
        if not self._command_left or self.faults["stall"]:
            return
        self._command_left -= 1
        if self._command_left:
            return
        code = self.words[_AT["command0"]]
        act = None if self.faults["refuse"] else self._commands().get(code & 0xFF00)
        done = act is not None and act(code & 0xFF)
        self.words[_AT["command0"]] = 0 if done else 0xFFFF
        self._show()

    def _commands(self) -> dict[int, Callable[[int], bool]]:
        return {
            jr3.USE_TRANSFORM: self._use_transform,
            jr3.USE_OFFSETS: self._use_offsets,
            jr3.SET_OFFSETS: lambda low: low == 0 and self._take_offsets(),
            jr3.RESET_OFFSETS: lambda low: low == 0 and self._zero(),
            jr3.SET_FULL_SCALES: lambda low: low == 0 and self._set_scales(),
        }

    def _use_transform(self, slot: int) -> bool:
        if slot > 15:
            return False
        start = _AT["transforms"] + slot * jr3.TRANSFORM_SLOT_WORDS
        links: list[tuple[int, int]] = []
        for at in range(start, start + 2 * jr3.MOST_LINKS, 2):
            kind = self.words[at]
            if kind == jr3.END:
                break
            if kind > jr3.NEGATE:
                return False
            links.append((kind, _signed(self.words[at + 1])))
        # Offsets turn with the axes, so that what was zero stays zero.
        units = self._sensor.units
        there = transformed(load_of(self._offsets, self._scales, units), inverse(self._links), units)
        self._offsets = nearest_counts(transformed(there, links, units), self._scales, units)
        self._links = links
        self._show_offsets()
        self.words[_AT["transform_in_use"]] = slot
        return True

    def _use_offsets(self, number: int) -> bool:
        if number > 15:
            return False
        self._offset_sets[self.words[_AT["offset_set"]]] = list(self._offsets)
        self._offsets = list(self._offset_sets[number])
        self.words[_AT["offset_set"]] = number
        self._show_offsets()
        return True

    def _take_offsets(self) -> bool:
        start = _AT["offsets"]
        self._offsets = [_signed(word) for word in self.words[start : start + 6]]
        self._show()
        return True

    def _zero(self) -> bool:
        self._offsets = [offset + shown for offset, shown in zip(self._offsets, self._filter0, strict=True)]
        self._show_offsets()
        return True

    def _set_scales(self) -> bool:
        wanted = [_signed(word) for word in self.words[_AT["full_scales"] : _AT["full_scales"] + 6]]
        if min(wanted) < 1:
            return False
        self._offsets = rescaled(self._offsets, self._scales, wanted)
        self._scales = wanted
        self._show_offsets()
        return True

    def _show_offsets(self) -> None:
        self._put("offsets", self._offsets)


def _limit(count: int) -> int:
    return max(-32768, min(32767, count))


def _signed(word: int) -> int:
    return word - 65536 if word >= 32768 else word


def _bits(magnitudes: list[int], threshold: int) -> int:
    return sum(1 << axis for axis, magnitude in enumerate(magnitudes) if magnitude >= threshold)
