"""What crosses a tap: messages with their sender's name, queries with their answers, and who is alive."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest
import zenoh

from experiments.chaos.line import Faults, Line
from experiments.chaos.tap import Side, connect
from services.bus.routing import open_router
from services.bus.session import open_client
from services.wire.keys import ACTION, EXPERIMENT, REWARD, STATE, Keys

KEYS = Keys("a")


class Tapped(NamedTuple):
    """A session beside the cell, one beside the agent, and the tap's loop between them."""

    cell: zenoh.Session
    agent: zenoh.Session
    line: Line


@pytest.fixture
def tapped(short_path: Path) -> Iterator[Tapped]:
    endpoints = [f"unixsock-stream/{short_path}/{name}" for name in ("near", "far")]
    routers = [open_router([endpoint]) for endpoint in endpoints]
    line = Line(0)
    near, far = (Side(name, open_client([at]), KEYS, line) for name, at in zip(("near", "far"), endpoints, strict=True))
    connect(near, far, "agent")
    loop = threading.Thread(target=line.work)
    loop.start()
    cell, agent = (open_client([endpoint]) for endpoint in endpoints)
    yield Tapped(cell, agent, line)
    line.stopping = True
    line.post(lambda: None)
    loop.join()
    for session in (cell, agent, near.session, far.session, *routers):
        session.close()  # type: ignore[no-untyped-call]


def sender(sample: zenoh.Sample) -> str:
    assert sample.timestamp is not None
    return str(sample.timestamp.get_id())


def said(tapped: Tapped, name: str, wait_until: Callable[..., None]) -> tuple[list[zenoh.Sample], list[zenoh.Sample]]:
    """Say something in the cell under a name until it is heard beside the agent; what was heard here and there."""
    here: list[zenoh.Sample] = []
    there: list[zenoh.Sample] = []
    heard = tapped.cell.declare_subscriber(KEYS.of(name), here.append)
    crossed = tapped.agent.declare_subscriber(KEYS.of(name), there.append)

    def arrived() -> bool:
        tapped.cell.put(KEYS.of(name), b"x", encoding="application/x")
        return bool(there)

    wait_until(f"{name} crosses", arrived)
    for subscriber in (heard, crossed):
        subscriber.undeclare()  # type: ignore[no-untyped-call]
    return here, there


def test_a_message_crosses_once_and_still_says_who_sent_it(tapped: Tapped, wait_until: Callable[..., None]) -> None:
    here, there = said(tapped, STATE, wait_until)
    assert {sender(sample) for sample in there} == {str(tapped.cell.zid())}
    assert {str(sample.encoding) for sample in there} == {"application/x"}
    assert len(there) <= len(here), "nothing comes back to where it came from"


def test_what_the_agent_does_not_hear_does_not_cross(tapped: Tapped, wait_until: Callable[..., None]) -> None:
    seen: list[zenoh.Sample] = []
    tapped.agent.declare_subscriber(KEYS.of(ACTION), seen.append)
    tapped.cell.put(KEYS.of(ACTION), b"x")
    said(tapped, REWARD, wait_until)
    assert seen == []


def test_lost_messages_do_not_arrive(tapped: Tapped, wait_until: Callable[..., None]) -> None:
    said(tapped, STATE, wait_until)
    tapped.line.faults = Faults(lose=1.0)
    seen: list[zenoh.Sample] = []
    tapped.agent.declare_subscriber(KEYS.of(STATE), seen.append)
    before = tapped.line.counts["lost"]
    tapped.cell.put(KEYS.of(STATE), b"x")
    wait_until("it is lost", lambda: tapped.line.counts["lost"] > before)
    assert seen == []


def test_a_query_crosses_with_its_answer_or_its_refusal(tapped: Tapped, wait_until: Callable[..., None]) -> None:
    def answer(query: zenoh.Query) -> None:
        with query:
            if query.payload is None:
                query.reply_err(b"why", encoding="text/plain")
            else:
                query.reply(KEYS.of(EXPERIMENT), query.payload, encoding="application/x")

    tapped.cell.declare_queryable(KEYS.of(EXPERIMENT), answer)

    def ask(payload: bytes | None) -> list[zenoh.Reply]:
        return list(tapped.agent.get(f"{KEYS.of(EXPERIMENT)}?a=1", payload=payload, timeout=10.0))

    wait_until("it answers", lambda: ask(b"what"))
    (good,) = ask(b"what")
    assert good.ok is not None
    assert (good.ok.payload.to_bytes(), str(good.ok.encoding)) == (b"what", "application/x")
    (refused,) = ask(None)
    assert refused.err is not None
    assert refused.err.payload.to_bytes() == b"why"


def test_who_is_alive_on_one_side_is_on_the_other(tapped: Tapped, wait_until: Callable[..., None]) -> None:
    def seen(session: zenoh.Session) -> set[str]:
        replies = session.liveliness().get(KEYS.alive("*"), timeout=5.0)
        return {str(reply.ok.key_expr).rpartition("/")[2] for reply in replies if reply.ok is not None}

    task = tapped.cell.liveliness().declare_token(KEYS.alive("task"))
    agent = tapped.agent.liveliness().declare_token(KEYS.alive("agent"))
    for session in (tapped.cell, tapped.agent):
        wait_until("both are seen", lambda session=session: seen(session) == {"task", "agent"})
    task.undeclare()  # type: ignore[no-untyped-call]
    wait_until("one has gone", lambda: seen(tapped.agent) == {"agent"})
    agent.undeclare()  # type: ignore[no-untyped-call]
    wait_until("the other has gone", lambda: seen(tapped.cell) == set())
