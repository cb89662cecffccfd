"""The door for who started the cell: a Unix socket beside the router's port, in a folder that only this user can enter.

Zenoh does not ask who somebody is when there are no certificates, and anybody who reaches a port can say that he is
anybody. The machine knows better: what lies in a folder of mode 700 is reached by its owner (and root) alone. So the
router gives the rights of the cell to who comes in here, and those of a guest to who comes in by the port.
"""

from __future__ import annotations

import os
import re
import socket
import stat
from pathlib import Path

from services.wire.errors import CellError

SCHEME = "unixsock-stream/"
_LOOPBACK = re.compile(r"^tcp/(?:127\.0\.0\.1|localhost|\[::1\]|0\.0\.0\.0|\[::\]):(\d{1,5})\Z")
_ANY = re.compile(r"^tcp/.*:(\d{1,5})\Z")


def folder() -> Path:
    """Return where this user's sockets are; not a temporary folder that an environment variable may change."""
    return Path("/tmp") / f"treenail-{os.getuid()}"


def listening(endpoint: str) -> str | None:
    """Return the endpoint of the socket beside a port to listen on, its folder made; None for what is no TCP port.

    Raises CellError when the folder is somebody else's, or others can enter it.
    """
    port = _ANY.match(endpoint)
    if port is None:
        return None
    here = folder()
    here.mkdir(mode=0o700, exist_ok=True)
    if not _ours_alone(here):
        raise CellError(
            f"router: expected {here} to be a folder of this user alone (mode 700); remove it and try again"
        )
    return f"{SCHEME}{_socket(port[1])}"


def connecting(endpoint: str) -> str | None:
    """Return the endpoint of the socket beside a port of this machine, when this user's router listens on it."""
    port = _LOOPBACK.match(endpoint)
    if port is None or not _ours_alone(folder()):
        return None
    path = _socket(port[1])
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
            probe.connect(str(path))
    except OSError:  # nobody listens: left over from a router that was killed
        return None
    return f"{SCHEME}{path}"


def _socket(port: str) -> Path:
    """Return the socket beside a port, which means another one in another network namespace."""
    return folder() / f"{os.stat('/proc/self/ns/net').st_ino}-{int(port)}"


def _ours_alone(path: Path) -> bool:
    try:
        about = path.lstat()
    except OSError:
        return False
    return stat.S_ISDIR(about.st_mode) and about.st_uid == os.getuid() and not about.st_mode & 0o077
