"""Pieces of work on a Dask cluster that somebody has: the same work and keys as for this machine's processes.

Dask gives a piece whose worker died to another worker; nothing of ours is in between.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from typing import Any, NamedTuple, TypeVar

from distributed import Client, KilledWorker

from experiments.lab.pool import POLL_S, Tell
from services.wire.errors import TreenailError

K = TypeVar("K")
T = TypeVar("T")

CONNECT_S = 10.0
"""How long a scheduler may take to answer."""


class Lost(NamedTuple):
    """Comes back in place of a result that there is none of; the others go on."""

    why: str


def spread(
    address: str,
    work: Callable[[K, Tell], T],
    keys: Sequence[K],
    say: Callable[[str], None],
    advanced: Callable[[int], None] = lambda _index: None,
    workers: list[str] | None = None,
) -> Iterator[tuple[int, T | Lost]]:
    """Yield (index into ``keys``, ``work(key, tell)``) as the pieces are finished by the cluster at ``address``.

    ``work`` is a function at the top of a module that the workers have installed. ``say`` hears how many workers there
    are; ``workers`` names those that may do it, all by default. Raises TreenailError when there is no scheduler, or
    when it goes; upon Ctrl-C what is under way is given up.
    """
    if not keys:
        return
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what goes wrong we say ourselves, in one line
    with _client(address) as client, client.get_executor(pure=False, workers=workers) as executor:
        say(_workers(client, address))
        pending: dict[Future[Any], int] = {executor.submit(_do, work, key): index for index, key in enumerate(keys)}
        try:
            while pending:
                done, _ = wait(pending, POLL_S, FIRST_COMPLETED)
                if not done and client.status != "running":
                    raise _gone(address)
                for future in sorted(done, key=pending.__getitem__):
                    index = pending.pop(future)
                    yield index, _result(future, address)
                    advanced(index)
        finally:
            executor.shutdown(wait=False)


def _do(work: Callable[[K, Tell], T], key: K) -> T:
    """Do a piece, on a worker; how far it is nobody is told there."""
    return work(key, lambda _count: True)


def _result(future: Future[Any], address: str) -> Any:
    try:
        return future.result()
    except KilledWorker:
        return Lost("its worker died, and so did those that were given it again")
    except CancelledError:
        raise _gone(address) from None
    except ModuleNotFoundError as error:
        return Lost(f"its worker lacks the module {error.name}; Treenail has to be installed there as it is here")
    except Exception as error:  # whatever a worker says, the others go on
        return Lost(" ".join(f"{type(error).__name__}: {error}".split())[:300])


def _client(address: str) -> Client:
    try:
        return Client(address, timeout=CONNECT_S)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:  # TimeoutError is an OSError
        said = " ".join(str(error).split())[:200] or type(error).__name__
        raise TreenailError(
            f"--on: expected a Dask scheduler at {address}, got none ({said}); `dask scheduler` starts one"
        ) from None


def _workers(client: Client, address: str) -> str:
    """Return in words who will do the work."""
    workers = client.scheduler_info(n_workers=-1)["workers"].values()
    threads = max((worker["nthreads"] for worker in workers), default=1)
    said = f"{len(workers)} workers at {address}" + ("" if workers else ": the runs wait until there is one")
    return said + (f", with up to {threads} threads: --nthreads 1 is faster" if threads > 1 else "")


def _gone(address: str) -> TreenailError:
    return TreenailError(f"--on: the scheduler at {address} has gone; what had ended is kept, a second start goes on")
