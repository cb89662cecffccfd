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
    back: Finite = -3.0
    """For a move back out (a listed one, z_mm below 0), less what force costs; it is not shaped."""
    success: Finite = 0.0
    """Added for the move that ends the episode inserted."""
    force_per_n: NotNegative = 0.0
    """What each newton felt after a move costs where the episode goes on: an aim, where ``shaping`` is a help."""


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
    back: Finite = -3.0
    """For a move back out (a listed one, z_mm below 0), less what force costs; it is not shaped."""
    success: Finite = 0.0
    """Added for the move that ends the episode inserted."""


class Shaping(Checked, frozen=True, kw_only=True):
    """The price of force: a potential, added to the reward of each decision, that leaves the best policy what it is.

    r + price_per_n (Phi(s) - gamma Phi(s')) with Phi = |F| + torque_per_m |T| of what is felt at a decision and at the
    next, and Phi = 0 where the episode ends (Ng, Harada and Russell 1999).
    """

    price_per_n: Annotated[float, Meta(ge=0, le=1000)] = 0.0
    """What a newton costs; 0 switches it off."""
    torque_per_m: Annotated[float, Meta(ge=0, le=1000)] = 20.0
    """How many newtons a newton metre counts as, its torque referred as ``felt`` says."""
    gamma: Fraction = 0.95
    """Discount factor; with another than the learner's the best policy would be another."""


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


class Unclassified(Checked, frozen=True, kw_only=True, tag_field="kind", tag="none"):
    """No contact states: whatever is felt is of the one class 0, for a learner that goes by force and torque alone."""


class QLearning(Checked, frozen=True, kw_only=True, tag_field="kind", tag="q_learning"):
    """Q-learning (thesis eq. 4.4), one-step unless ``trace`` says otherwise."""

    alpha: Annotated[float, Meta(gt=0, le=1)] = 0.3
    """Learning rate."""
    gamma: Fraction = 0.95
    """Discount factor."""
    trace: Fraction = 0.0
    """How much of a lesson earlier decisions share in: lambda of Watkins's Q(lambda); 0 for one step."""


class Sarsa(Checked, frozen=True, kw_only=True, tag_field="kind", tag="sarsa"):
    """SARSA (thesis eq. 4.5), one-step unless ``trace`` says otherwise."""

    alpha: Annotated[float, Meta(gt=0, le=1)] = 0.3
    """Learning rate."""
    gamma: Fraction = 0.95
    """Discount factor."""
    trace: Fraction = 0.0
    """How much of a lesson earlier decisions share in: lambda of SARSA(lambda); 0 for one step."""


class FeltModel(Checked, frozen=True, kw_only=True, tag_field="kind", tag="felt"):
    """A model of what a move earns at once, from what is felt, beside a table of what follows (docs/learning.md)."""

    gamma: Fraction = 1.0
    """Discount factor of the task."""
    follow: Fraction = 0.9
    """Part of what is thought to follow that the table counts on: less than all, since it is a guess of a guess."""
    follow_fade: NotNegative = 0.0
    """How fast that part fades while all goes well: after n insertions in a row it is follow * (follow_least + (1 -
    follow_least) * exp(-follow_fade * n)); an episode without insertion brings all of it back."""
    follow_least: Fraction = 0.0
    """What of it never fades."""
    revisit: Annotated[float, Meta(ge=0, le=1000)] = 0.0
    """How much less a move is taken to be worth for each earlier visit, in the same episode, of the place that it leads
    to: by dead reckoning over the learner's own moves. 0 for none."""
    alpha: Annotated[float, Meta(gt=0, le=1)] = 0.3
    """Greatest learning rate of the table: of the n-th update of a value it is 1/n, between the two."""
    alpha_least: Annotated[float, Meta(gt=0, le=1)] = 0.1
    """Least learning rate of the table."""
    torque_per_m: Annotated[float, Meta(ge=0, le=1000)] = 20.0
    """How many newtons a newton metre counts as in the model, its torque referred as ``felt`` says."""
    unit_n: Annotated[float, Meta(gt=0, le=1000)] = 3.0
    """Scale of the model's features: about the force at which things change."""
    ridge: Annotated[float, Meta(gt=0, le=1e6)] = 1.0
    """How strongly the model holds that nothing earns anything before it has seen otherwise."""
    force_stays: bool = False
    """Whether a move that nothing is known of is thought to leave the force as it is, at what it costs by the reward's
    ``force_per_n``, and not to earn nothing; the model then learns what moves change."""
    caution: NotNegative = 0.0
    """How many standard deviations of what the model thinks of a move are taken off its value first, where the policy
    does not draw it: what is never tried has to be sure."""
    drift: Fraction = 0.0
    """How unsure the model becomes of what it holds with each observation, as a part of how unsure it was at first:
    what is long ago counts less. 0 holds that nothing ever changes."""
    reward_limit: Annotated[float, Meta(gt=0, le=1e6)] = 150.0
    """Most, up or down, that one reward tells the model; of a collision's the table is told the rest."""
    value_limit: Annotated[float, Meta(gt=0, le=1e6)] = 20.0
    """Most, up or down, that what comes next is taken to be worth."""
    search_moves: Annotated[int, Meta(ge=0, le=50)] = 0
    """How many lateral moves around the start of an episode a search over a flat face reaches; 0 for no search."""
    search_cone: Annotated[float, Meta(ge=0, le=10)] = 0.35
    """Lateral force, as a part of the axial one, up to which it may be friction alone: there the search moves aside."""
    search_press_n: Annotated[float, Meta(ge=0, le=100)] = 1.0
    """Pressed less than this, the search steps in the direction of insertion first."""
    search_turn: Annotated[float, Meta(ge=-1e6, le=1e6)] = 1.0
    """A turn that is thought to be worth at least this goes before the search."""


class Plugin(Checked, frozen=True, kw_only=True, tag_field="kind", tag="plugin"):
    """A classifier or learner that an installed package registers by entry point (docs/extending.md)."""

    name: Annotated[str, Meta(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}\Z")]
    """The entry point's name, in the group ``treenail.classifiers`` or ``treenail.learners``."""
    settings: Annotated[dict[str, Setting], Meta(max_length=100)] = field(default_factory=dict)
    """Whatever it is to be told; it says itself what it takes."""


class Greedy(Checked, frozen=True, kw_only=True, tag_field="kind", tag="greedy"):
    """Always an action of the highest value; ties are drawn evenly."""


class Exploring(Checked, frozen=True, kw_only=True):
    """What every policy that tries moves out may do besides: go on with what it tried."""

    repeat: Fraction = 0.0
    """Chance in the first episode that a move without insertion is simply made again, whatever the policy says."""
    repeat_fade: NotNegative = 0.02
    """How fast that fades: in episode n the chance is repeat * exp(-repeat_fade * n)."""


class EpsilonGreedy(Exploring, frozen=True, kw_only=True, tag_field="kind", tag="epsilon_greedy"):
    """Thesis eq. 4.1 with constant epsilon."""

    epsilon: Fraction = 0.1
    """Chance of any action, whatever its value."""


class EpsilonAnnealed(Exploring, frozen=True, kw_only=True, tag_field="kind", tag="epsilon_annealed"):
    """Thesis eqs. 4.1 and 4.2: epsilon = 1 / (mu * n + 1) in episode n."""

    mu: NotNegative = 0.01
    """How fast epsilon falls."""


class Softmax(Exploring, frozen=True, kw_only=True, tag_field="kind", tag="softmax"):
    """Gibbs distribution (thesis eq. 4.3) with beta = beta + beta_per_episode * n in episode n."""

    beta: NotNegative = 4.0
    """How much values count in the first episode."""
    beta_per_episode: NotNegative = 0.3
    """How much more they count in each episode after."""


class Thompson(Exploring, frozen=True, kw_only=True, tag_field="kind", tag="thompson"):
    """Draws each move's value from what is known of it, and takes the best; needs a learner of kind "felt"."""

    width: NotNegative = 0.9
    """Standard deviations that are drawn with, in the first episode."""
    width_fade: NotNegative = 0.03
    """How fast they fall: in episode n it is width * exp(-width_fade * n)."""


Reward = InsertionReward | ForceChangeReward
ClassifierSettings = Art2Settings | Unclassified | Plugin
TdSettings = QLearning | Sarsa
LearnerSettings = TdSettings | FeltModel | Plugin
TD_LEARNERS: Mapping[str, type[TdSettings]] = {"q_learning": QLearning, "sarsa": Sarsa}
"""By their kind in a definition."""
Policy = Greedy | EpsilonGreedy | EpsilonAnnealed | Softmax | Thompson
