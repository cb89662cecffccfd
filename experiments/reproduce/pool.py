"""Pieces of work over several processes, started afresh and each used for piece after piece."""

from __future__ import annotations

import gc
import multiprocessing
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import connection
from multiprocessing.context import SpawnProcess
from typing import Any, Generic, TypeVar

from experiments.lab.children import GRACE_S, POLL_S, how_it_ended, interrupt_noted, start
from services.wire.errors import TreenailError

K = TypeVar("K")
T = TypeVar("T")


class PieceError(TreenailError):
    """A piece failed; the message names it."""


@dataclass(frozen=True)
class _Failure:
    message: str


@dataclass
class _Child:
    process: SpawnProcess
    index: int


def spread(work: Callable[[K], T], keys: Sequence[K], jobs: int) -> Iterator[tuple[int, T]]:
    """Yield (index into ``keys``, ``work(key)``) as the pieces are finished, at most ``jobs`` at a time.

    ``work`` is a function at the top of a module. To be used from the main thread. Raises PieceError when a piece
    fails. However it ends, also by Ctrl-C, no process is left behind; of a parent that is killed outright, each ends
    with its current piece.
    """
    waiting, children = deque(enumerate(keys)), dict[connection.Connection, _Child]()
    with interrupt_noted() as interrupted:
        try:
            while waiting and len(children) < jobs:
                index, key = waiting.popleft()
                pipe, process = _start(work)
                children[pipe] = _Child(process, index)
                _send(pipe, key, process)
            while children:
                heard = connection.wait(list(children), timeout=POLL_S)
                if interrupted.is_set():
                    raise KeyboardInterrupt
                for pipe in [known for known in children if known in heard]:
                    child = children[pipe]
                    index, result = child.index, _heard(pipe, child, keys)
                    if waiting:
                        child.index, key = waiting.popleft()
                        _send(pipe, key, child.process)
                    else:
                        _end({pipe: children.pop(pipe)})
                    yield index, result
            if interrupted.is_set():  # while the last result was taken in
                raise KeyboardInterrupt
        finally:
            _end(children)


def _start(work: Callable[[K], T]) -> tuple[connection.Connection, SpawnProcess]:
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(theirs, work), daemon=True)
    try:
        start(process)
    except OSError as error:
        raise PieceError(f"a process for the pieces could not be started: {error.strerror}") from error
    theirs.close()
    return ours, process


def _send(pipe: connection.Connection, key: object, process: SpawnProcess) -> None:
    try:
        pipe.send(key)
    except BrokenPipeError:
        raise _died(key, process) from None


def _heard(pipe: connection.Connection, child: _Child, keys: Sequence[object]) -> Any:
    """Take the result of a child's piece; raises PieceError."""
    try:
        message: _Failure | _Result[Any] = pipe.recv()
    except (EOFError, OSError):
        raise _died(keys[child.index], child.process) from None
    if isinstance(message, _Failure):
        raise PieceError(f"piece {keys[child.index]}: {message.message}")
    return message.value


@dataclass(frozen=True)
class _Result(Generic[T]):
    value: T


def _died(key: object, process: SpawnProcess) -> PieceError:
    return PieceError(f"piece {key}: its process ended without a result, {how_it_ended(process)}")


def _serve(pipe: connection.Connection, work: Callable[[K], T]) -> None:
    """Do piece after piece in a child, until the parent closes the pipe or is gone."""
    gc.freeze()  # what is loaded by now stays, and need not be looked through again and again
    while True:
        try:
            key = pipe.recv()
        except (EOFError, OSError):
            return
        message: _Failure | _Result[T]
        try:
            message = _Result(work(key))
        except TreenailError as error:
            message = _Failure(" ".join(str(error).split()))
        except Exception as error:  # whatever it is, the parent has to name the piece
            message = _Failure(" ".join(f"{type(error).__name__}: {error}".split()))
        try:
            pipe.send(message)
        except BrokenPipeError:
            return


def _end(children: dict[connection.Connection, _Child]) -> None:
    """Make sure that children have ended."""
    for pipe, child in children.items():
        pipe.close()
        child.process.terminate()
    for child in children.values():
        child.process.join(GRACE_S)
        if child.process.is_alive():
            child.process.kill()
        child.process.join()
        child.process.close()
