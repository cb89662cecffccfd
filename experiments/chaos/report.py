"""What a campaign found: a table for people, the same and more as JSON, and whether all is well."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict

from rich.table import Table

from experiments.bench.values import Value, machine
from experiments.chaos.campaign import RunReport
from experiments.chaos.drive import Done
from experiments.chaos.plan import KINDS, SERVICES, Disturbance, Plan
from services.cell.traffic import percentile
from services.rules.results import Digests

LOOP_SERVICES = ("task", "sim", "classifier", "agent")
TARGET_S = 2.0
"""Learning shall go on within this after a worker's process was started again, in the median."""
NONE = "-"


def well(plan: Plan, runs: Sequence[RunReport]) -> bool:
    """Return whether all was done, all was got over, and every run ended as the undisturbed one."""
    done = [result for run in runs for result in run.done]
    return (
        all(run.good for run in runs)
        and len(done) == len(plan.disturbances)
        and all(result.recovered for result in done)
    )


def label(planned: Disturbance) -> str:
    """Return what a row of the table is called."""
    return f"SIGKILL of {planned.victims[0]}" if planned.kind == "kill" else KINDS[planned.kind]


def table(runs: Sequence[RunReport]) -> Table:
    """Return the table of a campaign."""
    summary = Table(title=f"{len(runs)} runs, {sum(run.decisions for run in runs)} decisions")
    for heading in ("disturbance", "count", "recoveries", "no learning for [s]\nmedian, p99"):
        summary.add_column(heading, justify="right" if summary.columns else "left")
    for heading in ("after restart [s]\nmedian, p99", "lost\nsteps", "digests\nequal"):
        summary.add_column(heading, justify="right")
    for name, figures in rows(runs).items():
        summary.add_row(
            name,
            str(figures["count"]),
            str(figures["recoveries"]),
            _times(figures["pause_s"]),
            _times(figures["restart_s"]),
            str(figures["lost_steps"]) if figures["compared"] else "?",
            "yes" if figures["equal"] else "DIFFERS" if figures["compared"] else "?",
        )
    return summary


def rows(runs: Sequence[RunReport]) -> dict[str, dict[str, Value]]:
    """Return the figures of each row, in the order of the table, the last one of all together."""
    names = [f"SIGKILL of {name}" for name in SERVICES] + [KINDS[kind] for kind in KINDS if kind != "kill"]
    figures: dict[str, dict[str, Value]] = {}
    for name in names:
        chosen = [(run, [result for result in run.done if label(result.planned) == name]) for run in runs]
        chosen = [(run, done) for run, done in chosen if done]
        if chosen:
            figures[name] = _figures(chosen)
    return {**figures, "all": _figures([(run, run.done) for run in runs])}


def lines(plan: Plan, runs: Sequence[RunReport], skipped: Mapping[str, str]) -> list[str]:
    """Return what is said below the table, in plain words."""
    said = []
    restarts = _worker_restarts(runs)
    if restarts:
        middle, late = statistics.median(restarts), percentile(restarts, 99)
        kept = "kept" if middle <= TARGET_S else "missed"
        said.append(
            f"after a worker's process was started again, learning went on within {middle:.2f} s (median), "
            f"{late:.2f} s (p99); target {TARGET_S:g} s (median): {kept}"
        )
    kills = sum(len(result.planned.killed) for run in runs for result in run.done)
    said.append(f"{kills} of {plan.kills} kills, seed {plan.seed}")
    tapped = _tap_counts(runs)
    if tapped:
        said.append("through the tap: " + ", ".join(f"{count} {name}" for name, count in tapped.items()))
    said += [f"skipped: {KINDS[kind]} ({why})" for kind, why in skipped.items()]
    surprises = Counter(text for run in runs for text in run.surprises)
    said += [f"by itself: {text}" + (f" ({count} times)" if count > 1 else "") for text, count in surprises.items()]
    for run in runs:
        if run.error is not None:
            said.append(f"seed {run.seed}: {run.error}")
        elif not run.good and run.digests is not None and run.expected is not None:
            differing = [name for name, digest in run.expected.items() if run.digests.get(name) != digest]
            what = ", ".join(differing) or "the journal"
            said.append(f"seed {run.seed}: expected what the undisturbed run gives, got another {what}")
    return said


def as_json(plan: Plan, runs: Sequence[RunReport], skipped: Mapping[str, str]) -> dict[str, Value]:
    """Return everything."""
    return {
        "machine": machine(),
        "well": well(plan, runs),
        "seed": plan.seed,
        "planned": len(plan.disturbances),
        "skipped": dict(skipped),
        "rows": rows(runs),
        "worker_restart_target_s": TARGET_S,
        "worker_restart_s": _spread(_worker_restarts(runs)),
        "runs": [_run(run) for run in runs],
    }


def _run(run: RunReport) -> dict[str, Value]:
    verdict = run.verdict
    return {
        "seed": run.seed,
        "far": run.far or "",
        "decisions": run.decisions,
        "good": run.good,
        "error": run.error or "",
        "lost_steps": -1 if verdict is None else verdict.lost_steps,
        "digests": _in_words(run.digests),
        "expected": _in_words(run.expected),
        "tapped": dict(run.tapped),
        "ended_by_themselves": list(run.surprises),
        "disturbances": [
            {**asdict(result.planned), "recovered": result.recovered, **_durations(result)} for result in run.done
        ],
    }


def _in_words(digests: Digests | None) -> dict[str, str]:
    return {} if digests is None else {name: str(digest) for name, digest in digests.items()}


def _durations(done: Done) -> dict[str, float]:
    times = {"pause_s": done.pause_s, "restart_s": done.restart_s}
    return {name: round(value, 4) for name, value in times.items() if value is not None}


def _figures(chosen: Sequence[tuple[RunReport, Sequence[Done]]]) -> dict[str, Value]:
    done = [result for _, some in chosen for result in some]
    verdicts = [run.verdict for run, _ in chosen]
    compared = [verdict for verdict in verdicts if verdict is not None]
    return {
        "count": len(done),
        "recoveries": sum(result.recovered for result in done),
        "pause_s": _spread([result.pause_s for result in done if result.pause_s is not None]),
        "restart_s": _spread([result.restart_s for result in done if result.restart_s is not None]),
        "compared": bool(compared),
        "lost_steps": sum(verdict.lost_steps for verdict in compared),
        "equal": len(compared) == len(verdicts) > 0 and all(verdict.equal for verdict in compared),
    }


def _worker_restarts(runs: Sequence[RunReport]) -> list[float]:
    done = [result for run in runs for result in run.done if result.planned.kind == "kill"]
    return [
        result.restart_s
        for result in done
        if result.planned.victims[0] in LOOP_SERVICES and result.restart_s is not None
    ]


def _tap_counts(runs: Sequence[RunReport]) -> dict[str, int]:
    total: Counter[str] = Counter()
    for run in runs:
        total.update(run.tapped)
    return dict(total)


def _spread(seconds: Sequence[float]) -> dict[str, Value]:
    if not seconds:
        return {}
    return {"n": len(seconds), "median": statistics.median(seconds), "p99": percentile(seconds, 99)}


def _times(spread: Value) -> str:
    if not isinstance(spread, Mapping) or not spread:
        return NONE
    return f"{spread['median']:.2f}, {spread['p99']:.2f}"
