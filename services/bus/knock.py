"""Whether anybody listens at an endpoint of Zenoh's, found out at once and without Zenoh."""

from __future__ import annotations

import socket

PATIENCE_S = 1.0
"""How long a host may take to refuse; one that takes longer may be there."""


def nobody_listens(endpoint: str) -> bool:
    """Return whether an endpoint, such as ``tcp/127.0.0.1:7447``, refuses connections; False when that is uncertain."""
    kind, _, rest = endpoint.partition("/")
    place = rest.partition("#")[0].partition("?")[0]
    if kind == "unixsock-stream":
        with socket.socket(socket.AF_UNIX) as here:
            return _refuses(here, place)
    if kind not in ("tcp", "tls"):
        return False
    host, _, port = place.rpartition(":")
    try:
        candidates = socket.getaddrinfo(host.strip("[]"), port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):
        return False
    for family, _, _, _, address in candidates:
        with socket.socket(family, socket.SOCK_STREAM) as there:
            if not _refuses(there, address):
                return False
    return True


def _refuses(connection: socket.socket, address: str | tuple[object, ...]) -> bool:
    connection.settimeout(PATIENCE_S)
    try:
        connection.connect(address)
    except (ConnectionRefusedError, FileNotFoundError):
        return True
    except (OSError, OverflowError):
        return False
    return False
