"""Ports of this machine to listen on."""

from __future__ import annotations

import socket


def free_port(address: str = "127.0.0.1", port: int = 0) -> int:
    """Return ``port``, or a free one for 0.

    Raises OSError when it cannot be listened on at ``address``, and OverflowError for a number that is no port.
    """
    with socket.socket(socket.AF_INET6 if ":" in address else socket.AF_INET) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((address, port))
        return int(probe.getsockname()[1])
