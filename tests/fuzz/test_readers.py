"""The short form of ``make fuzz``: twenty thousand hostile inputs, and that what is looked for would be noticed."""

from __future__ import annotations

import gc
import subprocess
import sys
import tracemalloc
import warnings
from collections import Counter
from random import Random

import pytest

from experiments.fuzz.campaign import Report, all_targets, campaign, input_of
from experiments.fuzz.golden import golden
from experiments.fuzz.mutate import mutate_bytes
from experiments.fuzz.target import BrokenPromiseError, Target, outcome
from experiments.fuzz.wire_targets import check_taken
from services.wire import codec
from services.wire.errors import ContractError, TreenailError
from services.wire.messages import MESSAGES

INPUTS = 20_000
TARGETS = {target.name: target for target in all_targets()}
EACH = -(-INPUTS // len(TARGETS))


def fails_with(error: Exception) -> Target:
    """Return a reader that promises to refuse with TreenailError, and raises something."""

    def read(_: object) -> None:
        raise error

    return Target("broken", lambda rng: rng.random(), read, (TreenailError,))


@pytest.mark.parametrize("name", TARGETS)
def test_a_reader_takes_or_refuses_as_it_promises(name: str) -> None:
    report = campaign([TARGETS[name]], EACH, seed=7)
    assert [finding.trace for finding in report.findings] == []
    counts = report.counts[name]
    assert counts.total() == EACH
    assert counts.total() > counts["taken"], "nothing was refused: these inputs are not hostile"


def test_every_message_is_both_taken_and_refused() -> None:
    """Inputs that are all refused at the door test the door alone."""
    for kind in MESSAGES:
        name = f"message {kind.__name__}"
        counts = campaign([TARGETS[name]], 300, seed=3).counts[name]
        assert {"taken", "BadPayloadError", "WrongTypeError"} <= set(counts), name


def test_golden_bytes_that_were_changed_are_taken_or_refused() -> None:
    rng, counts = Random(11), Counter[str]()
    for row in golden():
        for _ in range(200):
            changed = mutate_bytes(rng, bytes.fromhex(row.payload))
            try:
                message = codec.decode_any(changed, row.encoding)
            except ContractError as error:
                counts[type(error).__name__] += 1
            else:
                check_taken(type(message), changed)
                counts["taken"] += 1
    assert counts["taken"] > 0 < counts["BadPayloadError"]


def test_no_memory_is_kept() -> None:
    """Whatever a reader holds on to would show: the inputs of one half alone are some megabytes."""
    targets = list(TARGETS.values())
    tracemalloc.start()
    try:
        campaign(targets, 2000, seed=5)
        gc.collect()
        before, _ = tracemalloc.get_traced_memory()
        campaign(targets, 2000, seed=6)
        gc.collect()
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 200_000


@pytest.mark.parametrize("error", [KeyError("x"), ValueError("one"), RecursionError(), MemoryError(), AssertionError()])
def test_an_error_that_nobody_promised_is_a_finding(error: Exception) -> None:
    report = campaign([fails_with(error)], 3, seed=1)
    assert len(report.findings) == 3
    assert type(error).__name__ in report.findings[0].trace


@pytest.mark.parametrize("text", ["", "two\nlines", "\x1b[2J", "x" * 5000])
def test_an_error_that_is_no_line_is_a_finding(text: str) -> None:
    with pytest.raises(BrokenPromiseError):
        outcome(fails_with(TreenailError(text)), None)
    assert outcome(fails_with(TreenailError("cell: expected a name, got none")), None) == "TreenailError"


def test_a_warning_is_a_finding() -> None:
    def read(_: object) -> None:
        warnings.warn("overflow", RuntimeWarning, stacklevel=1)

    report = campaign([Target("warns", lambda rng: rng.random(), read, ())], 2, seed=1)
    assert len(report.findings) == 2


def test_a_campaign_counts_what_came_of_each_input_and_says_how_far_it_is() -> None:
    said: list[int] = []
    report = campaign(list(TARGETS.values())[:2], 2500, 1, lambda report: said.append(report.inputs))
    assert said == [1000, 2000]
    assert report.inputs == 2500
    assert report.rss_before_bytes > 0 < report.rss_after_bytes
    assert Report().grown_bytes == 0


def test_an_input_is_the_same_whenever_it_is_made() -> None:
    for name, target in TARGETS.items():
        later = repr(input_of(target, 4, 11))
        assert repr(input_of(target, 4, 10)) != later, name
        assert repr(input_of(target, 4, 11)) == later, name


def test_the_command_says_what_came_of_it_and_can_show_one_input_again() -> None:
    command = [sys.executable, "-m", "experiments.fuzz"]
    done = subprocess.run([*command, "--inputs", "390", "--guided", "0"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert all(name in done.stdout for name in TARGETS)
    assert "390 inputs, 0 findings" in done.stdout
    words = ["--only", "state parameter", "--number", "5"]
    again = subprocess.run([*command, *words], capture_output=True, text=True, check=True).stdout.splitlines()
    assert again[0] == repr(input_of(TARGETS["state parameter"], 1, 5))
    assert again[-1] == outcome(TARGETS["state parameter"], input_of(TARGETS["state parameter"], 1, 5))
