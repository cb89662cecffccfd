"""An emulated sensor feels what a simulator publishes: the ``ft`` of another cell, shown by filter 0 at once.

The simulator's time stands still after a motion, and all its samples come in one packet. A sensor plays them at its own
rate, over and over, until there are others: whichever of them make a window, they are the same ones in another order.

Under ``jr3/shown`` of that cell it answers, with the simulator's own packet, once it shows the sample asked for:
``?sequence=7`` is answered while sample 7 is the one shown, else when it is; not when another one is, for an episode
that is begun anew goes through the same numbers again. So an emulated robot can wait until its sensor feels the motion,
and only then say that it has arrived.

The session has no role in that cell: with certificates it needs one that may hear ``ft``.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import TypeAlias

import zenoh
from zenoh.handlers import Callback

from services.bus.answers import Asked
from services.wire.codec import decode
from services.wire.errors import BadPayloadError, TreenailError
from services.wire.keys import FT, Keys
from services.wire.messages import FtPacket

SHOWN, FELT = "jr3/shown", "jr3/felt"
"""Keys in the simulator's cell, which are none of the contract."""
Load: TypeAlias = tuple[float, float, float, float, float, float]
"""Fx Fy Fz [N], Mx My Mz [N m]."""
FELT_S = 2.0
MOST_WAITING = 64
"""Questions that may wait for their sample; the oldest of more is refused."""

_OnSample: TypeAlias = "Callback[zenoh.Sample]"
_OnQuery: TypeAlias = "Callback[zenoh.Query]"


class Follower:
    """Follows one cell, on Zenoh's threads."""

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        feel: Callable[[Sequence[Load]], None],
        complain: Callable[[str], None],
    ) -> None:
        """``feel`` is given the newest loads and returns when one is shown; ``complain`` what cannot be followed."""
        self._feel, self._complain = feel, complain
        self._key = keys.of(SHOWN)
        self._lock = threading.Lock()
        self._shown: FtPacket | None = None
        self._waiting: list[tuple[int, Asked]] = []
        on_ft: _OnSample = Callback(self._on_ft, indirect=False)
        on_query: _OnQuery = Callback(self._on_query, indirect=False)
        self._declared = (
            session.declare_subscriber(keys.of(FT), on_ft),
            session.declare_queryable(self._key, on_query),
        )

    def catch_up(self, session: zenoh.Session, keys: Keys) -> None:
        """Feel what was published before we were there, if an emulated arm is there that knows it.

        Otherwise a sensor that is started again would show no load where there is one, until the next motion.
        """
        for reply in session.get(keys.of(FELT), timeout=FELT_S):
            if reply.ok is not None:
                self._on_ft(reply.ok, late=True)

    def _on_ft(self, sample: zenoh.Sample, late: bool = False) -> None:
        try:
            packet = decode(FtPacket, sample.payload.to_bytes(), str(sample.encoding))
        except TreenailError as error:
            self._complain(str(error))
            return
        with self._lock:
            if late and self._shown is not None:
                return
            self._feel(loads_of(packet))
            self._shown = packet
            ready = [asked for sequence, asked in self._waiting if sequence == packet.sequence]
            self._waiting = [waiting for waiting in self._waiting if waiting[0] != packet.sequence]
        for asked in ready:
            asked.reply(packet)

    def _on_query(self, query: zenoh.Query) -> None:
        asked = Asked(query, self._key, ("sequence",))
        try:
            sequence = _sequence(asked.request().parameters.get("sequence", "0"))
        except TreenailError as error:
            asked.refuse(error)
            return
        late: list[tuple[int, Asked]] = []
        with self._lock:
            shown = self._shown
            if shown is None or shown.sequence != sequence:
                shown = None
                self._waiting.append((sequence, asked))
                late, self._waiting = self._waiting[:-MOST_WAITING], self._waiting[-MOST_WAITING:]
        if shown is not None:
            asked.reply(shown)
        for _, other in late:
            other.refuse(BadPayloadError(f"{SHOWN}: expected at most {MOST_WAITING} questions that wait"))


def loads_of(packet: FtPacket) -> tuple[Load, ...]:
    """Return the samples of a packet, oldest first."""
    return tuple((*force, *torque) for force, torque in zip(packet.force_n, packet.torque_nm, strict=True))


def _sequence(text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) < 19):
        raise BadPayloadError(f"sequence: expected the number of a sample, as in ?sequence=7, got {text[:20]!r}")
    return int(text)
