"""Roles: one process per service and cell holds one, and its messages count, nobody else's.

A role is held by a liveliness token ``claim/<service>/<instance>``; an instance is named after its claim's time and its
Zenoh session, the earlier one sorts first. Zenoh's timestamp of a message tells which session it came from.

Of two that come at once none has the role until one has looked, with its own token declared, and seen nobody: who sees
another takes its token back and tries again after a pause of its own. So two can never both believe that they have it,
whatever their clocks say and however long either is held up between its steps.
"""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable, Sequence
from typing import TypeAlias

import zenoh
from zenoh.handlers import Callback

from services.bus.session import LEASE_MS
from services.wire.errors import RoleTakenError, StrangerError
from services.wire.keys import CLAIM, Keys, name_of, wild

SampleHandler: TypeAlias = "Callback[zenoh.Sample]"

_LOOK_EVERY_S = 0.05
_AT_ONCE_NS = 1_000_000_000
"""Of claims made so close together one is likely to be taken back at once."""
SETTLE_S = 0.25
"""How long an earlier claim of the same cell of a fleet may take to be seen."""


class Roles:
    """Who holds which role in one cell, as far as one process knows."""

    def __init__(self, session: zenoh.Session, keys: Keys, name: str) -> None:
        self.ousted: RoleTakenError | None = None
        """Set when an earlier holder of our own role, cut off from the router when we claimed it, is back."""
        self._session = session
        self.instance = ""
        """Named when the role is claimed."""
        self.keys = keys
        self._name = name
        self._earlier: dict[str, bool] = {}
        """Claims of our role made shortly before ours, and whether a beat has passed since we saw it."""
        self._holders: dict[str, set[str]] = {}
        """Sessions of who holds a role; a role that nobody has held yet is not in it."""
        self._declared: list[object] = []

    def follow(self, post: Callable[[zenoh.Sample], None]) -> None:
        """Have ``note`` called, by way of ``post``, with what anybody in the cell claims, now and later."""
        callback: SampleHandler = Callback(post, indirect=False)
        key = self.keys.of(wild(CLAIM))
        self._declared.append(self._session.liveliness().declare_subscriber(key, callback, history=True))

    def attempt(self, settle_s: float = 0.0) -> RoleTakenError | None:
        """Take this process's role if it is free; otherwise return who has it, with nothing left behind.

        With ``settle_s`` it is looked again after that time whether somebody earlier has come.
        """
        if others := self._others():
            return self._taken_error(others)
        self.instance = f"{_named(time.time_ns())}-{self._session.zid()}"
        token = self._session.liveliness().declare_token(
            self.keys.of(name_of(CLAIM, service=self._name, instance=self.instance))
        )
        others = self._others()
        if settle_s > 0.0 and not others:
            time.sleep(settle_s)
            others = [other for other in self._others() if other < self.instance]
        if others:
            token.undeclare()  # type: ignore[no-untyped-call]
            return self._taken_error(others)
        self._declared.append(token)
        return None

    def note(self, sample: zenoh.Sample) -> None:
        """Note that a claim came or went."""
        role, instance = str(sample.key_expr).split("/")[-2:]
        holders = self._holders.setdefault(role, set())
        session = instance.rpartition("-")[2]
        if sample.kind == zenoh.SampleKind.DELETE:
            holders.discard(session)
            if role == self._name:
                self._earlier.pop(instance, None)
            return
        holders.add(session)
        if role == self._name and instance < self.instance:
            if instance < _named(int(self.instance.partition("-")[0]) - _AT_ONCE_NS):
                self.ousted = self._taken_error([instance])
            else:
                self._earlier[instance] = False

    def on_beat(self) -> None:
        """Give way to a claim made at once with ours that was not taken back."""
        if stayed := [instance for instance, beaten in self._earlier.items() if beaten]:
            self.ousted = self._taken_error(stayed)
        self._earlier = dict.fromkeys(self._earlier, True)

    def check_sender(self, sample: zenoh.Sample, roles: tuple[str, ...]) -> None:
        """Raise StrangerError for a message of none of the roles' holders; any sender will do while there was none."""
        held = [self._holders[role] for role in roles if role in self._holders]
        sender = None if sample.timestamp is None else str(sample.timestamp.get_id())
        if held and not any(sender in holders for holders in held):
            raise StrangerError(f"{sample.key_expr}: expected a message of {' or '.join(roles)}, got one of {sender}")

    def check_holder(self, sample: zenoh.Sample, roles: tuple[str, ...]) -> None:
        """Raise StrangerError for a message of anybody but who holds one of the roles at this moment."""
        sender = None if sample.timestamp is None else str(sample.timestamp.get_id())
        if not any(sender in self._holders.get(role, ()) for role in roles):
            expected = f"expected a message of who holds the role of {' or '.join(roles)}"
            raise StrangerError(f"{sample.key_expr}: {expected}, got one of {sender}")

    def _others(self) -> list[str]:
        replies = self._session.liveliness().get(self.keys.of(name_of(CLAIM, service=self._name)), timeout=1.0)
        instances = (str(reply.ok.key_expr).rpartition("/")[2] for reply in replies if reply.ok is not None)
        ours = str(self._session.zid())
        return [instance for instance in instances if instance.rpartition("-")[2] != ours]

    def _taken_error(self, others: list[str]) -> RoleTakenError:
        return RoleTakenError(
            f"{self._name}: expected to be the only one in cell {self.keys.cell!r}, "
            f"but {len(others)} other has this role (instance {others[0]})"
        )


def take_role(
    session: zenoh.Session,
    cells: Sequence[Keys],
    name: str,
    stopping: Callable[[], bool],
    say: Callable[[RoleTakenError], None],
) -> Roles | None:
    """Take a role in the first of some cells where nobody has it, waiting until there is one; None when stopped.

    ``say`` is told, every now and then, who has it meanwhile: nobody ends because of what somebody else does.
    """
    patience = time.monotonic() + 2.0 * LEASE_MS / 1000  # a predecessor that just died may still be listed
    while not stopping():
        for keys in cells:
            roles = Roles(session, keys, name)
            # Who finds out too late that another has taken the same cell has to leave it, though another cell is free.
            taken = roles.attempt(SETTLE_S if len(cells) > 1 else 0.0)
            if taken is None:
                return roles
        if time.monotonic() > patience and taken is not None:
            names = f"{cells[0].cell} to {cells[-1].cell}"
            all_taken = f"{name}: expected one of the {len(cells)} cells {names} to be without one, all have theirs"
            say(taken if len(cells) == 1 else RoleTakenError(all_taken))
        # Two that keep seeing each other would for ever, if they came back at the same time.
        time.sleep(_LOOK_EVERY_S * (0.5 + secrets.randbelow(100) / 100))
    return None


def _named(claimed_ns: int) -> str:
    """Return how the names of claims of a time begin: later ones sort later."""
    return f"{claimed_ns:020d}"
