"""The memory of a JR3 receiver's DSP, as data: 16-bit words, addresses in words.

``confidence`` is S for what two public sources or arithmetic agree on, L for likely (one source), U for unknown: a U or
L entry is the first thing to look at when a real card disagrees. ``source`` names public drivers: linux (comedi's
jr3_pci), ocl (Orocos' JR3DSP), uc3m (jr3pci-linux), springhead (an ISA board), rojas (JR3Sensor.cpp), thesis.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

Kind = Literal["signed", "unsigned", "bits", "character"]
Access = Literal["read", "write"]

WORDS = 0x400
"""Words of the map; what lies above is not known."""


class Field(NamedTuple):
    """Consecutive words of one meaning."""

    name: str
    address: int
    length: int
    kind: Kind
    unit: str
    """``force`` and ``moment`` are the receiver's own unit, see services.rules.ft_counts.UNITS."""
    access: Access
    """``write`` also reads."""
    source: str
    confidence: str


MAP: tuple[Field, ...] = (
    # 16 channels x 4 words: time (unsigned, about 1 MHz), data, 2 reserved. 0 excitation voltage, 1-6 coupled Fx..Mz.
    Field("raw", 0x00, 64, "signed", "ADC counts", "read", "linux ocl", "S"),
    Field("copyright", 0x40, 24, "character", "in the high byte, ends with 0", "read", "linux uc3m", "S"),
    Field("shunts", 0x60, 6, "signed", "counts", "read", "linux ocl", "S"),
    Field("default_full_scales", 0x68, 6, "signed", "force, moment", "read", "linux ocl", "S"),
    Field("load_envelope_in_use", 0x6F, 1, "unsigned", "number", "read", "linux ocl", "S"),
    Field("min_full_scales", 0x70, 6, "signed", "force, moment", "read", "linux", "S"),
    Field("transform_in_use", 0x77, 1, "unsigned", "slot 0-15", "read", "linux", "S"),
    Field("max_full_scales", 0x78, 6, "signed", "force, moment", "read", "linux", "S"),
    Field("peak_address", 0x7F, 1, "unsigned", "address of 8 words", "write", "linux", "S"),
    Field("full_scales", 0x80, 8, "signed", "force, moment; V1 V2", "write", "linux ocl uc3m", "S"),
    Field("offsets", 0x88, 6, "signed", "counts", "write", "linux ocl springhead", "S"),
    Field("offset_set", 0x8E, 1, "unsigned", "number 0-15", "read", "linux ocl springhead", "S"),
    Field("vector_axes", 0x8F, 1, "bits", "V1 1 2 4, V2 8 10 20, swap 40 80", "write", "linux ocl springhead", "S"),
    # Fx Fy Fz Mx My Mz V1 V2, 16384 counts = full scale. 0 is decoupled, without offset, not filtered.
    Field("filter0", 0x90, 8, "signed", "counts", "read", "linux ocl springhead", "S"),
    Field("filter1", 0x98, 8, "signed", "counts", "read", "linux ocl", "S"),
    Field("filter2", 0xA0, 8, "signed", "counts", "read", "linux ocl", "S"),
    Field("filter3", 0xA8, 8, "signed", "counts", "read", "linux ocl", "S"),
    Field("filter4", 0xB0, 8, "signed", "counts", "read", "linux ocl", "S"),
    Field("filter5", 0xB8, 8, "signed", "counts", "read", "linux ocl", "S"),
    Field("filter6", 0xC0, 8, "signed", "counts", "read", "linux ocl", "S"),
    Field("rates", 0xC8, 8, "signed", "counts", "read", "linux ocl", "S"),
    Field("minima", 0xD0, 8, "signed", "counts", "read", "linux ocl", "S"),
    Field("maxima", 0xD8, 8, "signed", "counts", "read", "linux ocl", "S"),
    Field("near_saturation_value", 0xE0, 1, "unsigned", "counts", "write", "linux ocl", "S"),
    Field("saturation_value", 0xE1, 1, "unsigned", "counts", "write", "linux ocl", "S"),
    Field("rate_address", 0xE2, 1, "unsigned", "address of 8 words", "write", "linux", "S"),
    Field("rate_divisor", 0xE3, 1, "unsigned", "samples, 0 means 65536", "write", "linux", "S"),
    Field("rate_count", 0xE4, 1, "unsigned", "samples", "read", "linux", "S"),
    # Numbered backwards: the word that starts a command, word 0, is the last.
    Field("command2", 0xE5, 1, "unsigned", "operand", "write", "linux ocl uc3m", "S"),
    Field("command1", 0xE6, 1, "unsigned", "operand", "write", "linux ocl uc3m", "S"),
    Field("command0", 0xE7, 1, "signed", "command; 0 done, negative an error", "write", "linux ocl uc3m", "S"),
    # Of filters 1-6: the first steps at 8 kHz, each next one at a quarter.
    Field("counters", 0xE8, 6, "unsigned", "samples modulo 65536", "read", "linux ocl", "S"),
    Field("reception_errors", 0xEE, 1, "unsigned", "bad samples, dropped", "read", "linux ocl", "S"),
    Field("idle_count", 0xEF, 1, "unsigned", "idle loops", "read", "linux ocl", "S"),
    Field("warnings", 0xF0, 1, "bits", "see Warning", "read", "linux ocl", "S"),
    Field("errors", 0xF1, 1, "bits", "see Trouble", "write", "linux ocl", "S"),
    Field("threshold_bits", 0xF2, 1, "bits", "load envelopes", "write", "linux ocl", "S"),
    Field("last_crc", 0xF3, 1, "unsigned", "0 when good", "read", "linux", "S"),
    Field("eeprom_version", 0xF4, 1, "unsigned", "number", "read", "linux", "S"),
    Field("software_version", 0xF5, 1, "unsigned", "x 100", "read", "linux ocl", "S"),
    Field("software_day", 0xF6, 1, "unsigned", "day of year", "read", "linux ocl", "S"),
    Field("software_year", 0xF7, 1, "unsigned", "year", "read", "linux ocl", "S"),
    Field("serial", 0xF8, 1, "unsigned", "number", "read", "linux ocl", "S"),
    Field("model", 0xF9, 1, "unsigned", "number", "read", "linux ocl", "S"),
    Field("calibration_day", 0xFA, 1, "unsigned", "day of year", "read", "linux ocl", "S"),
    Field("calibration_year", 0xFB, 1, "unsigned", "year", "read", "linux ocl", "S"),
    Field("units", 0xFC, 1, "unsigned", "code 0-3", "read", "linux ocl", "S"),
    Field("adc_bits", 0xFD, 1, "unsigned", "bits", "read", "linux ocl", "S"),
    Field("channels", 0xFE, 1, "bits", "channels that are sent", "read", "linux ocl", "S"),
    Field("thickness", 0xFF, 1, "unsigned", "length unit", "read", "linux ocl", "S"),
    # 16 x 16 words: latch bits, numbers of >= and <= thresholds, 4 x (address, threshold, bit pattern), reserved.
    Field("load_envelopes", 0x100, 256, "signed", "16 words each", "write", "linux ocl", "L"),
    # 16 x 16 words: pairs (link type, amount) to one of type 0.
    Field("transforms", 0x200, 256, "signed", "16 words each", "write", "linux ocl", "S"),
)
FIELDS: dict[str, Field] = {field.name: field for field in MAP}

SAMPLE_RATE_HZ = 8000
FILTERS = 7

# Commands, to be written to command0 after their operands.
USE_TRANSFORM = 0x0500
"""Plus the slot, 0-15."""
USE_OFFSETS = 0x0600
"""Plus the number of the set, 0-15."""
SET_OFFSETS = 0x0700
RESET_OFFSETS = 0x0800
"""The present load becomes zero; on which filter the DSP takes it is not known (U)."""
SET_VECTOR_AXES = 0x0900
SET_FULL_SCALES = 0x0A00

# Bits of ``errors``, and those of an axis in ``warnings``.
AXIS_BITS = 0x003F
"""fx fy fz mx my mz: saturated in ``errors``, near saturation in ``warnings``; of the raw, still coupled channels."""
RAM_BAD = 0x0400
SENSOR_CHANGED = 0x0800
"""Another sensor passed its CRC; it stays set until the user clears it."""
BUSY = 0x1000
CALIBRATION_BAD = 0x2000
"""The calibration's CRC; normal for some 2 s after plugging in."""
WATCHDOG2 = 0x4000
WATCHDOG = 0x8000

# Links of a transform.
END, TX, TY, TZ, RX, RY, RZ, NEGATE = range(8)
TRANSFORM_SLOT_WORDS = 16
MOST_LINKS = 7
HALF_TURN = 32768
"""Amount of a rotation by 180 deg (L: one source)."""


def address_of(name: str, index: int = 0) -> int:
    """Return the address of a field, or of one of its words. Raises KeyError or IndexError for what is not there."""
    field = FIELDS[name]
    if not 0 <= index < field.length:
        raise IndexError(f"{name}: expected a word from 0 to {field.length - 1}, got {index}")
    return field.address + index


def filter_address(number: int) -> int:
    """Return where the 8 words of filter 0 to 6 are."""
    return address_of(f"filter{number}")


def counter_address(number: int) -> int:
    """Return where the counter of filter 1 to 6 is."""
    return address_of("counters", number - 1)
