"""Pieces of work over several processes, started afresh; none is left behind, however it ends."""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import threading
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import connection, resource_tracker
from multiprocessing.process import BaseProcess
from typing import Any, Literal, TypeAlias, TypeVar

from services.bus.stop_flag import StopFlag
from services.rules.command_line import missing, safe_path
from services.wire.errors import TreenailError

K = TypeVar("K")
T = TypeVar("T")
Tell: TypeAlias = Callable[[int], bool]
"""Tells the parent how far a piece is; the answer is whether to go on, or to hand over what there is."""

POLL_S = 0.2
"""How often Ctrl-C, and how far the pieces are, is looked for."""
GRACE_S = 1.0
"""How long a process may take to end before it is killed."""
HAND_OVER_S = 10.0
"""How long pieces may take to hand over what they have, once they are told to stop."""
_NOT_BEGUN = -1


class PieceError(TreenailError):
    """A piece failed; the message names it, ``trace`` is the traceback, empty where a process just ended."""

    trace = ""


@dataclass(frozen=True)
class _Failure:
    """What comes back in place of a result: an exception may be one that cannot be sent."""

    message: str
    trace: str = ""


class _Left:
    """Comes back of a piece that was not begun when all was told to stop."""


def usable_cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0))


def spread(
    work: Callable[[K, Tell], T],
    keys: Sequence[K],
    jobs: int,
    name: Callable[[K], str],
    advanced: Callable[[int, int], None] = lambda _index, _count: None,
    *,
    partly: bool = False,
) -> Iterator[tuple[int, T]]:
    """Yield (index into ``keys``, ``work(key, tell)``) as the pieces are finished, at most ``jobs`` at a time.

    ``work`` is a function at the top of a module. What it tells of a piece, and 0 when it begins, ``advanced`` hears
    now and then, after the piece's index. Raises PieceError when a piece fails,
    KeyboardInterrupt upon Ctrl-C or SIGTERM; all processes have ended by then. With ``partly`` the pieces under way
    are told to stop first, and what they have by then is yielded. Of a parent that is killed outright they end too.
    """
    if not keys:
        return
    context = multiprocessing.get_context("spawn")
    # Plain numbers in shared memory, one writer each: no lock that a process could take along when it dies.
    counts, owners = context.RawArray("q", [_NOT_BEGUN] * len(keys)), context.RawArray("q", len(keys))
    stop = context.RawValue("b", 0)
    heard, given_up_s = [_NOT_BEGUN] * len(keys), 0.0

    def listen(indices: Iterable[int]) -> None:
        for index in indices:
            if (count := counts[index]) != heard[index]:
                if heard[index] == _NOT_BEGUN and count:
                    advanced(index, 0)
                heard[index] = count
                advanced(index, count)

    pool = ProcessPoolExecutor(min(jobs, len(keys)), context, _begin, (counts, owners, stop))
    others, processes, pending = set(multiprocessing.active_children()), list[BaseProcess](), dict[Future[Any], int]()
    with _interrupt_noted() as interrupted:
        try:
            with _interrupt_blocked(), safe_path():
                for index, key in enumerate(keys):
                    pending[_submit(pool, work, index, key)] = index
            processes = _children_beside(others)
            while pending:
                done, _ = wait(pending, POLL_S, FIRST_COMPLETED)
                if interrupted:
                    given_up_s = given_up_s or time.monotonic() + HAND_OVER_S
                    stop.value = 1
                    has_some = any(counts[index] > 0 for index in pending.values())
                    if not (partly and has_some and time.monotonic() < given_up_s):
                        raise KeyboardInterrupt
                for future in sorted(done, key=pending.__getitem__):
                    index, result = pending[future], future.result()
                    listen([index])  # before those that have begun since
                    if isinstance(result, _Failure):
                        failed = PieceError(f"{name(keys[index])}: {result.message}")
                        failed.trace = result.trace
                        raise failed
                    del pending[future]
                    if not isinstance(result, _Left):
                        yield index, result
                listen(pending.values())
            if interrupted:  # while the last result was taken in
                raise KeyboardInterrupt
        except BrokenProcessPool:
            _end(pool, processes)
            broken = [index for future, index in pending.items() if future.exception() is not None]
            raise _death(processes, {name(keys[n]): owners[n] for n in broken if counts[n] != _NOT_BEGUN}) from None
        finally:
            _end(pool, processes or _children_beside(others))


def _submit(pool: ProcessPoolExecutor, *what: Any) -> Future[Any]:
    """Give a piece to the pool, which starts its processes meanwhile. Raises PieceError."""
    try:
        return pool.submit(_do, *what)
    except OSError as error:
        raise PieceError(f"a process for the work could not be started: {error.strerror}") from error


def _children_beside(others: set[BaseProcess]) -> list[BaseProcess]:
    return [child for child in multiprocessing.active_children() if child not in others]


def _death(processes: Sequence[BaseProcess], under_way: dict[str, int]) -> PieceError:
    """Return the error that names the piece whose process ended by itself, and how; the pool has ended the others."""
    alone = [process for process in processes if process.exitcode != -signal.SIGTERM] or processes
    pids = [process.pid for process in alone]
    names = [name for name, pid in under_way.items() if pid in pids] or list(under_way)
    status = alone[0].exitcode or 0 if alone else 0
    how = f"signal {-status}" if status < 0 else f"exit status {status}"
    return PieceError(f"{' or '.join(names) or 'a piece'}: its process ended without a result, {how}")


def _end(pool: ProcessPoolExecutor, processes: Sequence[BaseProcess]) -> None:
    """Make sure that the processes have ended."""
    for process in processes:
        process.terminate()
    for process in processes:
        if not connection.wait([process.sentinel], GRACE_S):
            process.kill()
    pool.shutdown()


@contextmanager
def _interrupt_noted() -> Iterator[StopFlag | Literal[False]]:
    """Note Ctrl-C and SIGTERM, not end at once, so that no process is lost between being started and being listed."""
    if threading.current_thread() is not threading.main_thread():
        yield False  # signals are the main thread's; it has to see to this one
        return
    noted = StopFlag()
    try:
        yield noted
    finally:
        noted.restore()


@contextmanager
def _interrupt_blocked() -> Iterator[None]:
    """Start processes meanwhile that do not answer Ctrl-C, which the terminal sends to them too, with a traceback."""
    # A process starts with the signals blocked that are blocked here. The tracker comes first: it unblocks SIGINT.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# -- in the processes ------------------------------------------------------------------------------------------------

_shared: tuple[Any, Any, Any]
"""How far each piece is, the process id of who has it, and whether all shall stop."""


def _begin(counts: Any, owners: Any, stop: Any) -> None:
    """Get ready for pieces: Python waits for them for ever, also when the parent is gone."""
    global _shared
    _shared = counts, owners, stop
    parent = multiprocessing.parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
    gc.freeze()  # what is loaded by now stays, and need not be looked through again and again


def _do(work: Callable[[K, Tell], T], index: int, key: K) -> T | _Failure | _Left:
    counts, owners, stop = _shared
    if stop.value:
        return _Left()
    owners[index], counts[index] = os.getpid(), 0

    def tell(count: int) -> bool:
        counts[index] = count
        return not stop.value

    try:
        return work(key, tell)
    except TreenailError as error:
        return _Failure(" ".join(str(error).split()), traceback.format_exc())
    except ModuleNotFoundError as error:
        return _Failure(missing(error), traceback.format_exc())
    except Exception as error:  # whatever it is, the parent has to name the piece
        place = traceback.extract_tb(error.__traceback__)[-1]
        where = f"{place.filename}:{place.lineno} in {place.name}"
        return _Failure(" ".join(f"{type(error).__name__}: {error} ({where})".split()), traceback.format_exc())
