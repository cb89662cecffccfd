"""Zenoh sessions: every service is a client of one router; scouting off, explicit endpoints, timestamps on."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

# A timestamp says who sent a message. One that is further ahead of the own clock than this would be replaced by whoever
# gets it, as if it were a message of his own: then a clock that jumps, or two machines half a second apart, would stop
# the cell. Nothing here takes these timestamps for the time of day. They follow the clock that is furthest ahead, only
# not into 2106, where Zenoh's time ends: one message from there would stop the cell for good.
os.environ.setdefault("UHLC_MAX_DELTA_MS", str(20 * 366 * 24 * 3600 * 1000))

import zenoh

from services.bus import own_socket, runtime
from services.bus.tls import check_endpoints, identity, trouble
from services.wire.errors import CellError

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
DEFAULT_SECURE_ENDPOINT = "tls/127.0.0.1:7447"
LEASE_MS = 1000
"""How long a silent peer counts as present; a dead process is noticed at once, a frozen host after this."""

_PIECE_S = 0.5

_PRIORITIES = (
    "control",
    "real_time",
    "interactive_high",
    "interactive_low",
    "data_high",
    "data",
    "data_low",
    "background",
)


def config(
    settings: Mapping[str, object],
    tls: Mapping[str, object] | None,
    unicast: Mapping[str, object] | None = None,
    queue: Mapping[str, object] | None = None,
) -> zenoh.Config:
    """Return a session's configuration: what all have in common, and ``settings``.

    ``tls`` is None for sessions without encryption, which then cannot be asked for by an endpoint either. ``unicast``
    and ``queue`` say how connections are accepted, and more about the queues before them.
    """
    sizes = {"size": dict.fromkeys(_PRIORITIES, 16)}
    link: dict[str, object] = {"tx": {"lease": LEASE_MS, "queue": {**sizes, **(queue or {})}}}
    if tls is not None:
        link |= {"tls": tls, "protocols": ["tls"]}
    common: dict[str, object] = {
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "timestamping": {"enabled": True},
        "transport": {"link": link, "unicast": unicast or {}, "shared_memory": {"enabled": False}},
    }
    return zenoh.Config.from_json5(json.dumps({**common, **settings}))


def open_client(
    endpoints: Sequence[str],
    timeout_s: float = 30.0,
    stopping: Callable[[], bool] = lambda: False,
    certs: Path | None = None,
    name: str | None = None,
) -> zenoh.Session:
    """Return a session with the router at one of ``endpoints``, waiting for it to come up.

    A router of this user's on this machine is entered by its own socket, with all rights. ``stopping`` is asked now and
    then whether to give up. ``certs`` is the folder with the certificate of ``name`` (None: anybody's) for mutual TLS.
    Raises CellError when none answers within ``timeout_s``, when an endpoint is malformed, when the certificate cannot
    be used, and when router and we refuse each other's.
    """
    check_endpoints(endpoints, certs)
    runtime.use(runtime.SERVICE)
    us = None if certs is None else identity(certs, name)
    tls = None if us is None else us.zenoh(listen=False)
    deadline = time.monotonic() + timeout_s
    retry = {"period_init_ms": 50, "period_max_ms": 200, "period_increase_factor": 2}
    while True:
        # Zenoh's own waiting cannot be interrupted, so it is done in pieces.
        began, piece_s = time.monotonic(), max(0.01, min(_PIECE_S, deadline - time.monotonic()))
        doors = _doors(endpoints) if certs is None else list(endpoints)
        connect = {"endpoints": doors, "timeout_ms": int(piece_s * 1000), "retry": retry}
        try:
            session = zenoh.open(config({"mode": "client", "connect": connect}, tls))
            if certs is not None or doors == _doors(endpoints):
                return session
            session.close()  # type: ignore[no-untyped-call]  # the router came up meanwhile: now by its own socket
        except zenoh.ZError as error:
            at_once = time.monotonic() < began + piece_s / 2
            troubles = [] if us is None else [problem for item in endpoints if (problem := trouble(item, us))]
            if troubles and len(troubles) == len(endpoints) and all(problem.final for problem in troubles):
                raise CellError("; ".join(problem.reason for problem in troubles)) from None
            if at_once or time.monotonic() >= deadline or stopping():
                where = ", ".join(endpoints)
                waited = "" if at_once else f", none answered within {timeout_s:g} s"
                why = "; ".join(problem.reason for problem in troubles) or brief(error)
                raise CellError(f"router: expected one at {where}{waited} ({why})") from None


def _doors(endpoints: Sequence[str]) -> list[str]:
    """Return by what to go in for each endpoint: the router's own socket, where we may, or the port."""
    return [own_socket.connecting(endpoint) or endpoint for endpoint in endpoints]


def come_after(session: zenoh.Session, samples: Iterable[zenoh.Sample]) -> None:
    """See to it that a session's timestamps come after those of stored values, also when the clock was set back."""
    newest = max((sample for sample in samples if sample.timestamp is not None), key=_time_of, default=None)
    if newest is not None and _time_of(newest) >= _ntp64(session.new_timestamp()):
        # A session's clock follows the messages that it sends and gets, but not answers, and cannot be set. A stored
        # value that is put again with its own timestamp changes nothing in the store.
        session.put(newest.key_expr, newest.payload, encoding=newest.encoding, timestamp=newest.timestamp)


def _time_of(sample: zenoh.Sample) -> int:
    return 0 if sample.timestamp is None else _ntp64(sample.timestamp)


def _ntp64(timestamp: zenoh.Timestamp) -> int:
    """Return the time of a timestamp as Zenoh counts it: in units of 2**-32 s."""
    return int(str(timestamp.get_time_as_ntp64()))


def brief(error: Exception) -> str:
    """Return the first sentence of one of Zenoh's many-part errors."""
    return str(error).split(" at ")[0].strip()[:200] or type(error).__name__
