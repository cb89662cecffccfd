"""Does the jobs of a board that are not done yet, wherever, and keeps each as it ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, Protocol

from experiments.lab import pool
from experiments.lab.progress import Reporter
from experiments.leaderboard.folder import KIND, Folder
from experiments.leaderboard.jobs import Done, Job, Order, Outcome, key, order, work
from experiments.reproduce.cache import key_bytes

Advanced = Callable[[int, int], None]


class Spread(Protocol):
    """Does work in many places."""

    def __call__(
        self,
        work: Callable[[Order, pool.Tell], Done],
        keys: Sequence[Order],
        name: Callable[[Order], str],
        advanced: Advanced,
    ) -> Iterator[tuple[int, Done]]:
        """Yield the index of each order and what came of it, as each ends; ``advanced`` hears how far each is."""


def on(address: str, say: Callable[[str], None]) -> Spread:
    """Return a spread over the Dask cluster whose scheduler is at ``address``."""
    from experiments.lab import cluster  # an extra that few need

    def spread(
        work: Callable[[Order, pool.Tell], Done],
        keys: Sequence[Order],
        name: Callable[[Order], str],
        advanced: Advanced,
    ) -> Iterator[tuple[int, Done]]:
        for index, done in cluster.spread(address, work, keys, say):
            yield index, Done(failure=done.why) if isinstance(done, cluster.Lost) else done

    return spread


class Results(NamedTuple):
    """What there is of some jobs."""

    outcomes: dict[Job, Outcome]
    failures: dict[Job, str]


def here(jobs: int) -> Spread:
    """Return a spread over so many processes of this machine."""
    return lambda work, keys, name, advanced: pool.spread(work, keys, jobs, name, advanced)


def there_is(folder: Folder, jobs: Sequence[Job]) -> Results:
    """Return what was done before."""
    loaded = {job: folder.outcome(job) for job in jobs}
    return Results({job: outcome for job, outcome in loaded.items() if outcome is not None}, {})


def run(what: str, jobs: Sequence[Job], folder: Folder, spread: Spread, reporter: Reporter) -> Results:
    """Do what is not done yet, the longest first and what is the same once, and return all there is then.

    A job that fails is among the failures, and is tried again by the next start. Raises PieceError when a process
    dies, KeyboardInterrupt upon Ctrl-C; what has ended by then is kept.
    """
    results = there_is(folder, jobs)
    alike: dict[bytes, list[Job]] = {}
    for job in jobs:
        alike.setdefault(key_bytes(KIND, key(job)), []).append(job)
    groups = sorted(alike.values(), key=lambda group: -group[0].cost)
    missing = [group for group in groups if group[0] not in results.outcomes]
    total, left = (round(sum(group[0].cost for group in some)) for some in (groups, missing))
    before = total - left
    reach = reporter.begin(f"{what}, {len(missing)} of {len(groups)} runs to do", total + 1, "moves", before)
    parts = [0.0] * len(missing)

    def advanced(index: int, episodes: int) -> None:
        job = missing[index][0]
        parts[index] = job.cost * min(episodes / job.episodes, 1.0)
        reach(min(before + round(sum(parts)), total))

    orders = [order(group[0]) for group in missing]
    for index, done in spread(work, orders, lambda given: given.job.name, advanced):
        job = missing[index][0]
        if done.outcome is None:
            reporter.say(f"{job.name}: {done.failure}")
            results.failures.update(dict.fromkeys(missing[index], done.failure))
        else:
            folder.keep(job, done.outcome, done.skill)
            results.outcomes.update(dict.fromkeys(missing[index], done.outcome))
        advanced(index, job.episodes)
    reach(total + 1)
    return results
