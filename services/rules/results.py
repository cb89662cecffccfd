"""What a run gave, and the figures that are compared: steady state, failures, blocks at the beginning and the end.

Pure, and above ``services.wire`` only, so that a distributed run is summed up by the same code. Numbers of
``EpisodeSummary`` are used as they are: return without unit, force in N, torque in N m.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NotRequired, TypedDict

from services.rules.swaps import words
from services.wire import codec
from services.wire.definition import Definition
from services.wire.messages import EpisodeSummary, Swap

STEADY_EPISODES = 100
"""Length of the window that must be steady."""
STEADY_SUCCESSES = 98
"""How many episodes of the window must succeed."""
STEADY_TOLERANCE = 0.25
"""How far the window's mean return may be from that of the last quarter, as a part of the latter's magnitude."""
BLOCK = 10
"""Episodes in a block of the failure count, and in the block at the beginning."""


class Digests(TypedDict):
    """SHA-256 in hex of the Q-table, the ART2 weights and the episode log at the end of a run."""

    q_table: str
    art2: str
    episodes: str


Block = TypedDict("Block", {"return": float, "force_n": float, "torque_nm": float, "success": float})
"""Means over a block of episodes; ``success`` is the fraction inserted, 0..1."""


class RunSummary(TypedDict):
    """One run in ``summary.json``."""

    seed: int
    episodes: int
    steady_from: int | None
    failures_per_10: list[int]
    states: int
    first_10: Block
    last_quarter: Block
    collisions: int
    digests: Digests


class Wanted(TypedDict):
    """What was to be run: so many episodes of each of these seeds."""

    seeds: list[int]
    episodes: int


class Summary(TypedDict):
    """The content of ``summary.json``; it holds no times, so the same runs give the same bytes."""

    experiment: str
    definition_sha256: str
    runs: list[RunSummary]
    swaps: NotRequired[list[str]]
    """In words, what was swapped in the course of each run, and from when on; not there without any."""
    interrupted: NotRequired[Wanted]
    """What should have been run, where Ctrl-C came before; not there when all was."""


@dataclass(frozen=True)
class RunResult:
    """One finished run: its seed, its episodes in order, and the digests of what was learnt."""

    seed: int
    episodes: tuple[EpisodeSummary, ...]
    digests: Digests


def episodes_digest(episodes: Sequence[EpisodeSummary]) -> str:
    """Return the SHA-256, in hex, of the concatenated MessagePack bytes of the summaries in order."""
    digest = hashlib.sha256()
    for summary in episodes:
        digest.update(codec.encode(summary))
    return digest.hexdigest()


def succeeded(summary: EpisodeSummary) -> bool:
    """Return whether the peg went in; every other outcome is a failure."""
    return summary.outcome == "inserted"


def last_quarter(episodes: Sequence[EpisodeSummary]) -> Sequence[EpisodeSummary]:
    """Return the last quarter of a run, rounded up to whole episodes: never empty for a run that is not."""
    return episodes[len(episodes) - math.ceil(len(episodes) / 4) :]


def steady_from(episodes: Sequence[EpisodeSummary]) -> int | None:
    """Return n, the number of episodes after which the run is steady, or None when it never is.

    n is the first for which, of the 100 episodes after the first n (``episodes[n:n+100]``, numbered n to n+99 in the
    log), at least 98 succeed and the mean return differs from that of the run's last quarter by at most 25 % of the
    latter's magnitude; n = 0 is a run that is steady from its first episode.

    Only whole windows count. So a run of less than 100 episodes is never steady, one of N can be steady from N - 100
    at the latest, and one of less than 134 compares the last quarter with a window that it may lie in. When the last
    quarter's mean return is 0, only a window of mean 0 agrees with it.
    """
    return steady_after([summary.episode_return for summary in episodes], [succeeded(summary) for summary in episodes])


def steady_after(returns: Sequence[float], inserted: Sequence[bool]) -> int | None:
    """Return ``steady_from`` of a run known by the return of each episode and whether the peg went in."""
    if len(returns) < STEADY_EPISODES:
        return None
    reference = _mean(returns[len(returns) - math.ceil(len(returns) / 4) :])
    successes = sum(inserted[:STEADY_EPISODES])
    for n in range(len(returns) - STEADY_EPISODES + 1):
        if n:
            successes += inserted[n + STEADY_EPISODES - 1] - inserted[n - 1]
        if successes < STEADY_SUCCESSES:
            continue
        mean = _mean(returns[n : n + STEADY_EPISODES])
        if abs(mean - reference) <= STEADY_TOLERANCE * abs(reference):
            return n
    return None


def failures_per_10(episodes: Sequence[EpisodeSummary]) -> list[int]:
    """Return the failures in each block of ten episodes; the last block has what is left."""
    return [
        sum(not succeeded(summary) for summary in episodes[start : start + BLOCK])
        for start in range(0, len(episodes), BLOCK)
    ]


def run_summary(run: RunResult) -> RunSummary:
    """Return the figures of one run. Raises ValueError for a run without episodes."""
    if not run.episodes:
        raise ValueError(f"seed {run.seed}: expected at least one episode, got none")
    return {
        "seed": run.seed,
        "episodes": len(run.episodes),
        "steady_from": steady_from(run.episodes),
        "failures_per_10": failures_per_10(run.episodes),
        "states": run.episodes[-1].states,
        "first_10": _block(run.episodes[:BLOCK]),
        "last_quarter": _block(last_quarter(run.episodes)),
        "collisions": sum(summary.outcome == "collision" for summary in run.episodes),
        "digests": run.digests,
    }


def summary(
    definition: Definition, definition_sha256: str, runs: Sequence[RunResult], swaps: Sequence[Swap] = ()
) -> Summary:
    """Return the content of ``summary.json``, runs in the given order. Raises ValueError for a run without episodes."""
    result: Summary = {
        "experiment": definition.name,
        "definition_sha256": definition_sha256,
        "runs": [run_summary(run) for run in runs],
    }
    if swaps:
        result["swaps"] = [words(swap) for swap in swaps]
    return result


def _block(episodes: Sequence[EpisodeSummary]) -> Block:
    return {
        "return": _mean([summary.episode_return for summary in episodes]),
        "force_n": _mean([summary.mean_force_n for summary in episodes]),
        "torque_nm": _mean([summary.mean_torque_nm for summary in episodes]),
        "success": _mean([float(succeeded(summary)) for summary in episodes]),
    }


def _mean(values: Sequence[float]) -> float:
    # fsum does not depend on the order, so equal windows have equal means wherever they stand.
    return math.fsum(values) / len(values)
