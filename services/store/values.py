"""What goes into the store and comes out of it: operations, values, timestamps and key ranges; nothing of files."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

from zenoh import NTP64, KeyExpr, Timestamp, ZError

from services.bus.session import brief

LARGEST_PAYLOAD_BYTES = 1 << 28

_TIMESTAMP = re.compile(r"[0-9a-f]{16}/[0-9a-f]{32}")


class StoredValue(NamedTuple):
    """What a key holds. ``timestamp`` is in the form of ``timestamp_text``."""

    key: str
    payload: bytes
    encoding: str
    timestamp: str


class StoredKey(NamedTuple):
    """A key with the size of its payload in bytes and the timestamp of its value."""

    key: str
    size_bytes: int
    timestamp: str


@dataclass(frozen=True, slots=True)
class Put:
    """A value for a key.

    ``key`` is a canonical key without wildcards, ``timestamp`` in the form of ``timestamp_text``, ``payload`` at most
    256 MiB; ValueError otherwise, so that one bad message cannot spoil the batch that it would be in.
    """

    key: str
    payload: bytes
    encoding: str
    timestamp: str

    def __post_init__(self) -> None:
        _check_operation(self.key, self.timestamp)
        if len(self.payload) > LARGEST_PAYLOAD_BYTES:
            raise ValueError(
                f"payload of {self.key}: expected at most {LARGEST_PAYLOAD_BYTES} bytes, got {len(self.payload)}"
            )


@dataclass(frozen=True, slots=True)
class Delete:
    """Removal of a key. Fields are checked as in ``Put``."""

    key: str
    timestamp: str

    def __post_init__(self) -> None:
        _check_operation(self.key, self.timestamp)


def timestamp_text(timestamp: Timestamp) -> str:
    """Exact text of a Zenoh timestamp that sorts as the timestamps do: 16 hex digits of time, "/", 32 of identifier.

    The time is NTP64: seconds since 1970 times 2**32. Zenoh compares identifiers byte by byte, first byte first,
    so they are written in that order (Zenoh's own text has them the other way round).
    """
    time = int(str(timestamp.get_time_as_ntp64()))
    return f"{time:016x}/{bytes(timestamp.get_id()).ljust(16, bytes(1)).hex()}"


def zenoh_timestamp(text: str) -> Timestamp:
    """Turn a ``timestamp_text`` back into a Zenoh timestamp: exact if its time is a whole number of nanoseconds.

    Zenoh's Python API builds times from nanoseconds only. Any other time (3 of 4 that a session makes) comes back as
    the next nanosecond, less than 1 ns later, as ``Timestamp.parse_rfc3339`` would give it: its
    ``to_string_rfc3339_lossy`` is that of the original, and it is never earlier than the original. ValueError if
    ``text`` has another form.
    """
    _check_timestamp(text)
    seconds, fraction = divmod(int(text[:16], 16), 1 << 32)
    nanoseconds = -(-fraction * 10**9 >> 32)
    if seconds == (1 << 32) - 1:
        # Zenoh aborts on a time past its last second, in 2106.
        nanoseconds = min(nanoseconds, 10**9 - 1)
    return Timestamp(NTP64(seconds, nanoseconds), bytes.fromhex(text[17:]))


def key_range(expression: str) -> tuple[str, str | bytes]:
    """Bounds (low, high) such that every key that intersects ``expression`` has low <= key < high in SQLite's order.

    They come from the chunks before the first one with a wildcard. A bound that no key reaches is an empty blob.
    """
    chunks = expression.split("/")
    wild = next((index for index, chunk in enumerate(chunks) if "*" in chunk), len(chunks))
    prefix = "/".join(chunks[:wild])
    if wild == len(chunks):
        return prefix, prefix + "\0"
    if not prefix:
        return "", b""
    # "a/**" includes "a" itself; "0" is the character after "/".
    return (prefix if chunks[wild] == "**" else prefix + "/"), prefix + "0"


@lru_cache(maxsize=256)
def key_expression(text: str) -> KeyExpr:
    """Return the key expression, from memory if it was used lately; ValueError if ``text`` is not a canonical one."""
    try:
        return KeyExpr(text)
    except ZError as error:
        raise ValueError(f"key expression: expected a canonical one, got {text!r}: {brief(error)}") from error


def _check_timestamp(text: str) -> None:
    if not _TIMESTAMP.fullmatch(text) or text.endswith("/" + "0" * 32):
        raise ValueError(f"timestamp: expected 16 hex digits, '/', 32 hex digits not all 0, got {text!r}")


def _check_operation(key: str, timestamp: str) -> None:
    try:
        KeyExpr(key)
    except ZError as error:
        raise ValueError(f"key: expected a canonical key expression, got {key!r}: {brief(error)}") from error
    if "*" in key:
        raise ValueError(f"key: expected one key, got {key!r}: a wildcard would reach what belongs to others")
    _check_timestamp(timestamp)
