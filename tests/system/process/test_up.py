"""``treenail up``: it ends as the run in one process does, stops at once, goes on where it was, fails in one line."""

from __future__ import annotations

import os
import pty
import signal
import socket
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

EPISODES = 24
"""More than there are between two checkpoints."""
SOON_S = 20.0
"""Less than what anything waits for when it is not told to stop."""


@pytest.mark.parametrize(
    ("seed", "overrides"),
    [
        (7, ("start.x_mm=-1.2", "start.ry_deg=-0.6", "start.xy_spread_mm=0.1", "noise.force_n=0.02")),
        (1, ("learner.kind=sarsa", "policy.kind=epsilon_greedy")),
        (2, ("policy.kind=epsilon_annealed", "moves.actions=11")),
    ],
    ids=["another-pose", "sarsa", "annealed"],
)
def test_a_cell_ends_as_the_run_in_one_process(
    up: Callable[..., Any],
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    tmp_path: Path,
    seed: int,
    overrides: tuple[str, ...],
) -> None:
    words = [word for item in overrides for word in ("--set", item)]
    process = up(tmp_path / "A", 8, *words, seed=seed)
    assert process.end() == 0, process.err
    assert process.err == ""
    assert digests_in(tmp_path / "A") == reference(8, seed, *overrides)


def test_with_a_viewer_nothing_is_different(
    run_module: Callable[..., Any],
    small: Path,
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    tmp_path: Path,
) -> None:
    words = ("--experiment", str(small), "--episodes", "8", "--seed", "2", "--out", str(tmp_path / "A"))
    overrides = ("policy.kind=epsilon_annealed", "moves.actions=11")
    sets = [word for item in overrides for word in ("--set", item)]
    process = run_module("treenail.__main__", "up", "sim", *words, *sets, "--port", "0", "--viewer-port", "0")
    assert process.end() == 0, process.err
    assert process.err == ""
    assert "watch it live: rerun rerun+http://" in process.out
    assert digests_in(tmp_path / "A") == reference(8, 2, *overrides)


def _gone(pids: list[int]) -> bool:
    """Whether all processes have ended; one that nobody has waited for yet has."""
    for pid in pids:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except FileNotFoundError:
            continue
        if state != "Z":
            return False
    return True


SERVICES = {"router", "store", "task", "sim", "classifier", "agent"}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_stopped_run_leaves_nothing_behind_and_goes_on_when_started_again(
    up: Callable[..., Any],
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    endpoint_of: Callable[[Path], str],
    after_actions: Callable[[str, int], None],
    wait_until: Callable[..., None],
    tmp_path: Path,
    number: signal.Signals,
) -> None:
    out = tmp_path / "A"
    process = up(out, EPISODES)
    after_actions(endpoint_of(out), 120)
    wait_until("all run", lambda: set(process.children()) == SERVICES)
    pids = list(process.children().values())
    status = process.stop(number, SOON_S)
    if number == signal.SIGKILL:
        try:
            wait_until("no orphans", lambda: _gone(pids), 10.0)
        finally:
            for pid in pids:
                if not _gone([pid]):
                    os.kill(pid, signal.SIGKILL)
    else:
        assert status == 130
        assert _gone(pids)
        assert "the same command goes on from there" in process.out
    assert process.err == ""
    again = up(out, EPISODES)
    assert again.end() == 0, again.err
    assert digests_in(out) == reference(EPISODES)
    assert "goes on with episode" in (out / "logs" / "task.log").read_text()


def test_ctrl_c_in_a_terminal_stops_everything(
    small: Path, endpoint_of: Callable[[Path], str], wait_until: Callable[..., None], tmp_path: Path
) -> None:
    out = tmp_path / "A"
    words = ["--experiment", str(small), "--episodes", "500", "--out", str(out), "--port", "0", "--no-viewer"]
    pid, terminal = pty.fork()
    if pid == 0:
        os.execv(sys.executable, [sys.executable, "-m", "treenail.__main__", "up", "sim", *words])
    said, status = b"", None
    os.set_blocking(terminal, False)

    def read() -> None:
        nonlocal said
        try:
            said += os.read(terminal, 65536)
        except OSError:
            return

    def ended() -> bool:
        nonlocal status
        read()
        found, got = os.waitpid(pid, os.WNOHANG)
        status = os.waitstatus_to_exitcode(got) if found else None
        return bool(found)

    try:
        endpoint_of(out)

        def learning() -> bool:
            read()
            return b"return(10)" in said

        wait_until("it shows how it goes", learning)
        os.write(terminal, b"\x03")
        wait_until("it has ended", ended, SOON_S)
    finally:
        if status is None:
            os.kill(pid, signal.SIGKILL)
            os.waitpid(pid, 0)
        os.close(terminal)
    assert status == 130
    assert b"Traceback" not in said
    assert b"the same command goes on from there" in said


def test_an_early_ctrl_c_is_quiet(up: Callable[..., Any], wait_until: Callable[..., None], tmp_path: Path) -> None:
    process = up(tmp_path / "A", EPISODES)
    wait_until("it has begun to start", lambda: process.children())
    assert process.stop(signal.SIGINT) == 130
    assert process.err == ""


def _fails(process: Any) -> str:
    """Return the one line of a command that cannot do what it was told."""
    assert process.end() == 2, process.out
    (line,) = process.err.splitlines()
    assert "Traceback" not in line
    return str(line)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (("--set", "start.x_mm=far"), "start.x_mm"),
        (("--set", "start.nothing=1"), "nothing"),
        (("--set", "x"), "--set"),
        (("--experiment", "no-such-experiment"), "no-such-experiment"),
        (("--episodes", "0"), "--episodes: expected 1 or more, got 0"),
        (("--episodes", "many"), "--episodes"),
        (("--seed", "-1"), "--seed: expected 0 to 9223372036854775807, got -1"),
        (("--seed", "x"), "--seed"),
        (("--cell", "A/b"), "cell: expected"),
        (("--port", "70000"), "--port 70000"),
    ],
)
def test_what_cannot_be_is_said_in_one_line_and_nothing_is_started(
    up: Callable[..., Any], tmp_path: Path, options: tuple[str, ...], expected: str
) -> None:
    line = _fails(up(tmp_path / "A", 3, *options))
    assert expected in line
    assert not (tmp_path / "A").exists()


def test_a_bad_definition_is_named_with_file_and_line(up: Callable[..., Any], tmp_path: Path) -> None:
    bad = tmp_path / "bad.toml"
    bad.write_text('name = "bad"\n[start]\nx_mm = "left"\n')
    line = _fails(up(tmp_path / "A", 3, "--experiment", str(bad)))
    assert f"{bad}:3" in line


def test_a_port_in_use_is_one_line(up: Callable[..., Any], tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as holder:
        port = str(holder.getsockname()[1])
        assert f"--port {port}: cannot listen on 127.0.0.1:{port}" in _fails(up(tmp_path / "A", 3, "--port", port))
    assert not (tmp_path / "A").exists()


def test_a_folder_that_cannot_be_is_one_line(up: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert str(tmp_path / "file") in _fails(up(tmp_path / "file" / "A", 3))


def test_a_folder_in_use_is_one_line_and_keeps_its_run(
    up: Callable[..., Any], wait_until: Callable[..., None], tmp_path: Path
) -> None:
    first = up(tmp_path / "A", 500)
    wait_until("the store has its file", lambda: (tmp_path / "A" / "store.sqlite").exists())
    assert "another cell is working" in _fails(up(tmp_path / "A", 3, "--fresh"))
    assert (tmp_path / "A" / "store.sqlite").exists()
    assert first.stop(signal.SIGINT) == 130


def test_a_service_that_cannot_start_ends_all_with_its_own_line(up: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "A").mkdir()
    (tmp_path / "A" / "store.sqlite").write_text("this is no database, whatever its name says")
    process = up(tmp_path / "A", 3)
    assert "treenail store: store: " in _fails(process)
    assert process.children() == {}


def test_a_fresh_run_forgets(
    up: Callable[..., Any],
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    tmp_path: Path,
) -> None:
    assert up(tmp_path / "A", 4).end() == 0
    assert up(tmp_path / "A", 3, "--fresh").end() == 0
    assert digests_in(tmp_path / "A") == reference(3)
