"""The memory map is what the public sources say, and does not contradict itself."""

from __future__ import annotations

import pytest

from services.sensor_jr3 import memory_map as jr3

GOLDEN = {
    "raw": 0x00,
    "copyright": 0x40,
    "shunts": 0x60,
    "default_full_scales": 0x68,
    "load_envelope_in_use": 0x6F,
    "min_full_scales": 0x70,
    "transform_in_use": 0x77,
    "max_full_scales": 0x78,
    "peak_address": 0x7F,
    "full_scales": 0x80,
    "offsets": 0x88,
    "offset_set": 0x8E,
    "vector_axes": 0x8F,
    "filter0": 0x90,
    "filter1": 0x98,
    "filter2": 0xA0,
    "filter3": 0xA8,
    "filter4": 0xB0,
    "filter5": 0xB8,
    "filter6": 0xC0,
    "rates": 0xC8,
    "minima": 0xD0,
    "maxima": 0xD8,
    "near_saturation_value": 0xE0,
    "saturation_value": 0xE1,
    "command2": 0xE5,
    "command1": 0xE6,
    "command0": 0xE7,
    "counters": 0xE8,
    "reception_errors": 0xEE,
    "idle_count": 0xEF,
    "warnings": 0xF0,
    "errors": 0xF1,
    "threshold_bits": 0xF2,
    "last_crc": 0xF3,
    "eeprom_version": 0xF4,
    "software_version": 0xF5,
    "serial": 0xF8,
    "model": 0xF9,
    "units": 0xFC,
    "adc_bits": 0xFD,
    "channels": 0xFE,
    "thickness": 0xFF,
    "load_envelopes": 0x100,
    "transforms": 0x200,
}


def test_every_field_is_where_the_sources_have_it() -> None:
    assert {name: jr3.address_of(name) for name in GOLDEN} == GOLDEN


def test_no_two_fields_share_a_word_and_none_leaves_the_map() -> None:
    owners: dict[int, str] = {}
    for field in jr3.MAP:
        for address in range(field.address, field.address + field.length):
            assert 0 <= address < jr3.WORDS, field
            assert address not in owners, f"{address:X}: {owners[address]} and {field.name}"
            owners[address] = field.name
    assert len(jr3.FIELDS) == len(jr3.MAP)


def test_only_words_that_no_source_names_are_free() -> None:
    taken = {at for field in jr3.MAP for at in range(field.address, field.address + field.length)}
    free = sorted(set(range(0x100)) - taken)
    assert free == [*range(0x58, 0x60), 0x66, 0x67, 0x6E, 0x76, 0x7E]


def test_every_field_says_where_it_is_from_and_how_sure_that_is() -> None:
    for field in jr3.MAP:
        assert field.confidence in ("S", "L", "U"), field
        assert field.source, field
        assert set(field.source.split()) <= {"linux", "ocl", "uc3m", "springhead", "rojas", "thesis"}, field
        assert field.unit, field


def test_command_words_are_numbered_backwards() -> None:
    # Whoever takes E5 for the first command word writes an operand and waits for ever.
    assert [jr3.address_of(f"command{number}") for number in (2, 1, 0)] == [0xE5, 0xE6, 0xE7]


def test_the_thesis_s_31_hz_filter_is_filter_3_at_a8_with_the_counter_at_ea() -> None:
    cut_off_hz = [jr3.SAMPLE_RATE_HZ / 16 / 4 ** (number - 1) for number in range(1, 7)]
    assert cut_off_hz == [500.0, 125.0, 31.25, 7.8125, 1.953125, 0.48828125]
    assert (jr3.filter_address(3), jr3.counter_address(3)) == (0xA8, 0xEA)


@pytest.mark.parametrize(("name", "index"), [("offsets", 6), ("offsets", -1), ("counters", 6)])
def test_a_word_outside_its_field_is_refused(name: str, index: int) -> None:
    with pytest.raises(IndexError, match=name):
        jr3.address_of(name, index)
