"""What of a definition says how is learnt: reward, classifier, learner, policy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from msgspec import Meta, field

from services.wire.definition_base import Checked, Finite, Fraction, NotNegative, Setting


class InsertionReward(Checked, frozen=True, kw_only=True, tag_field="kind", tag="insertion"):
    """Reward of thesis chapter 6: what a move costs, whatever force it caused."""

    step: Finite = -1.0
    """For a move in contact other than +Z."""
    insertion_step: Finite = 0.0
    """For a move in contact in +Z."""
    collision: Finite = -100.0
    """For a move that ends in a collision (instead of the others)."""
    no_progress: Finite = -50.0
    """For the move that ends the episode by the no-progress rule (instead of the others)."""


class ForceChangeReward(Checked, frozen=True, kw_only=True, tag_field="kind", tag="force_change"):
    """Reward of conference paper 2: by how the force changed over a move."""

    fell: Finite = 5.0
    """When the force fell by at least ``fell_by``."""
    fell_by: Fraction = 0.5
    """Part of the force before."""
    rose: Finite = -5.0
    """When the force rose by at least ``rose_by``."""
    rose_by: Annotated[float, Meta(ge=0, le=100)] = 0.2
    """Part of the force before."""
    otherwise: Finite = -1.0
    """When it did neither."""
    collision: Finite = -200.0
    """For a move that ends in a collision (instead of the others)."""
    no_progress: Finite = -50.0
    """For the move that ends the episode by the no-progress rule (instead of the others)."""


class Art2Settings(Checked, frozen=True, kw_only=True, tag_field="kind", tag="art2"):
    """ART2 classifier (thesis Appendix D; parameter names are the thesis's)."""

    rho: Annotated[float, Meta(gt=0, lt=1)] = 0.92
    """Vigilance: a class whose match is below it is reset."""
    theta: Annotated[float, Meta(ge=0, lt=1)] = 0.05
    """Threshold of the signal function f."""
    a: Annotated[float, Meta(gt=0, le=100)] = 10.0
    """Feedback from u to w."""
    b: Annotated[float, Meta(gt=0, le=100)] = 10.0
    """Feedback from q to v."""
    c: Annotated[float, Meta(gt=0, lt=1)] = 0.1
    """Weight of p in the match."""
    d: Annotated[float, Meta(gt=0, lt=1)] = 0.9
    """Activity of the winning class; weights reach u/(1-d)."""
    e: Annotated[float, Meta(ge=0, le=0.1)] = 0.0
    """Keeps norms from 0."""
    learning_rate: Annotated[float, Meta(gt=0, le=1)] = 0.1
    """Part of the way from the old weights to the equilibrium u/(1-d) that a presentation goes; 1 is fast learning."""
    encoding: Literal["odd", "split"] = "odd"
    """How signed inputs reach f: "odd" makes f odd-symmetric (6 inputs), "split" gives each sign an input (12)."""
    torque_gain_per_m: Annotated[float, Meta(ge=0, le=1000)] = 10.0
    """Factor from N m to input units, forces being in N; 10 is the unit of the JR3's metric torque."""
    capacity: Annotated[int, Meta(ge=1, le=10000)] = 200
    """Most classes there can be."""
    when_full: Literal["nearest", "refuse"] = "nearest"
    """What an input that fits no class gets when all are taken: the best matching class, unlearnt, or an error."""


class QLearning(Checked, frozen=True, kw_only=True, tag_field="kind", tag="q_learning"):
    """One-step Q-learning (thesis eq. 4.4)."""

    alpha: Annotated[float, Meta(gt=0, le=1)] = 0.3
    """Learning rate."""
    gamma: Fraction = 0.95
    """Discount factor."""


class Sarsa(Checked, frozen=True, kw_only=True, tag_field="kind", tag="sarsa"):
    """One-step SARSA (thesis eq. 4.5)."""

    alpha: Annotated[float, Meta(gt=0, le=1)] = 0.3
    """Learning rate."""
    gamma: Fraction = 0.95
    """Discount factor."""


class Plugin(Checked, frozen=True, kw_only=True, tag_field="kind", tag="plugin"):
    """A classifier or learner that an installed package registers by entry point (docs/extending.md)."""

    name: Annotated[str, Meta(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}\Z")]
    """The entry point's name, in the group ``treenail.classifiers`` or ``treenail.learners``."""
    settings: Annotated[dict[str, Setting], Meta(max_length=100)] = field(default_factory=dict)
    """Whatever it is to be told; it says itself what it takes."""


class Greedy(Checked, frozen=True, kw_only=True, tag_field="kind", tag="greedy"):
    """Always an action of the highest value; ties are drawn evenly."""


class EpsilonGreedy(Checked, frozen=True, kw_only=True, tag_field="kind", tag="epsilon_greedy"):
    """Thesis eq. 4.1 with constant epsilon."""

    epsilon: Fraction = 0.1
    """Chance of any action, whatever its value."""


class EpsilonAnnealed(Checked, frozen=True, kw_only=True, tag_field="kind", tag="epsilon_annealed"):
    """Thesis eqs. 4.1 and 4.2: epsilon = 1 / (mu * n + 1) in episode n."""

    mu: NotNegative = 0.01
    """How fast epsilon falls."""


class Softmax(Checked, frozen=True, kw_only=True, tag_field="kind", tag="softmax"):
    """Gibbs distribution (thesis eq. 4.3) with beta = beta + beta_per_episode * n in episode n."""

    beta: NotNegative = 4.0
    """How much values count in the first episode."""
    beta_per_episode: NotNegative = 0.3
    """How much more they count in each episode after."""


Reward = InsertionReward | ForceChangeReward
ClassifierSettings = Art2Settings | Plugin
TdSettings = QLearning | Sarsa
LearnerSettings = TdSettings | Plugin
TD_LEARNERS: Mapping[str, type[TdSettings]] = {"q_learning": QLearning, "sarsa": Sarsa}
"""By their kind in a definition."""
Policy = Greedy | EpsilonGreedy | EpsilonAnnealed | Softmax
