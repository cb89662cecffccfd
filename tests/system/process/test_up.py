"""``treenail up``: it ends as the run in one process does, stops at once, goes on where it was, fails in one line."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import signal
import socket
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from experiments.lab.skills import digests
from services.bus.session import open_client
from services.rules.skill import read

EPISODES = 24
LONG = 100
"""Episodes of a run that is still under way when it has a checkpoint and is stopped."""
"""More than there are between two checkpoints."""
ELSEWHERE = (
    "parts.shape=triangle",
    "hole.tilt_spread_deg=1",
    "wrist.sensor_mount=unknown",
    "moves.rotation_centre_mm=130",
    "changes=[{episode=4, key='contact.friction', value=0.6}, {episode=4, key='parts.clearance_mm', value=0.3}]",
)
"""A world that is not as the task believes, and that becomes another."""
SOON_S = 20.0
"""Less than what anything waits for when it is not told to stop."""


@pytest.mark.parametrize(
    ("seed", "overrides"),
    [
        (7, ("start.x_mm=-1.2", "start.ry_deg=-0.6", "start.xy_spread_mm=0.1", "noise.force_n=0.02")),
        (1, ("learner.kind=sarsa", "policy.kind=epsilon_greedy")),
        (2, ("policy.kind=epsilon_annealed", "moves.actions=11")),
        (3, ELSEWHERE),
    ],
    ids=["another-pose", "sarsa", "annealed", "elsewhere"],
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
    process = up(out, LONG)
    after_actions(endpoint_of(out), 120)
    wait_until("all run", lambda: set(process.children()) == SERVICES)
    # Without a checkpoint of both workers there is nothing to sum up.
    with open_client([endpoint_of(out)], 30.0) as session:
        wait_until("a checkpoint", lambda: any(r.ok for r in session.get("treenail/a/checkpoint/*/agent/latest")))
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
    if number == signal.SIGINT:
        summary = json.loads((out / "summary.json").read_text())
        (run,) = summary["runs"]
        assert 0 < run["episodes"] <= LONG
        assert summary.get("interrupted", {"episodes": run["episodes"]})["episodes"] == LONG
        assert run["digests"] == reference(run["episodes"]), "what was learnt in the finished episodes alone"
        skill = read(out / "seed1.skill")
        assert digests(skill.skill)["q_table"] == run["digests"]["q_table"]
    again = up(out, LONG)
    assert again.end() == 0, again.err
    assert digests_in(out) == reference(LONG)
    assert "interrupted" not in (out / "summary.json").read_text()
    assert re.search(r"^resuming from episode [1-9]", again.out, re.MULTILINE)
    assert "goes on with episode" in (out / "logs" / "task.log").read_text()


class Terminal:
    """A command in a terminal of its own, whose screen is read."""

    def __init__(self, *words: str, columns: int = 80) -> None:
        self.said = ""
        self.status: int | None = None
        self.pid, self._terminal = pty.fork()
        if self.pid == 0:
            os.execve(sys.executable, [sys.executable, *words], {**os.environ, "TERM": "xterm"})
        fcntl.ioctl(self._terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 50, columns, 0, 0))
        os.set_blocking(self._terminal, False)

    def read(self) -> str:
        """Return all that was written on it so far."""
        with suppress(OSError):
            self.said += os.read(self._terminal, 65536).decode(errors="replace")
        return self.said

    def press(self, keys: bytes) -> None:
        """Press keys."""
        os.write(self._terminal, keys)

    def ended(self) -> bool:
        """Whether the command has ended."""
        self.read()
        if self.status is None and (waited := os.waitpid(self.pid, os.WNOHANG))[0]:
            self.status = os.waitstatus_to_exitcode(waited[1])
        return self.status is not None

    def close(self) -> None:
        """End the command if it has not."""
        if not self.ended():
            os.kill(self.pid, signal.SIGKILL)
            os.waitpid(self.pid, 0)
        os.close(self._terminal)


@pytest.fixture
def in_terminal(small: Path) -> Iterator[Callable[..., Terminal]]:
    """Start ``treenail up sim`` in a terminal."""
    terminals = []

    def start(out: Path, episodes: int, *options: str, columns: int = 80) -> Terminal:
        words = ["--experiment", str(small), "--episodes", str(episodes), "--out", str(out), "--port", "0"]
        command = ("-m", "treenail.__main__", "up", "sim", *words, "--no-viewer", *options)
        terminals.append(Terminal(*command, columns=columns))
        return terminals[-1]

    yield start
    for terminal in terminals:
        terminal.close()


def test_ctrl_c_in_a_terminal_stops_everything(
    in_terminal: Callable[..., Terminal], wait_until: Callable[..., None], tmp_path: Path
) -> None:
    terminal = in_terminal(tmp_path / "A", 500)
    wait_until("it shows how it goes", lambda: "return(10)" in terminal.read())
    terminal.press(b"\x03")
    wait_until("it has ended", terminal.ended, SOON_S)
    assert terminal.status == 130
    assert "Traceback" not in terminal.said
    assert "the same command goes on from there" in terminal.said


@pytest.mark.parametrize("columns", [60, 140])
def test_results_stay_on_the_screen_and_a_cell_that_stays_answers(
    in_terminal: Callable[..., Terminal],
    wait_until: Callable[..., None],
    run_module: Callable[..., Any],
    endpoint_of: Callable[[Path], str],
    tmp_path: Path,
    columns: int,
) -> None:
    out = tmp_path / "A"
    stay = ("--stay",) if columns == 60 else ()
    terminal = in_terminal(out, 3, *stay, columns=columns)
    if stay:
        wait_until("it stays", lambda: "checkpoint export" in terminal.read())
        asked = run_module("treenail.__main__", "q-table", "--connect", endpoint_of(out))
        assert asked.end() == 0, asked.err
        terminal.press(b"\x03")
    wait_until("it has ended", terminal.ended)
    assert terminal.status == 0
    results = terminal.said.index("first 10")
    assert terminal.said.rindex("\x1b[1A") < results, "nothing goes up the screen after the results"
    if not stay:
        file = tmp_path / "exported"
        exported = run_module("treenail.__main__", "checkpoint", "export", str(file), "--store", str(out))
        assert exported.end() == 0, exported.err
        assert file.read_bytes() == (out / "seed0.skill").read_bytes()


def test_when_nobody_reads_any_more_the_run_goes_on(
    run_module: Callable[..., Any],
    small: Path,
    reference: Callable[..., dict[str, str]],
    digests_in: Callable[[Path], dict[str, str]],
    tmp_path: Path,
) -> None:
    out = tmp_path / "[bold]A[/x]"
    words = ["--experiment", str(small), "--episodes", "3", "--seed", "1", "--out", str(out), "--port", "0"]
    command = [sys.executable, "-m", "treenail.__main__", "up", "sim", *words, "--no-viewer"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False, timeout=120)
    assert done.stderr == "treenail up: standard output: No space left on device; the run goes on unread\n"
    assert done.returncode == 0
    assert digests_in(out) == reference(3)


@pytest.mark.parametrize("after_s", [0.3, 0.6, 1.2])
def test_ctrl_c_while_modules_are_loaded_is_one_line(up: Callable[..., Any], tmp_path: Path, after_s: float) -> None:
    process = up(tmp_path / "A", EPISODES)
    time.sleep(after_s)
    assert process.stop(signal.SIGINT, SOON_S) == 130
    assert process.err in ("", "treenail: interrupted\n", "treenail up: interrupted\n")


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
        (("--episodes", "0"), "--episodes: expected a whole number from 1 to 1000000, got '0'"),
        (("--episodes", "many"), "--episodes"),
        (("--seed", "-1"), "--seed: expected a whole number from 0 to 9223372036854775807, got '-1'"),
        (("--seed", "x"), "--seed"),
        (("--cell", "A/b"), "cell: expected"),
        (("--port", "70000"), "--port: expected a whole number from 0 to 65535"),
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
