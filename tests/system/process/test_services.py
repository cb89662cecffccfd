"""Each service as a process of its own: it comes up, stops when told, and fails in one line."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from services.bus.routing import open_router
from services.bus.session import open_client
from services.wire.keys import Keys

SOON_S = 20.0
"""Less than what any service waits for when it is not told to stop."""
NAMES = ("store", "task", "sim", "classifier", "agent", "viewer")


@pytest.fixture
def where(short_path: Path) -> Iterator[str]:
    endpoint = f"unixsock-stream/{short_path}/z"
    router = open_router([endpoint])
    yield endpoint
    router.close()  # type: ignore[no-untyped-call]


@pytest.fixture
def serve(run_module: Callable[..., Any], small: Path, tmp_path: Path) -> Callable[..., Any]:
    """Start a service with what it needs."""

    def start(name: str, endpoint: str, *more: str) -> Any:
        options = {
            "store": ("--file", str(tmp_path / "store.sqlite")),
            "task": ("--experiment", str(small), "--episodes", "500"),
            "viewer": ("--bind", "127.0.0.1", "--port", "0", "--web-port", "0"),
        }.get(name, ())
        return run_module(f"services.{name}", "--connect", endpoint, *options, *more)

    return start


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_all_come_up_and_each_stops_when_told(
    where: str, serve: Callable[..., Any], wait_until: Callable[..., None], number: signal.Signals
) -> None:
    processes = {name: serve(name, where) for name in NAMES}
    session = open_client([where])
    try:

        def alive() -> set[str]:
            replies = session.liveliness().get(Keys("a").alive("*"), timeout=5.0)
            return {str(reply.ok.key_expr).rpartition("/")[2] for reply in replies if reply.ok is not None}

        wait_until("all alive", lambda: alive() == set(NAMES))
        for name in reversed(NAMES):
            assert processes[name].stop(number, SOON_S) == 0, name
            assert processes[name].err == "", name
        wait_until("all gone", lambda: alive() == set())
    finally:
        session.close()  # type: ignore[no-untyped-call]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("name", ["classifier", "agent", "sim", "task"])
def test_one_that_waits_stops_when_told(
    where: str, serve: Callable[..., Any], wait_until: Callable[..., None], name: str, number: signal.Signals
) -> None:
    process = serve(name, where)
    wait_until("it waits", lambda: "waiting for" in process.out)
    assert process.stop(number, SOON_S) == 0
    assert process.err == ""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_router_comes_up_and_stops_when_told(
    run_module: Callable[..., Any], wait_until: Callable[..., None], short_path: Path, number: signal.Signals
) -> None:
    endpoint = f"unixsock-stream/{short_path}/z"
    process = run_module("services.router", "--listen", endpoint)
    session = open_client([endpoint])
    assert isinstance(session, zenoh.Session)
    assert process.stop(number, SOON_S) == 0
    assert (process.out, process.err) == (f"router: listening on {endpoint}\n", "")
    session.close()  # type: ignore[no-untyped-call]


def test_a_router_that_cannot_listen_is_one_line(run_module: Callable[..., Any]) -> None:
    process = run_module("services.router", "--listen", "tcp/192.0.2.1:7447")
    assert process.end() == 2
    (line,) = process.err.splitlines()
    assert line.startswith("treenail router: router: cannot listen on tcp/192.0.2.1:7447")


@pytest.mark.parametrize("name", NAMES)
def test_without_a_router_it_ends_in_one_line(serve: Callable[..., Any], short_path: Path, name: str) -> None:
    process = serve(name, f"unixsock-stream/{short_path}/nobody", "--connect-timeout", "0.3")
    assert process.end() == 2
    (line,) = process.err.splitlines()
    assert line.startswith(
        f"treenail {name}: router: expected one at unixsock-stream/{short_path}/nobody, none answered"
    )


@pytest.mark.parametrize(
    ("name", "options", "expected"),
    [
        ("agent", ("--cell", "A"), "cell: expected"),
        ("agent", ("--connect", "nonsense"), "nonsense"),
        ("agent", ("--connect-timeout", "soon"), "--connect-timeout"),
        ("agent", ("--no-such-option",), "--no-such-option"),
        ("task", ("--experiment", "none-such"), "none-such"),
        ("task", ("--set", "start.x_mm=far"), "start.x_mm"),
        ("task", ("--seed", "-1"), "--seed"),
        ("task", ("--episodes", "0"), "--episodes"),
        ("store", ("--file", "/no/such/folder/store.sqlite"), "/no/such/folder"),
        ("store", ("--max-bytes", "10"), "max_bytes"),
        ("store", ("--keep-runs", "0"), "runs"),
    ],
)
def test_what_cannot_be_is_said_in_one_line(
    run_module: Callable[..., Any], where: str, tmp_path: Path, name: str, options: tuple[str, ...], expected: str
) -> None:
    file = ("--file", str(tmp_path / "store.sqlite")) if name == "store" else ()
    process = run_module(f"services.{name}", "--connect", where, *file, *options)
    assert process.end() == 2, process.out
    (line,) = process.err.splitlines()
    assert expected in line


def test_one_that_waits_for_the_router_stops_when_told(
    serve: Callable[..., Any], wait_until: Callable[..., None], short_path: Path
) -> None:
    process = serve("agent", f"unixsock-stream/{short_path}/nobody")
    handled = f"/proc/{process.popen.pid}/status"

    def catches_sigint() -> bool:
        (caught,) = [line for line in Path(handled).read_text().splitlines() if line.startswith("SigCgt")]
        threads = len(list(Path(f"/proc/{process.popen.pid}/task").iterdir()))
        return bool(int(caught.split()[1], 16) & 1 << signal.SIGTERM - 1) and threads > 1

    wait_until("it tries", catches_sigint)
    assert process.stop(signal.SIGTERM, SOON_S) == 0
    assert process.err == ""
