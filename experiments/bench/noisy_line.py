"""A serial line in memory and in calculated time, with damage to order, and messages exchanged over it. Pure."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from services.robot_link.ddcmp.events import State
from services.robot_link.ddcmp.line import Ddcmp
from services.robot_link.ddcmp.settings import DdcmpSettings
from services.wire.errors import TreenailError

BYTE_S = 10 / 9600
"""Time of one byte at 9600 baud with start and stop bit."""
_LONGEST_PIECE = 64


class Damage(NamedTuple):
    """What a line does to bytes; probabilities of 0 to 1."""

    bit_errors: float = 0.0
    """For each bit to be turned over."""
    drops: float = 0.0
    """For each piece of 1 to 64 bytes to get lost."""
    duplicates: float = 0.0
    """For each piece to come twice in a row."""
    delay_s: float = 0.0
    """Longest time by which a piece is late; pieces never overtake each other."""


CLEAN = Damage()


class OneWay:
    """One direction of a line."""

    def __init__(self, damage: Damage, seed: int, byte_s: float = BYTE_S) -> None:
        """Take the damage, the seed of its draws and the time of one byte [s]."""
        self._damage, self._byte_s = damage, byte_s
        self._draws = np.random.Generator(np.random.Philox(key=seed))
        self._pieces: deque[tuple[float, bytes]] = deque()
        self._free_s = self._last_s = 0.0

    @property
    def next_s(self) -> float | None:
        """When the next piece arrives; None if nothing is under way."""
        return self._pieces[0][0] if self._pieces else None

    def put(self, data: bytes, now_s: float) -> None:
        """Send bytes."""
        self._free_s = max(self._free_s, now_s)
        at = 0
        while at < len(data):
            length = int(self._draws.integers(1, _LONGEST_PIECE + 1)) if self._damage != CLEAN else len(data)
            self._put_piece(data[at : at + length])
            at += length

    def take(self, now_s: float) -> bytes:
        """Return what has arrived by now."""
        arrived = b""
        while self._pieces and self._pieces[0][0] <= now_s:
            arrived += self._pieces.popleft()[1]
        return arrived

    def _put_piece(self, piece: bytes) -> None:
        damage, draws = self._damage, self._draws
        self._free_s += len(piece) * self._byte_s
        if damage != CLEAN:
            piece = (
                self._turned(piece) * int(draws.random() >= damage.drops) * (1 + (draws.random() < damage.duplicates))
            )
        if piece:
            late_s = draws.random() * damage.delay_s if damage.delay_s else 0.0
            self._last_s = max(self._last_s, self._free_s + late_s)
            self._pieces.append((self._last_s, piece))

    def _turned(self, piece: bytes) -> bytes:
        if not self._damage.bit_errors:
            return piece
        bits = np.unpackbits(np.frombuffer(piece, np.uint8))
        return np.packbits(bits ^ (self._draws.random(bits.size) < self._damage.bit_errors)).tobytes()


class Exchanged(NamedTuple):
    """What came of an exchange."""

    left: list[bytes]
    """What the left end received."""
    right: list[bytes]
    seconds: float
    """What it would have taken on the line."""
    ends: tuple[Ddcmp, Ddcmp]


def exchange(
    from_left: Sequence[bytes],
    from_right: Sequence[bytes],
    damage: Damage = CLEAN,
    *,
    seed: int = 0,
    most_outstanding: int = 20,
    settings: tuple[DdcmpSettings, DdcmpSettings] | None = None,
) -> Exchanged:
    """Send messages both ways at once, from start-up until both ends have all. Raises TreenailError if an end halts."""
    usual = DdcmpSettings(byte_s=BYTE_S)
    ends = tuple(Ddcmp(setting) for setting in settings or (usual, usual))
    ways = OneWay(damage, 2 * seed), OneWay(damage, 2 * seed + 1)
    texts = deque(from_left), deque(from_right)
    received: tuple[list[bytes], list[bytes]] = ([], [])

    def step(side: int, now_s: float) -> None:
        """Let one end take what has come, read all messages and send as many as it may."""
        end, out = ends[side], ways[side]
        came = ways[1 - side].take(now_s)
        out.put((end.receive(came, now_s) if came else end.tick(now_s)).reply, now_s)
        while (message := end.read()) is not None:
            received[side].append(message)
        while texts[side] and end.state is State.RUNNING and end.outstanding < most_outstanding:
            out.put(end.send(texts[side].popleft(), now_s), now_s)
        if end.failure is not None:
            raise TreenailError(f"{('left', 'right')[side]} end after {now_s:g} s: {end.failure}")

    def done() -> bool:
        return not any(texts) and not any(end.outstanding for end in ends)

    for side in (0, 1):
        ways[side].put(ends[side].start(0.0), 0.0)
    seconds = _run(step, done, lambda: [way.next_s for way in ways] + [end.next_deadline_s for end in ends])
    return Exchanged(*received, seconds, (ends[0], ends[1]))


def _run(
    step: Callable[[int, float], None], done: Callable[[], bool], times_s: Callable[[], Sequence[float | None]]
) -> float:
    """Go from one thing that happens to the next until all is done; return when that is."""
    now_s = 0.0
    while not done():
        upcoming = [time_s for time_s in times_s() if time_s is not None]
        if not upcoming:
            raise TreenailError(f"line: expected something to happen after {now_s:g} s, both ends wait")
        now_s = max(now_s, min(upcoming))
        for side in (0, 1):
            step(side, now_s)
    return now_s
