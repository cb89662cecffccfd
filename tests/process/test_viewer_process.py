"""The viewer's process: it starts, says where to look, stops when told, and fails in one line."""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from services.wire.session import open_router

PATIENCE_S = 30.0


@pytest.fixture
def endpoint(tmp_path: Path) -> Iterator[str]:
    where = f"unixsock-stream/{tmp_path}/z"
    router = open_router([where])
    yield where
    router.close()  # type: ignore[no-untyped-call]


def viewer(*options: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "services.viewer", "--bind", "127.0.0.1", *options]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def failure(*options: str) -> str:
    """Run a viewer that cannot start; return its one line on stderr."""
    process = viewer(*options)
    _, said = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 2, said
    (line,) = said.splitlines()
    return line


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_it_says_where_to_look_and_stops_when_told(endpoint: str, number: signal.Signals) -> None:
    process = viewer("--connect", endpoint, "--port", "0")
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if "rerun+http://127.0.0.1:" in line:
                break
        port = int(line.rsplit(":", 1)[1].removesuffix("/proxy\n"))
        with socket.create_connection(("127.0.0.1", port), timeout=PATIENCE_S):
            process.send_signal(number)
        _, said = process.communicate(timeout=PATIENCE_S)
        assert said == ""
        assert process.returncode == 0
    finally:
        process.kill()
        process.communicate()


def test_a_port_in_use_is_one_line_and_status_2(endpoint: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as holder:
        port = holder.getsockname()[1]
        line = failure("--connect", endpoint, "--port", str(port))
    assert line.startswith(f"treenail viewer: viewer: expected a free port at 127.0.0.1, got {port}: ")
    assert "in use" in line


def test_a_file_that_cannot_be_written_is_one_line_and_status_2(endpoint: str, tmp_path: Path) -> None:
    line = failure("--connect", endpoint, "--port", "0", "--save", str(tmp_path / "missing" / "run.rrd"))
    assert "missing" in line


def test_a_wrong_memory_limit_is_one_line_and_status_2(endpoint: str) -> None:
    assert "plenty" in failure("--connect", endpoint, "--port", "0", "--memory-limit", "plenty")


def test_no_router_is_one_line_and_status_2(tmp_path: Path) -> None:
    line = failure("--connect", f"unixsock-stream/{tmp_path}/nobody", "--connect-timeout", "0.2", "--port", "0")
    assert line.startswith("treenail viewer: router: expected one at ")
