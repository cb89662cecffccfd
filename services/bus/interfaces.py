"""This machine's network interfaces, by name and by address."""

from __future__ import annotations

import fcntl
import socket
import struct

from services.wire.errors import CellError

_SIOCGIFADDR = 0x8915


def interface_of(name: str) -> str:
    """Return the interface that is called ``name``, or has the IPv4 address that ``name`` is or stands for.

    Raises CellError when there is none.
    """
    addresses = {interface: _address(interface) for _, interface in socket.if_nameindex()}
    if name in addresses:
        return name
    try:
        wanted = socket.gethostbyname(name)
    except OSError as error:
        wanted = str(error)
    for interface, address in addresses.items():
        if address == wanted:
            return interface
    have = ", ".join(f"{interface} ({address or 'no address'})" for interface, address in addresses.items())
    raise CellError(
        f"--trust {name}: expected an interface of this machine or its address, got {wanted}; it has {have}"
    )


def _address(interface: str) -> str | None:
    """Return an interface's IPv4 address, or None without one."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            packed = fcntl.ioctl(probe, _SIOCGIFADDR, struct.pack("256s", interface.encode()[:15]))
        except OSError:
            return None
    return socket.inet_ntoa(packed[20:24])
