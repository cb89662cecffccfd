"""The store over Zenoh: what a client sees of it, from a real process, and what a kill leaves."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import zenoh

from services.wire.codec import encode, encoding_of
from services.wire.keys import Keys
from services.wire.messages import Checkpoint

RUN = "0f-s1"


def checkpoint(episode: int, decisions: int) -> Checkpoint:
    return Checkpoint(
        run=RUN, service="agent", episode=episode, decisions=decisions, contract_sha256="0f" * 32, snapshot={}
    )


@pytest.fixture
def agent(live: Any) -> Iterator[zenoh.Session]:
    """The test holds the agent's role: it is believed."""
    instance = f"{1:020d}-{live.session.zid()}"
    token = live.session.liveliness().declare_token(live.keys.of(f"claim/agent/{instance}"))
    yield live.session
    token.undeclare()


def contents(live: Any, selector: str) -> dict[str, bytes]:
    """Return what the store answers, by key."""
    replies = live.session.get(live.keys.of(selector), timeout=5.0)
    return {str(reply.ok.key_expr): reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None}


def put(live: Any, key: str, message: Checkpoint, timestamp: zenoh.Timestamp | None = None) -> None:
    live.session.put(key, encode(message), encoding=encoding_of(Checkpoint), timestamp=timestamp)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_the_newest_value_of_each_key_is_given_back_also_by_a_store_that_starts_again(
    live: Any, agent: zenoh.Session, wait_until: Callable[..., None], number: signal.Signals
) -> None:
    keys = Keys("a")
    earlier = live.session.new_timestamp()
    wanted = {keys.checkpoint(RUN, "agent", episode): encode(checkpoint(episode, 9)) for episode in range(20)}

    def stored() -> bool:
        for episode in range(20):
            put(live, keys.checkpoint(RUN, "agent", episode), checkpoint(episode, 9))
            put(live, keys.checkpoint(RUN, "agent", episode), checkpoint(episode, 1), earlier)
        return contents(live, f"checkpoint/{RUN}/**") == wanted

    wait_until("all is stored", stored)
    assert contents(live, f"checkpoint/{RUN}/agent/00000003") == {
        keys.checkpoint(RUN, "agent", 3): encode(checkpoint(3, 9))
    }
    assert contents(live, "checkpoint/nothing/*") == {}
    live.session.delete(keys.of("checkpoint/**"))
    wait_until("the delete is refused", lambda: live.refused("store"))
    live.processes["store"].stop(number)
    assert contents(live, f"checkpoint/{RUN}/**") == {}
    live.start_store()
    live.wait_alive("store")
    assert contents(live, f"checkpoint/{RUN}/**") == wanted
