"""What goes with every sample of rmw_zenoh: its number, when it was sent, and by whom. Pure; exact, or not at all.

33 bytes: number and time [ns] as int64, 16, then the 16 bytes of the publisher's gid; all little-endian. Older versions
write the name of each field before it, with its length in one byte: 77 bytes. A process of ROS that expects one of them
and gets the other may abort, so nobody guesses.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from services.ros2.distributions import Distribution
from services.ros2.errors import PeerError

GID_BYTES = 16
_PLAIN = struct.Struct("<qqB16s")
_NAMED = struct.Struct("<B15sqB16sqB10sB16s")
_WORDS = (b"sequence_number", b"source_timestamp", b"source_gid")
_MOST = 1 << 63


class Attachment(NamedTuple):
    """One sample's."""

    sequence: int
    """Counts the publisher's samples, from 1."""
    t_ns: int
    """Time of day of the publisher's machine."""
    gid: bytes
    """Of the publisher."""


def written(attachment: Attachment, distribution: Distribution) -> bytes:
    """Return the bytes that a distribution expects. Raises PeerError for what does not go into them."""
    sequence, t_ns, gid = attachment
    if not (0 < sequence < _MOST and 0 <= t_ns < _MOST and len(gid) == GID_BYTES):
        raise PeerError(f"attachment: expected a number from 1, a time from 0 and {GID_BYTES} bytes, got {attachment}")
    if not distribution.named:
        return _PLAIN.pack(sequence, t_ns, GID_BYTES, gid)
    number, time, who = _WORDS
    return _NAMED.pack(len(number), number, sequence, len(time), time, t_ns, len(who), who, GID_BYTES, gid)


def read(data: bytes | None, distribution: Distribution) -> Attachment:
    """Return what came with a sample. Raises PeerError for what this distribution does not write."""
    layout = _NAMED if distribution.named else _PLAIN
    if data is None:
        raise PeerError("attachment: expected one with every sample, got none; is that a publisher of rmw_zenoh?")
    if len(data) != layout.size:
        other = _PLAIN if distribution.named else _NAMED
        hint = ", that of another version of rmw_zenoh: see --distribution" if len(data) == other.size else ""
        raise PeerError(f"attachment: expected the {layout.size} bytes of {distribution.name}, got {len(data)}{hint}")
    if distribution.named:
        *words, size, gid = _NAMED.unpack(data)
        sequence, t_ns = int(words[2]), int(words[5])
        told = (words[0], words[1], words[3], words[4], words[6], words[7])
        if told != tuple(part for word in _WORDS for part in (len(word), word)):
            raise PeerError("attachment: expected its fields by name, got other names")
    else:
        sequence, t_ns, size, gid = _PLAIN.unpack(data)
    if size != GID_BYTES or sequence < 0 or t_ns < 0:
        raise PeerError(f"attachment: expected number, time and {GID_BYTES} bytes, got {sequence}, {t_ns} and {size}")
    return Attachment(sequence, t_ns, bytes(gid))
