"""What the thesis's chapter 6 and Appendix B.2 report of each experiment, as numbers.

Torques are the thesis's divided by ten: its sensor's metric unit for moments is N m x 10.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

Quantity = Literal["return", "force", "torque", "failures"]


@dataclass(frozen=True)
class Reported:
    """One experiment of the thesis; None for what it does not say."""

    name: str
    """Name of our definition."""
    where: str
    """Section of the thesis."""
    title: str
    figures: Mapping[Quantity, str]
    """Numbers of its figures."""
    steady_from: int | None = None
    """Episodes until the thesis calls it steady."""
    episode_return: float | None = None
    """Return in the steady state."""
    force_n: float | None = None
    """Mean force that it stays below, or settles at, in the steady state."""
    torque_nm: float | None = None
    success: float | None = None
    """Part of the last quarter's insertions that has to succeed: our own aim, the thesis gives no number."""
    collisions_after: int | None = None
    """Collisions after the run was steady."""
    collisions: int | None = None
    """Collisions in the whole run."""
    longest: int | None = None
    """Longest series of successful insertions."""
    why: Mapping[str, str] = field(default_factory=dict)
    """By quantity, why ours differs where it does."""


REPORTED: Sequence[Reported] = (
    Reported(
        "initial",
        "6.1",
        "First tests: translations only, random starts",
        {"return": "6.1", "failures": "6.2", "force": "6.3"},
        steady_from=50,
        episode_return=-90.0,
    ),
    Reported(
        "chamfered-q-egreedy",
        "6.2.1, B.2.1",
        "Chamfered hole, Q-learning, epsilon-greedy",
        {"return": "6.5", "force": "B.13", "torque": "B.14", "failures": "B.15"},
        steady_from=70,
        episode_return=-15.0,
        force_n=1.0,
        torque_nm=0.05,
        success=0.97,
    ),
    Reported(
        "chamfered-q-softmax",
        "6.2.1",
        "Chamfered hole, Q-learning, softmax",
        {"return": "6.6", "force": "6.8", "torque": "6.9", "failures": "6.10"},
        steady_from=40,
        episode_return=-15.0,
        force_n=0.33,
        torque_nm=0.04,
        success=0.995,
        collisions_after=1,
    ),
    Reported(
        "chamfered-sarsa-softmax",
        "6.2.1",
        "Chamfered hole, SARSA, softmax",
        {"return": "6.11", "force": "6.12", "torque": "6.13", "failures": "6.14"},
        steady_from=230,
        episode_return=-18.0,
        force_n=0.6,
        success=0.995,
        collisions_after=7,
    ),
    Reported(
        "rubber-q-softmax",
        "6.2.2",
        "Rubber peg, Q-learning, softmax",
        {"return": "6.16", "force": "6.17", "torque": "6.18", "failures": "6.19"},
        steady_from=40,
        episode_return=-16.0,
        force_n=0.2,
        torque_nm=0.05,
        collisions=7,
    ),
    Reported(
        "chamferless-q-softmax",
        "6.3",
        "Hole without chamfer, Q-learning, softmax",
        {"return": "6.21", "force": "6.22", "torque": "6.23", "failures": "6.24"},
        steady_from=270,
        episode_return=-11.0,
        force_n=0.5,
        success=0.99,
    ),
    Reported(
        "chamferless-q-egreedy",
        "B.2.3",
        "Hole without chamfer, Q-learning, epsilon-greedy",
        {"return": "B.17", "force": "B.18", "torque": "B.19", "failures": "B.20"},
        steady_from=180,
        episode_return=-10.0,
    ),
    Reported(
        "square-q-softmax",
        "6.4, B.2.4",
        "Square peg, Q-learning, softmax",
        {"return": "6.26, B.21", "force": "6.27, B.22", "torque": "6.28, B.23", "failures": "6.29, B.24"},
        steady_from=140,
        force_n=0.3,
        torque_nm=0.1,
        longest=110,
    ),
    Reported(
        "paper2-random-start",
        "conference paper 2",
        "Random starts, reward for falling force",
        {},
    ),
)
"""In the order of the thesis. Figures 6.4, 6.15, 6.20 and 6.25 are drawings of the parts."""
