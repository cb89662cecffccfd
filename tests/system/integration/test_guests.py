"""A router without certificates: who comes in by its port reads and asks, no more, whatever name he gives himself."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import pytest
import zenoh

from services.bus import own_socket
from services.bus.ports import free_port
from services.bus.service import Options
from services.bus.session import open_client
from services.cell.client import Client
from services.cell.skill_transfer import forget
from services.wire.errors import NotAllowedError
from services.wire.keys import ACTION, EXPERIMENT, Q_TABLE, SWAP, Keys
from services.wire.messages import QTable, Swapped, SwapRequest

KEYS = Keys("a")


class Door:
    """A router that listens on a port, and sessions by either of its doors."""

    def __init__(self, run_module: Callable[..., Any], wait_until: Callable[..., None], *options: str) -> None:
        self.port = free_port()
        self.endpoint = f"tcp/127.0.0.1:{self.port}"
        self.router = run_module("services.router", "--listen", self.endpoint, *options)
        wait_until("the router listens", lambda: "listening on" in self.router.out)
        self._open = ExitStack()

    def own(self) -> zenoh.Session:
        """Come in as the user who started it."""
        return self._open.enter_context(closing(open_client([self.endpoint])))

    def guest(self) -> zenoh.Session:
        """Come in by the port, as any Zenoh client does."""
        connect = {"mode": "client", "connect": {"endpoints": [self.endpoint]}, "timestamping": {"enabled": True}}
        config = zenoh.Config.from_json5(json.dumps({**connect, "scouting": {"multicast": {"enabled": False}}}))
        return self._open.enter_context(closing(zenoh.open(config)))

    def close(self) -> None:
        """Close all sessions."""
        self._open.close()


@pytest.fixture
def door(run_module: Callable[..., Any], wait_until: Callable[..., None]) -> Iterator[Door]:
    made = Door(run_module, wait_until)
    yield made
    made.close()


def test_a_guest_reads_and_asks_and_nothing_else_gets_through(door: Door, wait_until: Callable[..., None]) -> None:
    own, guest = door.own(), door.guest()
    heard: list[str] = []
    read: list[str] = []
    held = [
        own.declare_subscriber("treenail/**", lambda sample: heard.append(str(sample.key_expr))),
        guest.declare_subscriber("treenail/**", lambda sample: read.append(str(sample.key_expr))),
        own.declare_queryable(KEYS.of(EXPERIMENT), lambda query: query.reply(query.key_expr, b"true")),
        own.declare_queryable(KEYS.of(SWAP), lambda query: query.reply(query.key_expr, b"swapped")),
        guest.declare_queryable(KEYS.of(Q_TABLE), lambda query: query.reply(query.key_expr, b"a lie")),
        guest.liveliness().declare_token(KEYS.of(f"claim/agent/{0:020d}-{guest.zid()}")),
        guest.liveliness().declare_token(KEYS.alive("agent")),
    ]

    def answers(session: zenoh.Session, name: str) -> list[bytes]:
        return [reply.ok.payload.to_bytes() for reply in session.get(KEYS.of(name), timeout=5.0) if reply.ok]

    wait_until("a guest gets an answer", lambda: answers(guest, EXPERIMENT) == [b"true"])
    # Stamped as the cell's own session, whose name everybody may read: it does not help.
    seconds, rest = divmod(time.time_ns(), 10**9)
    forged = zenoh.Timestamp(zenoh.NTP64(seconds, rest), bytes.fromhex(str(own.zid()).zfill(32))[::-1])
    guest.put(KEYS.of(ACTION), b"forged", timestamp=forged)
    guest.put(KEYS.of("journal/x/latest"), b"lie")
    guest.delete("treenail/a/**")
    assert answers(guest, SWAP) == answers(own, Q_TABLE) == []
    assert list(own.liveliness().get("treenail/a/**", timeout=5.0)) == []
    own.put(KEYS.of(ACTION), b"true")
    wait_until("the guest reads", lambda: KEYS.of(ACTION) in read)
    wait_until("the cell hears its own", lambda: heard)
    assert heard == [KEYS.of(ACTION)]
    assert held


def test_a_guest_is_told_at_once_what_it_may_not(door: Door) -> None:
    with Client(Options(connect=(door.endpoint,))) as own:
        assert own.rights.name is None
    with pytest.MonkeyPatch.context() as elsewhere:
        elsewhere.setattr(own_socket, "connecting", lambda _: None)  # as from another machine
        with Client(Options(connect=(door.endpoint,))) as guest:
            began = time.monotonic()
            request = SwapRequest(run="a-s0", request="r1", classifier=None, learner=None, policy=None)
            with pytest.raises(NotAllowedError, match="swap: guest may not ask this in the cell: on the"):
                guest.request(SWAP, request, Swapped, 10.0)
            with pytest.raises(NotAllowedError, match="checkpoint/skill/latest: guest may not delete"):
                forget(guest)
            assert time.monotonic() - began < 5.0
            with pytest.raises(Exception, match="nobody is alive"):
                guest.ask(Q_TABLE, QTable)


def test_a_service_that_would_not_be_heard_says_so_and_ends(
    run_module: Callable[..., Any], wait_until: Callable[..., None]
) -> None:
    elsewhere = f"tcp/127.0.0.2:{free_port()}"
    router = run_module("services.router", "--listen", elsewhere)
    wait_until("the router listens", lambda: "listening on" in router.out)
    agent = run_module("services.agent", "--connect", elsewhere)
    assert agent.end() == 2
    (line,) = agent.err.splitlines()
    assert line.startswith(f"treenail agent: router: at {elsewhere} agent without certificate is a guest")


def test_a_trusted_interface_is_a_door_of_the_cell(run_module: Callable[..., Any], wait_until: Any) -> None:
    door = Door(run_module, wait_until, "--trust", "127.0.0.1")
    assert "by lo may do everything" in door.router.out
    by_port, own = door.guest(), door.own()
    heard: list[str] = []
    held = own.declare_subscriber("treenail/**", lambda sample: heard.append(str(sample.key_expr)))

    def speak() -> bool:
        by_port.put(KEYS.of(ACTION), b"x")
        return bool(heard)

    wait_until("it is heard", speak)
    assert held
    door.close()


def test_an_interface_that_is_not_there_is_one_line(run_module: Callable[..., Any]) -> None:
    process = run_module("services.router", "--listen", "tcp/127.0.0.1:0", "--trust", "192.0.2.7")
    assert process.end() == 2
    (line,) = process.err.splitlines()
    assert line.startswith("treenail router: --trust 192.0.2.7: expected an interface of this machine or its address")


def test_a_folder_that_others_can_enter_is_not_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(own_socket, "folder", lambda: tmp_path / "sockets")
    (tmp_path / "sockets").mkdir(mode=0o755)
    with pytest.raises(Exception, match="to be a folder of this user alone"):
        own_socket.listening("tcp/127.0.0.1:7447")
    assert own_socket.connecting("tcp/127.0.0.1:7447") is None
