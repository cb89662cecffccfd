"""Clocks that are ahead or set back: messages keep their sender, and what is put last is what the store shows."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import zenoh

from services.bus.session import come_after, open_client

NAME = "checkpoint/notes/a"


def ahead(session: zenoh.Session) -> zenoh.Timestamp:
    """Return a session's timestamp as its clock would give it in a year."""
    time, _, name = session.new_timestamp().to_string_rfc3339_lossy().partition("/")
    year, _, rest = time.partition("-")
    return zenoh.Timestamp.parse_rfc3339(f"{int(year) + 1}-{rest.replace('02-29', '02-28')}/{name}")


def test_a_message_that_is_ahead_of_everybodys_clock_keeps_its_sender(
    live: Any, wait_until: Callable[..., None]
) -> None:
    seen: list[zenoh.Sample] = []
    live.session.declare_subscriber("treenail/a/x", seen.append)
    with open_client([live.endpoint]) as hasty, open_client([live.endpoint]) as other:
        # Who puts it, the router and who gets it: each of the three would replace it, were it too far ahead.
        stamp = ahead(hasty)

        def heard() -> bool:
            other.put("treenail/a/x", b"", timestamp=stamp)
            return bool(seen)

        wait_until("it is heard", heard)
        assert seen[0].timestamp is not None
        assert str(seen[0].timestamp.get_id()) == str(hasty.zid())


def test_after_reading_a_value_of_the_future_a_new_one_takes_its_place(
    live: Any, wait_until: Callable[..., None]
) -> None:
    key = live.keys.of(NAME)
    with open_client([live.endpoint]) as first:
        stamp = ahead(first)

    def read(session: zenoh.Session) -> list[zenoh.Sample]:
        return [reply.ok for reply in session.get(key, timeout=5.0) if reply.ok is not None]

    def text(session: zenoh.Session, value: str, timestamp: zenoh.Timestamp | None = None) -> bool:
        session.put(key, value, encoding="text/plain", timestamp=timestamp)
        return [sample.payload.to_string() for sample in read(session)] == [value]

    with open_client([live.endpoint]) as writer:
        wait_until("the store has it", lambda: text(writer, "of the future", stamp))
    with open_client([live.endpoint]) as late:
        assert not text(late, "of today"), "without care the store takes it for older"
        come_after(late, read(late))
        wait_until("it is replaced", lambda: text(late, "of today"))
        come_after(late, read(late))
        assert [sample.payload.to_string() for sample in read(late)] == ["of today"]
