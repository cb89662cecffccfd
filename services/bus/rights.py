"""What we may do in a cell, as the router sees us: it denies in silence, so that it is better known before."""

from __future__ import annotations

from pathlib import Path

import zenoh

from services.bus.access import FOR_ALL, FOR_THE_CELL, may, who_may
from services.bus.tls import common_name
from services.wire.errors import NotAllowedError
from services.wire.keys import GUEST, OPERATOR

_ANSWER_S = 2.0
_TIMES = 5


class Rights:
    """The rights of one session; the router is asked when they are first needed."""

    def __init__(self, session: zenoh.Session, certs: Path | None) -> None:
        """``certs`` is the folder with our certificate, None without."""
        self._session = session
        self._certs = certs
        self._asked = False
        self._name: str | None = None

    @property
    def name(self) -> str | None:
        """Return who we are to the router; None for who may do everything, and where the router does not say."""
        if not self._asked:
            self._asked = True
            if self._certs is not None:
                self._name = common_name(self._certs)
            elif self._answers(FOR_ALL) and not self._answers(FOR_THE_CELL):
                self._name = GUEST
        return self._name

    def need(self, verb: str, key: str) -> None:
        """Raise NotAllowedError when we may not do that, a word of ``Access``, with a key of the contract."""
        name = self.name
        if name is None or may(name, verb, key):
            return
        if self._certs is None:
            way = "on the cell's machine be the user who started it, or use certificates"
        else:
            may_do = who_may(verb, key)
            who = OPERATOR if OPERATOR in may_do else " or ".join(may_do) or "nobody"
            way = f"only {who} may" if who == "nobody" else f"use the certificate of {who}, as in --certs certs/{who}"
        raise NotAllowedError(f"{key}: {name} may not {verb} this in the cell: {way}; see docs/security.md")

    def _answers(self, key: str) -> bool:
        for _ in range(_TIMES):
            replies = list(self._session.get(key, timeout=_ANSWER_S))
            if any(reply.ok is not None for reply in replies):
                return True
            if not replies:  # denied, or nobody answers it; a router too busy for that gives an error: its timeout
                break
        return False
