"""``bench query``: how long the agent takes to answer while it learns at full speed, and what the questions cost it.

A real cell runs; a client asks at a steady, modest rate, one question after the other: for the policy by state and by
F/T vector, and, to see how fast the machine is just now, the store for who it is, which has nearly nothing else to do.
The agent's policy version counts what it learns meanwhile, so that counting adds nothing to the load.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from experiments.bench.cell import MeasuredCell, Subject, measured_cell
from experiments.bench.values import Value, spread
from services.cell.client import Client
from services.cell.traffic import percentile
from services.wire.codec import decode_payload
from services.wire.errors import CellError, NoAnswerError
from services.wire.keys import ALIVE, POLICY, TASK_STEPS, name_of
from services.wire.messages import JournalEpisode, PolicyAnswer

TARGET_P99_MS = 5.0
POLICIES = ("by_state", "by_ft")
LEARNT_FIRST = 200
"""Updates before anything is measured: start-up and first calls."""
READY_WITHIN_S = 120.0
ANSWER_WITHIN_S = 5.0
DEFAULT_VECTOR = (0.2, 0.0, -1.5, 0.0, 0.02, 0.0)
"""Asked for as long as nothing was felt in the episode under way."""


class Part(NamedTuple):
    """One part of a round."""

    latencies_ms: tuple[float, ...]
    """Of the questions, in their order; empty for the part without."""
    learnt_per_s: float
    """Updates, one for each decision of the agent."""


class Round(NamedTuple):
    """One measurement: without questions, of an idle service, by state, by F/T vector."""

    alone: Part
    idle: Part
    by_state: Part
    by_ft: Part


def measure(subject: Subject, seconds: float, per_s: float, rounds: int) -> dict[str, Value]:
    """Measure so many rounds in one cell: parts of ``seconds`` each, with ``per_s`` questions a second.

    Raises CellError when it does not come up or does not answer.
    """
    with measured_cell(subject.plan()) as measured:
        _wait(measured)
        return report(subject, seconds, per_s, [_round(measured.client, seconds, per_s) for _ in range(rounds)])


def report(subject: Subject, seconds: float, per_s: float, rounds: Sequence[Round]) -> dict[str, Value]:
    """Return the figures of some rounds."""
    figures: dict[str, Value] = {
        "experiment": subject.experiment,
        "seed": subject.seed,
        "rounds": len(rounds),
        "seconds_each": seconds,
        "queries_per_s": per_s,
        "learnt_per_s_without": spread([trial.alone.learnt_per_s for trial in rounds]),
    }
    p99_ms: dict[str, dict[str, float]] = {}
    for kind in ("idle", *POLICIES):
        parts: list[Part] = [getattr(trial, kind) for trial in rounds]
        p99_ms[kind] = spread([percentile(part.latencies_ms, 99) for part in parts])
        figures[kind] = {
            "queries": sum(len(part.latencies_ms) for part in parts),
            "median_ms": spread([percentile(part.latencies_ms, 50) for part in parts]),
            "p99_ms": p99_ms[kind],
            "max_ms": spread([max(part.latencies_ms) for part in parts]),
            "learnt_per_s": spread([part.learnt_per_s for part in parts]),
        }
    worst = max(p99_ms[kind]["median"] for kind in POLICIES)
    return {**figures, "target_p99_ms": TARGET_P99_MS, "target_met": worst < TARGET_P99_MS}


def _round(client: Client, seconds: float, per_s: float) -> Round:
    states = (f"{POLICY}?state={state}" for state in itertools.cycle(range(4)))
    return Round(
        _part(client, lambda: time.sleep(seconds)),
        _asking(client, seconds, per_s, itertools.repeat(name_of(ALIVE, service="store"))),
        _asking(client, seconds, per_s, states),
        _asking(client, seconds, per_s, _vectors(client)),
    )


def _asking(client: Client, seconds: float, per_s: float, questions: Iterator[str]) -> Part:
    """Ask at a steady rate; a question that is due while another is open waits for it."""
    latencies_ms: list[float] = []

    def ask() -> None:
        due = time.perf_counter()
        end = due + seconds
        while (now := time.perf_counter()) < end:
            time.sleep(max(0.0, due - now))
            due = max(due, now) + 1 / per_s
            latencies_ms.append(1000 * _ask(client, next(questions))[1])

    return _part(client, ask)._replace(latencies_ms=tuple(latencies_ms))


def _part(client: Client, act: Callable[[], None]) -> Part:
    """Return how fast the agent learns while ``act`` is called."""
    before, began = _version(client), time.perf_counter()
    act()
    after, ended = _version(client), time.perf_counter()
    return Part((), (after - before) / (ended - began))


def _version(client: Client) -> int:
    payload, _ = _ask(client, f"{POLICY}?state=0")
    return decode_payload(PolicyAnswer, payload).policy_version


def _ask(client: Client, selector: str) -> tuple[bytes, float]:
    """Ask and return the one good answer, and the time from the question to it [s]. Raises NoAnswerError."""
    key = client.keys.of(selector)
    began = time.perf_counter()
    replies = list(client.session.get(key, timeout=ANSWER_WITHIN_S))
    took_s = time.perf_counter() - began
    if len(replies) != 1 or replies[0].ok is None:
        raise NoAnswerError(f"bench: {key}: expected one good answer, got {len(replies)} replies")
    return replies[0].ok.payload.to_bytes(), took_s


def _vectors(client: Client) -> Iterator[str]:
    """Yield vectors that were felt lately, again and again."""
    steps = client.ask(TASK_STEPS, JournalEpisode).steps[-100:]
    felt = [(*step.force_n, *step.torque_nm) for step in steps] or [DEFAULT_VECTOR]
    return (f"{POLICY}?ft={','.join(map(repr, vector))}" for vector in itertools.cycle(felt))


def _wait(measured: MeasuredCell) -> None:
    """Wait until the agent has learnt a little. Raises CellError when a process has ended, or it takes too long."""
    deadline = time.monotonic() + READY_WITHIN_S
    while "agent" not in measured.client.alive() or _version(measured.client) < LEARNT_FIRST:
        measured.mind()
        if time.monotonic() > deadline:
            raise CellError(f"bench: expected the agent to learn within {READY_WITHIN_S:g} s, it did not")
        time.sleep(0.1)
