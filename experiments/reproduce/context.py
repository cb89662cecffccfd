"""What a section of the report works with: how much to do, where data lies, what is already done, who hears of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from experiments.reproduce.cache import Cache
from experiments.reproduce.pool import spread
from experiments.reproduce.progress import Reporter

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

    def cached(self, kind: str, key: object, compute: Callable[[], T], result: type[T]) -> T:
        """Return what ``compute`` gives, from the cache when it was computed before.

        ``kind`` says in words what it is; ``key``, a dataclass or mapping with a whole number ``version``, holds all
        that the result depends on. CacheError when key or result cannot be kept as JSON.
        """
        known = self.cache.load(kind, key, result)
        return self.cache.keep(kind, key, compute(), result) if known is None else known

    def pieces(self, kind: str, keys: Sequence[K], work: Callable[[K], T], result: type[T]) -> list[T]:
        """Return ``work(key)`` of every key, in their order; what is not in the cache is spread over processes.

        ``kind``, ``key`` and ``result`` are as in ``cached``; ``work`` is a function at the top of a module. Raises
        PieceError when a piece fails; those finished before it are kept.
        """
        values = {index: self.cache.load(kind, key, result) for index, key in enumerate(keys)}
        found = {index: value for index, value in values.items() if value is not None}
        missing = [index for index in range(len(keys)) if index not in found]
        with self.reporter.working(kind, len(keys), len(found)) as advanced:
            for number, value in spread(work, [keys[index] for index in missing], self.jobs):
                index = missing[number]
                found[index] = self.cache.keep(kind, keys[index], value, result)
                advanced()
        return [found[index] for index in range(len(keys))]
