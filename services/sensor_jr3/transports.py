"""Ways to a card, by URL: ``isa:0x260`` or ``tcp://host:port``; and why others are none."""

from __future__ import annotations

import re

from services.sensor_jr3.card import Card, UrlError
from services.sensor_jr3.isa import MOST_BASE, IsaCard
from services.sensor_jr3.tcp import TcpCard

EXPECTED = "expected isa:0x260 or tcp://host:port"
_ISA = re.compile(r"isa:(0x[0-9a-f]{1,4}|[1-9]\d{0,4})\Z", re.ASCII | re.IGNORECASE)
_TCP = re.compile(r"tcp://(\[[0-9a-f:.]+\]|[a-z0-9_.-]+):(\d{1,5})\Z", re.ASCII | re.IGNORECASE)
_NO_WAY = {
    "comedi": "comedi's driver gives filtered values only, without sample counters and error bits: "
    "neither a lost sample nor a saturated or unplugged sensor could be told",
    "jr3": "the character device of jr3pci-linux gives filtered values only, without sample counters and error bits: "
    "neither a lost sample nor a saturated or unplugged sensor could be told",
    "port": "/dev/port makes byte-wide cycles, and the card needs 16 bits at once",
    "pci": "public drivers disagree where a PCI card has its words, and it needs a firmware that is not public",
}


def host_and_port(url: str) -> tuple[str, int]:
    """Return host and port of a ``tcp://`` URL. Raises UrlError."""
    match = _TCP.match(url)
    if match is None or int(match.group(2)) > 65535:
        raise UrlError(f"url: expected tcp://host:port, got {url[:80]!r}")
    return match.group(1).strip("[]"), int(match.group(2))


def check(url: str) -> None:
    """Raise UrlError for what is no way to a card, with the reason."""
    # A device's name does as well as a scheme: both are refused for the same reason.
    scheme = url.removeprefix("/dev/").partition(":")[0].lower()
    for name, why in _NO_WAY.items():
        if scheme.removeprefix(name).isdigit() or scheme == name:
            raise UrlError(f"url: {EXPECTED}, got {url[:80]!r}: {why}")
    if scheme == "tcp":
        host_and_port(url)
        return
    match = _ISA.match(url)
    if match is None:
        raise UrlError(f"url: {EXPECTED}, got {url[:80]!r}")
    base = int(match.group(1), 0)
    if not (0x100 <= base <= MOST_BASE and base % 4 == 0):
        raise UrlError(f"url: isa: expected a base of 0x100 to {MOST_BASE:#x}, a multiple of 4, got {base:#x}")


def open_card(url: str) -> Card:
    """Return the card at a URL. Raises UrlError, SettingError when it cannot ever be, LinkError when it is not now."""
    check(url)
    if url.lower().startswith("tcp:"):
        return TcpCard(*host_and_port(url))
    return IsaCard(int(url.partition(":")[2], 0))
