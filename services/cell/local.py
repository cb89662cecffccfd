"""A whole cell on this machine: its folder, its processes, clients of it, and its end."""

from __future__ import annotations

import fcntl
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType

from services.bus.service import Options
from services.cell.certificates import certify
from services.cell.client import Client
from services.cell.plan import Plan
from services.cell.skill_transfer import give
from services.cell.start import TOGETHER, commands
from services.cell.supervisor import Supervisor
from services.wire.errors import CellError
from services.wire.keys import OPERATOR

ROUTER_WITHIN_S = 30.0
STORE_WITHIN_S = 60.0
"""How long router and store get to start and to keep the skill."""
ALIVE_WITHIN_S = 120.0
LOOK_EVERY_S = 0.1


class LocalCell:
    """The processes of a planned cell. As a context manager it has its run directory, and stops all that it started.

        with LocalCell(make_plan("initial", episodes=20, out=folder)) as cell, cell.client() as client:
            cell.start()

    Somebody has to call ``mind`` all the time: it starts again what has died.
    """

    def __init__(
        self,
        plan: Plan,
        notify: Callable[[str], None] = lambda _: None,
        *,
        environment: Mapping[str, str] | None = None,
        options: Mapping[str, Sequence[str]] | None = None,
        endpoints: Mapping[str, str] | None = None,
        also_mind: Callable[[], None] = lambda: None,
    ) -> None:
        """Start nothing yet.

        ``notify`` is told in a sentence when a process died. ``options`` are more options by service, ``endpoints``
        other routers by service. ``also_mind`` is called by ``mind``, and may end any waiting by raising.
        """
        self.plan = plan
        self.supervisor = Supervisor(plan.logs, notify, environment or {}, plan.certs)
        self._commands = commands(plan, endpoints)
        self._task = TOGETHER if plan.together else "task"
        """The process that the task is in."""
        for name, more in (options or {}).items():
            self._commands[name] += tuple(more)
        self._also_mind = also_mind

    def __enter__(self) -> LocalCell:
        """Make the run directory ready. Raises CellError when it cannot be, or another cell works in it."""
        _make_ready(self.plan)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.stop()

    @property
    def services(self) -> tuple[str, ...]:
        """Return the names of all services of the plan, in the order in which they are started."""
        return tuple(self._commands)

    def start(self, *names: str) -> None:
        """Start services, by default all of the plan; the skill of the plan is in the store before the task starts.

        Raises CellError when the store does not keep the skill, StartError when a service cannot start.
        """
        for name in names or self.services:
            if name == self._task and self.plan.skill is not None:
                with self.client() as client:
                    give(client, self.plan.skill, self.mind, STORE_WITHIN_S)
            self.supervisor.start(name, *self._commands[name])

    def client(self, who: str = OPERATOR) -> Client:
        """Return a client, with the certificate of ``who`` where there are any; waits for the router.

        Raises CellError when the router does not answer within 30 s.
        """
        certs = self.plan.certs and self.plan.certs / who
        return _client_when_up(Options(self.plan.cell, (self.plan.endpoint,), 0.5, certs), self.mind)

    def wait_alive(self, client: Client, *names: str, within_s: float = ALIVE_WITHIN_S) -> None:
        """Wait until services say that they are alive. Raises CellError when they do not."""
        deadline = time.monotonic() + within_s
        while missing := set(names) - set(client.alive()):
            self.mind()
            if time.monotonic() > deadline:
                raise CellError(
                    f"cell {self.plan.cell!r}: expected {', '.join(sorted(missing))} within {within_s:g} s, got none; "
                    f"see {self.plan.logs}"
                )
            time.sleep(LOOK_EVERY_S)

    def mind(self) -> None:
        """Start again what has died and is due. Raises StartError when a service cannot start."""
        self.supervisor.check()
        self._also_mind()

    def stop_task(self) -> None:
        """Stop the task, and so the robot; and who is in one process with it."""
        self.supervisor.stop(self._task)

    def stop(self) -> list[str]:
        """Stop all processes; return the names of those that had to be killed."""
        return self.supervisor.stop()


@contextmanager
def temporary_cell(
    plan: Plan, *, secure: bool = False, options: Mapping[str, Sequence[str]] | None = None
) -> Iterator[LocalCell]:
    """A planned cell in a folder of its own, of which nothing is left; nothing is started yet.

    With ``secure`` it has certificates, made for it alone. Raises CellError.
    """
    with TemporaryDirectory(prefix="treenail-", ignore_cleanup_errors=True) as name:
        certs = Path(name) / "certs" if secure else None
        if certs is not None:
            certify(certs, [], days=1)
        with LocalCell(replace(plan, out=Path(name) / "run", certs=certs), options=options) as cell:
            yield cell


def _client_when_up(options: Options, mind: Callable[[], None]) -> Client:
    """Return a client of a router that was just started, minding the processes meanwhile. Raises CellError."""
    deadline = time.monotonic() + ROUTER_WITHIN_S
    while True:
        mind()
        try:
            return Client(options)
        except CellError:
            if time.monotonic() > deadline:
                raise


def _make_ready(plan: Plan) -> None:
    """Make the run directory ready. Raises CellError when it cannot be written to, or another cell works in it."""
    lock = plan.out / "store.sqlite.lock"
    try:
        plan.logs.mkdir(parents=True, exist_ok=True)
        with lock.open("ab") as held:
            # The store takes this lock too; asked here, it is a clear answer before anything starts.
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            stale = plan.out.glob("store.sqlite*") if plan.fresh else ()
            for path in stale:
                if path != lock:
                    path.unlink()
    except BlockingIOError:
        who = ", ".join(holders(lock)) or "of another user or machine"
        raise CellError(f"--out {plan.out}: another cell is working in this directory: {who}") from None
    except OSError as error:
        raise CellError(f"--out {plan.out}: cannot hold a run: {error.strerror}") from error


def holders(lock: Path) -> list[str]:
    """Return who holds a lock on a file, in words with process ids, as far as Linux tells us."""
    try:
        inode, table = lock.stat().st_ino, Path("/proc/locks").read_text()
    except OSError:
        return []
    # A line is "1: FLOCK ADVISORY WRITE 4711 08:01:131077 0 EOF": process, device and inode.
    fields = [line.split() for line in table.splitlines()]
    pids = [line[4] for line in fields if len(line) > 5 and line[5].rpartition(":")[2] == str(inode)]
    return [_in_words(pid) for pid in dict.fromkeys(pids)]


def _in_words(pid: str) -> str:
    try:
        words = Path("/proc", pid, "cmdline").read_bytes().decode(errors="replace").split("\0")
        state = Path("/proc", pid, "stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return f"process {pid}"
    module = next((word for word in words if word.startswith("services.")), Path(words[0]).name)
    suspended = ", suspended: kill -CONT or kill -KILL it" if state in "Tt" else ""
    return f"process {pid} ({module}{suspended})"
