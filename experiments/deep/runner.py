"""Does the runs that are not done yet, and keeps each as it ends."""

from __future__ import annotations

from collections.abc import Sequence

from experiments.deep.jobs import KIND, Environment, Job, Learnt, Order, key
from experiments.deep.learner import work
from experiments.lab import pool
from experiments.lab.progress import Reporter
from experiments.reproduce.cache import Cache, key_bytes


def there_is(jobs: Sequence[Job], kept: Cache, environment: Environment) -> dict[Job, Learnt]:
    """Return what was done before."""
    loaded = {job: kept.load(KIND, key(job, environment), Learnt) for job in jobs}
    return {job: learnt for job, learnt in loaded.items() if learnt is not None}


def run(
    jobs: Sequence[Job], kept: Cache, environment: Environment, processes: int, reporter: Reporter
) -> dict[Job, Learnt]:
    """Do what is not done yet, what is the same once, and return the result of every job.

    Raises PieceError when a run fails, KeyboardInterrupt upon Ctrl-C; what has ended by then is kept.
    """
    made = there_is(jobs, kept, environment)
    alike: dict[bytes, list[Job]] = {}
    for job in jobs:
        alike.setdefault(key_bytes(KIND, key(job, environment)), []).append(job)
    missing = [group for group in alike.values() if group[0] not in made]
    total, left = (round(sum(group[0].cost_s for group in some)) for some in (alike.values(), missing))
    before = total - left
    # In seconds of an algorithm's usual pace, since one takes six times as long over an episode as another.
    reach = reporter.begin(f"deep, {len(missing)} of {len(alike)} runs to do", total + 1, "s expected", before)
    parts = [0.0] * len(missing)

    def advanced(index: int, episodes: int) -> None:
        job = missing[index][0]
        parts[index] = job.cost_s * min(episodes / job.episodes, 1.0)
        reach(min(before + round(sum(parts)), total))

    orders = [Order(group[0], environment) for group in missing]
    for index, learnt in pool.spread(work, orders, processes, lambda order: order.job.name, advanced):
        for job in missing[index]:
            made[job] = learnt
        kept.keep(KIND, key(missing[index][0], environment), learnt, Learnt)
        reporter.say(_line(missing[index][0], learnt))
    reach(total + 1)
    return made


def _line(job: Job, learnt: Learnt) -> str:
    of, last = learnt.outcome, max(1, job.episodes // 3)
    failed = sum(end != "i" for end in of.outcomes[-last:])
    return f"{job.name}: {failed} of the last {last} failed; {learnt.decisions} decisions in {of.cpu_s:.0f} s"
