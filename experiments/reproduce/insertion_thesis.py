"""What the thesis's chapter 6 and Appendix B.2 report of each experiment, as numbers, each with the line that says it.

Torques are the thesis's divided by ten: its sensor's metric unit for moments is N m x 10.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

Quantity = Literal["return", "force", "torque", "failures"]


class Said(NamedTuple):
    """A number of the thesis, and where it stands: a test holds it against the text, where the text is at hand."""

    value: float
    """In our units."""
    printed: str
    """The words that say it."""
    line: int
    """Line of the thesis's text, from 1."""
    line_sha256: str
    """First 16 hex digits of the SHA-256 of that line."""


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
    steady_from: Said | None = None
    """Episodes until the thesis calls it steady."""
    episode_return: Said | None = None
    """Return in the steady state."""
    force_n: Said | None = None
    """Mean force that it stays below, or settles at, in the steady state."""
    force_end_n: Said | None = None
    """Force at the end of the run."""
    torque_nm: Said | None = None
    collisions_after: Said | None = None
    """Collisions after the run was steady."""
    collisions: Said | None = None
    """Collisions in the whole run."""
    longest: Said | None = None
    """Longest series of successful insertions."""
    success_aim: float | None = None
    """Part of the last quarter's insertions that has to succeed: our own aim, the thesis gives no number."""
    apart: str = ""
    """Why our task cannot be the thesis's, so that no number of it is better or worse than the thesis's."""
    why: Mapping[str, str] = field(default_factory=dict)
    """By quantity, why ours differs where it does."""

    @property
    def said(self) -> tuple[Said, ...]:
        """Return all numbers of the thesis."""
        return tuple(value for value in vars(self).values() if isinstance(value, Said))


_EXPLORING = (
    "One move in ten stays random for ever, and one of them can jam the peg: the table below counts the failures that "
    "follow one, and how the same Q-table does without."
)
_PRICE = (
    "The reward does not price force: with full knowledge of the pose its best path costs 16 moves at 0.32 N, or 17 at "
    "0.18 N (treenail oracle)."
)
_STICKING = (
    "How often a rubber peg collides follows its friction, which the thesis does not give: in 150 episodes 29 times "
    "with 0.8, 20 with 0.5, 12 with 0.3 (medians of three seeds)."
)
_THRESHOLD = (
    "Contact begins at 0.3 N here, as with the other pegs; the thesis gives no threshold, and 0.2 N lies below ours."
)
_SIDEWAYS = (
    "As we read start pose and clearance, the peg has to go 3.1 mm sideways before it can drop: 16 moves of 0.2 mm, "
    "each of which costs 1."
)
_SLIDING = "The peg slides over a flat face by the friction that it feels; the reward does not price force."
_FLAT = "On a flat face a press or a tilt that is tried late can still end at 10 N."
_OTHER_TASK = (
    "Not one task: the thesis does not say where this peg started from, how large a step was, or what a success was."
)

REPORTED: Sequence[Reported] = (
    Reported(
        "initial",
        "6.1",
        "First tests: translations only, random starts",
        {"return": "6.1", "failures": "6.2", "force": "6.3"},
        steady_from=Said(50, "after 50 episodes", 1882, "174a1e7ebf513815"),
        episode_return=Said(-90.0, "between -100 and -80", 1882, "174a1e7ebf513815"),
        apart=_OTHER_TASK,
    ),
    Reported(
        "chamfered-q-egreedy",
        "6.2.1, B.2.1",
        "Chamfered hole, Q-learning, epsilon-greedy",
        {"return": "6.5", "force": "B.13", "torque": "B.14", "failures": "B.15"},
        steady_from=Said(70, "first 70 episodes", 1944, "b30aa9e44727fc08"),
        episode_return=Said(-15.0, "level of -15", 1957, "d291a45a3acdf5a2"),
        force_n=Said(1.0, "below 1 Newton", 2870, "5e0f1c55b62913af"),
        torque_nm=Said(0.05, "around 0.5 Nm", 2874, "c40519a0539a73c1"),
        success_aim=0.97,
        why={"steady": _EXPLORING, "return": _EXPLORING, "failures": _EXPLORING},
    ),
    Reported(
        "chamfered-q-softmax",
        "6.2.1",
        "Chamfered hole, Q-learning, softmax",
        {"return": "6.6", "force": "6.8", "torque": "6.9", "failures": "6.10"},
        steady_from=Said(40, "After 40 episodes transition time", 2006, "ff513aa389cd5195"),
        episode_return=Said(-15.0, "cumulative reward -15", 2006, "ff513aa389cd5195"),
        force_n=Said(0.33, "never exceeded the value 0.33 N", 1986, "30c26e7b28c04196"),
        torque_nm=Said(0.04, "around 0.4 Nm", 1990, "a4aa791433d51207"),
        collisions_after=Said(1, "Only one interrupted task", 2229, "15293d457c8c533b"),
        success_aim=0.995,
        why={"force": _PRICE},
    ),
    Reported(
        "chamfered-sarsa-softmax",
        "6.2.1",
        "Chamfered hole, SARSA, softmax",
        {"return": "6.11", "force": "6.12", "torque": "6.13", "failures": "6.14"},
        steady_from=Said(230, "It took 230 episodes", 2014, "01c4627fb8871663"),
        episode_return=Said(-18.0, "value of -18", 2016, "17c57d66607c7cce"),
        force_n=Said(0.2, "low average value of 0.2 N", 2233, "47955a7397147e2b"),
        force_end_n=Said(0.07, "the value of 0.07 N", 2023, "11fbd0717459e420"),
        collisions_after=Said(7, "seven times during the stable state", 2229, "15293d457c8c533b"),
        success_aim=0.995,
        why={"force": _PRICE},
    ),
    Reported(
        "rubber-q-softmax",
        "6.2.2",
        "Rubber peg, Q-learning, softmax",
        {"return": "6.16", "force": "6.17", "torque": "6.18", "failures": "6.19"},
        steady_from=Said(40, "40 episodes long", 2048, "5fdf2234bcf02b85"),
        episode_return=Said(-16.0, "on the level of 16", 2048, "5fdf2234bcf02b85"),
        force_n=Said(0.2, "dropped below 0.2 N", 2057, "34e7be918f66e247"),
        torque_nm=Said(0.05, "below 0.5 Nm", 2064, "f9ff1f18256978c8"),
        collisions=Said(7, "Only seven unfinished tasks", 2243, "7d523b6fc3c5956a"),
        why={"steady": _STICKING, "return": _STICKING, "failures": _STICKING, "force": _THRESHOLD},
    ),
    Reported(
        "chamferless-q-softmax",
        "6.3",
        "Hole without chamfer, Q-learning, softmax",
        {"return": "6.21", "force": "6.22", "torque": "6.23", "failures": "6.24"},
        steady_from=Said(270, "after episode 270", 2096, "4b668b467a40547a"),
        episode_return=Said(-11.0, "around -11", 2096, "4b668b467a40547a"),
        force_n=Said(0.1, "average value of 0.1 N", 2100, "19ea70f2f21eb2df"),
        force_end_n=Said(0.2, "final value of 0.2 N", 2102, "5710f2e865fe5c33"),
        torque_nm=Said(0.03, "value of 0.3 Nm", 2116, "8206265d7986e926"),
        collisions_after=Said(1, "during episode 572", 2098, "166a81df27f8be67"),
        success_aim=0.99,
        why={"return": _SIDEWAYS, "force": _SLIDING, "torque": _SLIDING, "failures": _FLAT},
    ),
    Reported(
        "chamferless-q-egreedy",
        "B.2.3",
        "Hole without chamfer, Q-learning, epsilon-greedy",
        {"return": "B.17", "force": "B.18", "torque": "B.19", "failures": "B.20"},
        steady_from=Said(180, "180 episodes long", 2910, "8e778fdd22483ed7"),
        episode_return=Said(-10.0, "the value -10", 2910, "8e778fdd22483ed7"),
        collisions_after=Said(7, "249, 435, 745, 816, 1410, 1607 and 1661", 2922, "3756bc2304f5fd74"),
        why={"steady": _EXPLORING, "return": _EXPLORING, "failures": _EXPLORING},
    ),
    Reported(
        "square-q-softmax",
        "6.4, B.2.4",
        "Square peg, Q-learning, softmax",
        {"return": "6.26, B.21", "force": "6.27, B.22", "torque": "6.28, B.23", "failures": "6.29, B.24"},
        steady_from=Said(140, "between 140 episodes transition time", 2257, "dd6388bc27987e30"),
        force_n=Said(0.3, "value 0.3 N", 2173, "3b65b5129a307d38"),
        torque_nm=Said(0.1, "average value of 1 Nm", 2180, "2a80de96eff9d105"),
        longest=Said(110, "more than 110 episodes", 2257, "dd6388bc27987e30"),
    ),
    Reported(
        "paper2-random-start",
        "conference paper 2",
        "Random starts, reward for falling force",
        {},
    ),
)
"""In the order of the thesis. Figures 6.4, 6.15, 6.20 and 6.25 are drawings of the parts."""
