"""Which address a browser is sent to: the one that it came by, whatever this machine is called over there."""

from __future__ import annotations

import ipaddress
import re
from urllib.parse import parse_qsl, urlencode

from services.wire.errors import TreenailError

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,252}")
_PORT = re.compile(r"[0-9]{1,5}")
_MOST_PARAMETERS = 20
HTTP_PORT = 80
"""What a browser means when it names no port."""

SETTINGS = {"theme": "dark", "hide_welcome_screen": "1"}
"""Parameters of Rerun's page, unless the browser says otherwise; the colours of the curves are made for the dark."""


class BadRequestError(TreenailError):
    """A browser, or what passes for one, asked for something that cannot be."""


def place_of(header: str) -> str:
    """Return what a Host header names, ready for a URL: HOST:PORT with a name, an IPv4 or a bracketed IPv6 address.

    Raises BadRequestError for anything else: what comes back from here goes into an address that a browser follows.
    """
    if header.startswith("["):
        inner, closed, rest = header[1:].partition("]")
        try:
            host = f"[{ipaddress.IPv6Address(inner)}]"
        except ValueError:
            raise _bad(header) from None
        colon, port = rest[:1], rest[1:]
        if not closed or "%" in host:
            raise _bad(header)
    else:
        host, colon, port = header.partition(":")
        if not _NAME.fullmatch(host):
            raise _bad(header)
    if colon and not (colon == ":" and _PORT.fullmatch(port)):
        raise _bad(header)
    return f"{host}:{port or HTTP_PORT}"


def bracketed(address: str) -> str:
    """Return an address as a URL has it: IPv6 in brackets, without a zone."""
    return f"[{address.partition('%')[0]}]" if ":" in address else address


def location(place: str, query: str) -> str | None:
    """Return where a browser must go to see the stream at ``place``, HOST:PORT; None when ``query`` says it already.

    Raises BadRequestError for a query that is none.
    """
    try:
        asked = parse_qsl(query, keep_blank_values=True, max_num_fields=_MOST_PARAMETERS)
    except ValueError:
        raise BadRequestError(f"query: expected at most {_MOST_PARAMETERS} parameters, got more") from None
    names = {name for name, _ in asked}
    if "url" in names:
        return None
    added = [("url", f"rerun+http://{place}/proxy")]
    added += [(name, value) for name, value in SETTINGS.items() if name not in names]
    return "/?" + urlencode(added + asked)


def _bad(header: str) -> BadRequestError:
    return BadRequestError(f"Host header: expected HOST or HOST:PORT, got {header[:80]!r}")
