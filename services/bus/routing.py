"""Zenoh's own router in a session: who may do what, and nobody who watches can hold up those who work."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import zenoh

from services.bus import runtime
from services.bus.access import FOR_ALL, FOR_THE_CELL, ROUTER, by_certificate, by_door
from services.bus.own_socket import SCHEME
from services.bus.session import brief, config
from services.bus.tls import check_endpoints, identity
from services.wire.errors import CellError

# What is published and finds no room on its way to one hearer is lost to that hearer: a reader that stopped would
# otherwise fill its queue, and after it that of everybody whose messages it gets. The cell does not count on any
# message: whoever misses one asks for it. See docs/decisions/0003-zenoh-runtime.md.
_LOST_TO_THE_SLOW = {
    "id": "lost-to-the-slow",
    "messages": ["put", "delete"],
    "flows": ["egress"],
    "key_exprs": ["**"],
    "overwrite": {"congestion_control": "drop"},
}
# An answer must not be lost, but who does not take his for so long [us] loses his connection.
_TAKES_NOTHING_US = 100_000
# Who connects and says nothing [ms] makes room for others; so many may be at it at a time.
_SILENT_MS = 1000
_AT_A_TIME = 1000


def open_router(
    endpoints: Sequence[str], certs: Path | None = None, trusted: Sequence[str] = (), ros2: Sequence[int] = ()
) -> zenoh.Session:
    """Return a session that is Zenoh's own router, listening on ``endpoints``.

    With ``certs``, the folder with the router's certificate, only clients with a certificate of the same authority can
    connect, and each may do what services.bus.access says. Without, who comes in by a Unix socket or by one of the
    ``trusted`` network interfaces may do all, everybody else what a guest may, and in the domains ``ros2``
    all that ROS 2 does. Raises CellError when it cannot.
    """
    check_endpoints(endpoints, certs)
    runtime.use(runtime.ROUTER)
    settings: dict[str, object] = {
        "mode": "router",
        "listen": {"endpoints": list(endpoints)},
        "connect": {"endpoints": []},
        "adminspace": {"enabled": True},
        "qos": {"network": [_LOST_TO_THE_SLOW]},
        "access_control": by_door(trusted, ros2) if certs is None else by_certificate(),
    }
    tls = None if certs is None else identity(certs, ROUTER).zenoh(listen=True)
    unicast = {"accept_timeout": _SILENT_MS, "accept_pending": _AT_A_TIME, "max_sessions": _AT_A_TIME}
    queue = {"congestion_control": {"block": {"wait_before_close": _TAKES_NOTHING_US}}}
    try:
        session = zenoh.open(config(settings, tls, unicast, queue))
    except zenoh.ZError as error:
        where = ", ".join(endpoint for endpoint in endpoints if not endpoint.startswith(SCHEME)) or endpoints[0]
        raise CellError(f"router: cannot listen on {where}: is the port taken? ({brief(error)})") from None
    # In this order: who gets an answer to the second and none to the first is a guest, also while we start.
    for key in (FOR_THE_CELL, FOR_ALL):
        session.declare_queryable(key, _say_so, complete=True)
    return session


def _say_so(query: zenoh.Query) -> None:
    """Answer who may ask: access control does not let through what others ask."""
    with query:
        query.reply(query.key_expr, b"")
