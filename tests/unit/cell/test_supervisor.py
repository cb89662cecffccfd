"""What keeps a cell's processes running: restarts, roles that others have, logs that are gone, and its own end."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from services.bus.command import EXIT_OUSTED
from services.cell.local import LocalCell, holders
from services.cell.plan import make_plan
from services.cell.supervisor import StartError, Supervisor
from services.rules.command_line import EXIT_ERROR
from services.wire.errors import CellError

ROOT = Path(__file__).resolve().parents[3]
WITHIN_S = 30.0


@pytest.fixture
def said() -> list[str]:
    return []


@pytest.fixture
def supervisor(tmp_path: Path, said: list[str]) -> Iterator[Supervisor]:
    made = Supervisor(tmp_path / "logs", said.append)
    yield made
    made.stop()


def until(supervisor: Supervisor, true: Callable[[], bool]) -> None:
    """Mind the processes until something is true."""
    deadline = time.monotonic() + WITHIN_S
    while not true():
        assert time.monotonic() < deadline
        supervisor.check()
        time.sleep(0.01)


def python(code: str) -> list[str]:
    return [sys.executable, "-c", code]


def test_who_cannot_start_ends_all_with_its_own_line(supervisor: Supervisor) -> None:
    supervisor.run("sim", python(f"print('treenail sim: no such thing'); raise SystemExit({EXIT_ERROR})"))
    with pytest.raises(StartError, match="treenail sim: no such thing"):
        until(supervisor, lambda: False)


def test_who_cannot_say_why_is_not_taken_at_what_was_said_before(supervisor: Supervisor, tmp_path: Path) -> None:
    """On a full disk a log keeps what an earlier process said, and takes nothing more."""
    log = tmp_path / "logs" / "store.log"
    log.parent.mkdir()
    log.write_text("store: running\n")
    fail = python(f"raise SystemExit({EXIT_ERROR})")
    supervisor.run("store", fail)
    with pytest.raises(StartError) as silent:
        until(supervisor, lambda: False)
    assert str(silent.value) == "store: exited with status 2"
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (log.stat().st_size, limit[1]))
    try:
        supervisor.run("store", fail)
        with pytest.raises(StartError, match=f"store: what it says cannot be written to {log}: File too large"):
            until(supervisor, lambda: False)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)


def test_a_role_that_somebody_else_has_is_waited_for_and_told_once(
    supervisor: Supervisor, said: list[str], tmp_path: Path
) -> None:
    free = tmp_path / "free"
    line = "agent: 1 other has this role (instance 0000-abc)"
    code = f"""
import pathlib, sys, time
if not pathlib.Path({str(free)!r}).exists():
    print({line!r})
    sys.exit({EXIT_OUSTED})
time.sleep(600)
"""
    supervisor.run("agent", python(code))
    child = supervisor.children["agent"]
    until(supervisor, lambda: child.restarts >= 3)
    assert said == [f"{line}; waiting until its role is free"]
    free.touch()
    until(supervisor, lambda: child.restarts >= 4 or bool(supervisor.alive()))
    until(supervisor, lambda: bool(supervisor.alive()))
    assert len(said) == 1


def test_logs_that_are_removed_are_made_again(supervisor: Supervisor, said: list[str]) -> None:
    supervisor.run("sim", python("import time; print('here', flush=True); time.sleep(600)"))
    child = supervisor.children["sim"]
    until(supervisor, lambda: "here" in child.log.read_text())
    child.log.unlink()
    child.log.parent.rmdir()
    assert child.process is not None
    child.process.kill()
    until(supervisor, lambda: child.log.exists() and "here" in child.log.read_text())
    (line,) = said
    assert "sim was killed by SIGKILL; starting it again" in line


def test_a_child_whose_log_cannot_be_written_runs_all_the_same(
    supervisor: Supervisor, said: list[str], tmp_path: Path
) -> None:
    (tmp_path / "logs").write_text("a file where the folder should be")
    supervisor.run("sim", python("import time; print('unheard', flush=True); time.sleep(600)"))
    until(supervisor, lambda: bool(supervisor.alive()))
    (line,) = said
    assert line.startswith(f"sim: {tmp_path / 'logs' / 'sim.log'} cannot be written: ")


PARENT = """
import sys, time
from pathlib import Path
from services.cell.supervisor import Supervisor
supervisor = Supervisor(Path(sys.argv[1]), print)
child = "import time; from services.bus.command import die_with_parent; die_with_parent()"
supervisor.run("child", [sys.executable, "-c", child + "; print(1, flush=True); time.sleep(600)"])
print(supervisor.children["child"].process.pid, flush=True)
time.sleep(600)
"""


@pytest.mark.parametrize("suspended", [False, True])
def test_children_die_with_the_supervisor_whatever_they_do(tmp_path: Path, suspended: bool) -> None:
    command = [sys.executable, "-c", PARENT, str(tmp_path)]
    parent = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    assert parent.stdout is not None
    pid = int(parent.stdout.readline())
    try:
        deadline = time.monotonic() + WITHIN_S
        while "1" not in (tmp_path / "child.log").read_text():
            assert time.monotonic() < deadline
            time.sleep(0.01)
        if suspended:
            os.kill(pid, signal.SIGSTOP)
        parent.kill()
        parent.wait()
        while Path(f"/proc/{pid}").exists() and "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text():
            assert time.monotonic() < deadline
            time.sleep(0.01)
    finally:
        parent.kill()
        parent.wait()
        parent.stdout.close()


HOLDER = """
import fcntl, sys, time
held = open(sys.argv[1], "ab")
fcntl.flock(held, fcntl.LOCK_EX)
print(1, flush=True)
time.sleep(600)
"""


def test_the_refusal_of_a_folder_in_use_names_the_process(tmp_path: Path) -> None:
    lock = tmp_path / "store.sqlite.lock"
    holder = subprocess.Popen([sys.executable, "-c", HOLDER, str(lock)], stdout=subprocess.PIPE)
    try:
        assert holder.stdout is not None and holder.stdout.readline()
        with pytest.raises(CellError, match=rf"is working in this directory: process {holder.pid} \(python"):
            LocalCell(make_plan("chamfered-q-softmax", out=tmp_path)).__enter__()
        os.kill(holder.pid, signal.SIGSTOP)
        deadline = time.monotonic() + WITHIN_S
        while "suspended" not in (who := holders(lock)[0]):
            assert time.monotonic() < deadline, who
    finally:
        holder.kill()
        holder.wait()
        holder.stdout.close()  # type: ignore[union-attr]
