"""Roles: one process per service and cell holds one, and its messages count, nobody else's.

A role is held by a liveliness token ``claim/<service>/<instance>``; an instance is named after its start and its Zenoh
session, the earlier one sorts first. Zenoh's timestamp of a message tells which session it came from.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeAlias

import zenoh
from zenoh.handlers import Callback

from services.wire.errors import RoleTakenError, StrangerError
from services.wire.keys import Keys
from services.wire.session import LEASE_MS

SampleHandler: TypeAlias = "Callback[zenoh.Sample]"


class Roles:
    """Who holds which role, as far as one process knows. All but ``claim`` only reads and notes: no waiting."""

    def __init__(self, session: zenoh.Session, keys: Keys, name: str) -> None:
        self.instance = f"{time.time_ns():020d}-{session.zid()}"
        self.ousted: RoleTakenError | None = None
        """Set when an earlier holder of our own role, cut off from the router when we claimed it, is back."""
        self._session = session
        self._keys = keys
        self._name = name
        self._holders: dict[str, set[str]] = {}
        """Sessions of who holds a role; a role that nobody has held yet is not in it."""
        self._declared: list[object] = []

    def claim(self, stopping: Callable[[], bool], post: Callable[[zenoh.Sample], None]) -> None:
        """Take this process's role, and have ``note`` called, by way of ``post``, with what others claim.

        Raises RoleTakenError when another process keeps it.
        """
        deadline = time.monotonic() + 2.0 * LEASE_MS / 1000  # a predecessor that just died may still be listed
        while others := self._others():
            if time.monotonic() > deadline or stopping():
                raise self._taken(others)
            time.sleep(0.05)
        liveliness = self._session.liveliness()
        self._declared.append(liveliness.declare_token(self._keys.of(f"claim/{self._name}/{self.instance}")))
        if earlier := [other for other in self._others() if other < self.instance]:
            raise self._taken(earlier)
        callback: SampleHandler = Callback(post, indirect=False)
        self._declared.append(liveliness.declare_subscriber(self._keys.of("claim/*/*"), callback, history=True))

    def note(self, sample: zenoh.Sample) -> None:
        """Note that a claim came or went."""
        role, instance = str(sample.key_expr).split("/")[-2:]
        holders = self._holders.setdefault(role, set())
        session = instance.rpartition("-")[2]
        if sample.kind == zenoh.SampleKind.DELETE:
            holders.discard(session)
            return
        holders.add(session)
        if role == self._name and instance < self.instance:
            self.ousted = self._taken([instance])

    def check_sender(self, sample: zenoh.Sample, roles: tuple[str, ...]) -> None:
        """Raise StrangerError for a message of none of the roles' holders; any sender will do while there was none."""
        held = [self._holders[role] for role in roles if role in self._holders]
        sender = None if sample.timestamp is None else str(sample.timestamp.get_id())
        if held and not any(sender in holders for holders in held):
            raise StrangerError(f"{sample.key_expr}: expected a message of {' or '.join(roles)}, got one of {sender}")

    def _others(self) -> list[str]:
        replies = self._session.liveliness().get(self._keys.of(f"claim/{self._name}/*"), timeout=1.0)
        found = (str(reply.ok.key_expr).rpartition("/")[2] for reply in replies if reply.ok is not None)
        return [instance for instance in found if instance != self.instance]

    def _taken(self, others: list[str]) -> RoleTakenError:
        return RoleTakenError(
            f"{self._name}: expected to be the only one in cell {self._keys.cell!r}, "
            f"but {len(others)} other has this role (instance {others[0]})"
        )
