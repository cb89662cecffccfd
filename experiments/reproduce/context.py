"""What a section of the report works with: how much to do, where data lies, what is already done, who hears of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

from experiments.lab.pool import Tell, spread
from experiments.lab.progress import Reporter
from experiments.reproduce.cache import Cache

K = TypeVar("K")
T = TypeVar("T")


@dataclass(frozen=True)
class Context:
    """Given to every section."""

    quick: bool
    """Do less: short runs, to see that all works."""
    seeds: tuple[int, ...]
    """The seeds of whatever is random; one or more."""
    data: Path | None
    """A folder with data sets, or None; it exists."""
    cache: Cache
    reporter: Reporter
    jobs: int
    """Processes at a time, 1 or more."""
    episodes: int | None = None
    """How long runs of insertions are that have no length of their own; None for as long as the thesis's."""
    kept: bool = False
    """Compute nothing of what is told to ``pieces_kept``: show what an earlier report kept."""

    def cached(self, kind: str, key: object, compute: Callable[[], T], result: type[T]) -> T:
        """Return what ``compute`` gives, from the cache when it was computed before.

        ``kind`` says in words what it is; ``key``, a dataclass or mapping with a whole number ``version``, holds all
        that the result depends on. CacheError when key or result cannot be kept as JSON.
        """
        kept = self.cache.load(kind, key, result)
        return self.cache.keep(kind, key, compute(), result) if kept is None else kept

    def pieces(self, kind: str, keys: Sequence[K], work: Callable[[K], T], result: type[T]) -> list[T]:
        """Return ``work(key)`` of every key, in their order; what is not in the cache is spread over processes.

        ``kind``, ``key`` and ``result`` are as in ``cached``; ``work`` is a function at the top of a module. Raises
        PieceError when a piece fails; those finished before it are kept.
        """
        values = [self.cache.load(kind, key, result) for key in keys]
        missing = [index for index, value in enumerate(values) if value is None]
        done = len(keys) - len(missing)
        reach = self.reporter.begin(kind, len(keys), "pieces", done)
        pieces = spread(
            partial(_untold, work), [keys[index] for index in missing], self.jobs, lambda key: f"piece {key}"
        )
        for count, (number, value) in enumerate(pieces, done + 1):
            index = missing[number]
            values[index] = self.cache.keep(kind, keys[index], value, result)
            reach(count)
        return [value for value in values if value is not None]

    def pieces_kept(self, kind: str, keys: Sequence[K], work: Callable[[K], T], result: type[T]) -> list[T | None]:
        """Return as ``pieces`` does; with ``kept`` nothing is computed, and what is not in the cache is None."""
        if self.kept:
            return [self.cache.load(kind, key, result) for key in keys]
        return list(self.pieces(kind, keys, work, result))


def _untold(work: Callable[[K], T], key: K, _tell: Tell) -> T:
    return work(key)
