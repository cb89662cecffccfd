"""Clocks that are ahead or set back: messages keep their sender, and what is put last is what the store shows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import zenoh

from services.bus.session import come_after, open_client
from services.wire.codec import encode, encoding_of
from services.wire.messages import Checkpoint

RUN = "0f-s1"


def checkpoint(episode: int, decisions: int) -> Checkpoint:
    return Checkpoint(
        run=RUN, service="agent", episode=episode, decisions=decisions, contract_sha256="0f" * 32, snapshot={}
    )


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
    key = live.keys.checkpoint(RUN, "agent", 3)

    def read(session: zenoh.Session) -> list[zenoh.Sample]:
        return [reply.ok for reply in session.get(key, timeout=5.0) if reply.ok is not None]

    def put(session: zenoh.Session, decisions: int, timestamp: zenoh.Timestamp | None = None) -> bool:
        message = encode(checkpoint(3, decisions))
        session.put(key, message, encoding=encoding_of(Checkpoint), timestamp=timestamp)
        return [sample.payload.to_bytes() for sample in read(session)] == [message]

    @contextmanager
    def agent() -> Iterator[zenoh.Session]:
        with open_client([live.endpoint]) as session:
            token = session.liveliness().declare_token(live.keys.of(f"claim/agent/{1:020d}-{session.zid()}"))
            yield session
            token.undeclare()  # type: ignore[no-untyped-call]

    with agent() as writer:
        wait_until("the store has it", lambda: put(writer, 1, ahead(writer)))
    with agent() as late:
        assert not put(late, 2), "without care the store takes it for older"
        come_after(late, read(late))
        wait_until("it is replaced", lambda: put(late, 3))
        come_after(late, read(late))
        assert [sample.payload.to_bytes() for sample in read(late)] == [encode(checkpoint(3, 3))]
