"""Throws hostile inputs at all readers and keeps count: taken, refused by name, findings, memory."""

from __future__ import annotations

import ctypes
import gc
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from random import Random

from experiments.fuzz import memory_targets, viewer_targets, wire_targets
from experiments.fuzz.sound import small_run
from experiments.fuzz.target import Target, outcome

REPORT_EVERY = 1000
"""Inputs between two calls of ``progress``."""
MOST_FINDINGS = 20
_PAGE_BYTES = 4096


@dataclass(frozen=True)
class Finding:
    """An input that a reader neither took nor refused as it promises."""

    target: str
    number: int
    seed: int
    given: str
    trace: str


@dataclass
class Report:
    """What came of a campaign."""

    counts: dict[str, Counter[str]] = field(default_factory=dict)
    """By target: how many inputs were "taken", and how many refused, by name of the error."""
    findings: list[Finding] = field(default_factory=list)
    rss_before_bytes: int = 0
    """Resident memory after a tenth of the inputs, when all that is kept for good should be there."""
    rss_after_bytes: int = 0

    @property
    def inputs(self) -> int:
        """Inputs so far."""
        return sum(sum(counts.values()) for counts in self.counts.values()) + len(self.findings)

    @property
    def grown_bytes(self) -> int:
        """How much the resident memory grew over the last nine tenths."""
        return self.rss_after_bytes - self.rss_before_bytes


def all_targets() -> list[Target]:
    """Return all readers."""
    run = small_run()
    return [*wire_targets.targets(run), *memory_targets.targets(run), *viewer_targets.targets(run)]


def input_of(target: Target, seed: int, number: int) -> object:
    """Return input ``number`` of a target: the same for the same three, whatever was made before."""
    return target.make(Random(seed << 64 | number))


def campaign(
    targets: Sequence[Target], inputs: int, seed: int, progress: Callable[[Report], None] = lambda _: None
) -> Report:
    """Throw ``inputs`` inputs at the targets in turn; ends early when there are too many findings.

    Warnings count as findings: on a service's standard error they would be noise that somebody else can cause.
    """
    report = Report(counts={target.name: Counter() for target in targets})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for number in range(inputs):
            if number == inputs // 10:
                report.rss_before_bytes = resident_bytes()
            _one(targets[number % len(targets)], number, seed, report)
            if number % REPORT_EVERY == REPORT_EVERY - 1:
                progress(report)
            if len(report.findings) >= MOST_FINDINGS:
                break
    report.rss_after_bytes = resident_bytes()
    return report


def resident_bytes() -> int:
    """Return how much memory this process has, aside from garbage and from what the C library keeps for later."""
    gc.collect()
    trim = getattr(ctypes.CDLL(None), "malloc_trim", None)  # the GNU library's
    if trim is not None:
        trim(0)
    return int(Path("/proc/self/statm").read_text().split()[1]) * _PAGE_BYTES


def _one(target: Target, number: int, seed: int, report: Report) -> None:
    given = input_of(target, seed, number)
    try:
        report.counts[target.name][outcome(target, given)] += 1
    except (KeyboardInterrupt, SystemExit):
        raise
    except BaseException:  # whatever it is, it is what is looked for
        shown = repr(given)
        report.findings.append(Finding(target.name, number, seed, shown[:2000], traceback.format_exc(limit=-6)))
