"""``bench env`` measures what is installed and names what is not."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pytest

pytest.importorskip("gymnasium", reason="the extra gym is not installed")

import treenail  # noqa: F401  # tells Gymnasium of the environment
from experiments.bench import env
from services.wire.errors import TreenailError


def test_everything_is_measured_or_named_with_the_reason() -> None:
    report: Any = env.measure("initial", ["limits.move_limit=40"], steps=15, seed=0, rounds=2)
    rates, others = report["steps_per_s"], report["others"]
    absent = others if isinstance(others, Mapping) else {}
    assert set(rates) | set(absent) == {
        f"{env.OURS}, listed moves",
        f"{env.OURS}, any moves",
        env.MANISKILL,
        env.ROBOSUITE,
    }
    assert all(0 < rate["min"] <= rate["median"] for rate in rates.values())
    assert all(str(reason).startswith("not measured: ") for reason in absent.values())


def test_an_unknown_experiment_is_refused() -> None:
    with pytest.raises(TreenailError, match="expected a shipped experiment's name"):
        env.measure("nonsense", [], steps=1, seed=0, rounds=1)
