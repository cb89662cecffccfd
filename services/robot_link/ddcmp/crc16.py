"""CRC-16 as DDCMP uses it: x^16 + x^15 + x^2 + 1, lowest bit first, from zero, sent low byte first. Pure."""

from __future__ import annotations

REFLECTED_POLYNOMIAL = 0xA001


def _entry(byte: int) -> int:
    for _ in range(8):
        byte = (byte >> 1) ^ (REFLECTED_POLYNOMIAL if byte & 1 else 0)
    return byte


_TABLE = tuple(_entry(byte) for byte in range(256))


def crc16(data: bytes) -> int:
    """Return the CRC of ``data``, 0 to 65535. Of data that end with their own CRC it is 0."""
    crc = 0
    for byte in data:
        crc = (crc >> 8) ^ _TABLE[(crc ^ byte) & 0xFF]
    return crc


def with_crc(data: bytes) -> bytes:
    """Return ``data`` with its CRC behind it."""
    return data + crc16(data).to_bytes(2, "little")
