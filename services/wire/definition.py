"""The experiment definition: every setting that a run's result depends on, as closed, frozen, checked types.

One TOML file holds one definition (``services/wire/definitions/*.toml``). Units are in the field names. All ranges are
closed intervals and are enforced on load; see ``definition_file.py`` for reading, overriding and hashing.

Frames: the *hole frame* has its origin in the centre of the hole's mouth and +Z pointing into the hole. The *tool
frame* sits at the centre of the peg's tip, +Z along the peg, towards insertion; the two coincide when the peg stands
straight and centred on the mouth.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from msgspec import Meta, Struct

from services.wire.message_base import LONGEST_EPISODE, LONGEST_RUN

NotNegative = Annotated[float, Meta(ge=0, le=1e6)]
Finite = Annotated[float, Meta(ge=-1e6, le=1e6)]
Fraction = Annotated[float, Meta(ge=0, le=1)]
OffsetMm = Annotated[float, Meta(ge=-20, le=20)]
AngleDeg = Annotated[float, Meta(ge=-20, le=20)]
StepSize = Annotated[float, Meta(gt=0, le=2)]
Setting = bool | int | Finite | Annotated[str, Meta(max_length=1000)]


class _Checked(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of all parts of a definition: frozen, keyword-only, unknown keys refused."""


class Parts(_Checked, frozen=True, kw_only=True):
    """Geometry of peg and hole (thesis 6.2, Fig. 6.4)."""

    shape: Literal["round", "square"] = "round"
    """Cross-section of peg and hole."""
    peg_width_mm: Annotated[float, Meta(ge=2, le=100)] = 24.8
    """Diameter of a round peg, side of a square one."""
    peg_height_mm: Annotated[float, Meta(ge=2, le=100)] = 14.7
    """Length of the part of the peg that goes into the hole."""
    clearance_mm: Annotated[float, Meta(gt=0, le=10)] = 0.5
    """Gap between peg and hole on each side when the peg stands centred (docs/decisions/0005)."""
    chamfer_mm: Annotated[float, Meta(ge=0, le=10)] = 3.0
    """Radial width of the 45 degree chamfer round the mouth; 0 for none. The thesis does not give it."""


class Contact(_Checked, frozen=True, kw_only=True):
    """Material of the contact between peg and hole."""

    friction: Annotated[float, Meta(ge=0, le=2)] = 0.3
    """Coulomb friction coefficient, static and dynamic."""
    stiffness_n_per_mm: Annotated[float, Meta(ge=0, le=10000)] = 0.0
    """How stiff the peg's surface is at each point that touches; 0 for a rigid one (docs/decisions/0007)."""


class Wrist(_Checked, frozen=True, kw_only=True):
    """Compliance between flange and peg, and where the sensor sits. Simulated force means nothing without it."""

    stiffness_n_per_mm: Annotated[float, Meta(ge=0.1, le=1000)] = 15.0
    """Translational stiffness along each axis."""
    stiffness_nm_per_rad: Annotated[float, Meta(ge=0.1, le=10000)] = 60.0
    """Rotational stiffness about each axis."""
    sensor_height_mm: Annotated[float, Meta(ge=0, le=500)] = 130.0
    """Distance from the peg's tip back to the sensor: torques refer to this point, and the wrist gives way in it."""


class Noise(_Checked, frozen=True, kw_only=True):
    """Errors of the simulated cell: zero-mean Gaussian, drawn from counter-based generators (docs/decisions/0006)."""

    scale: Annotated[float, Meta(ge=0, le=10)] = 1.0
    """Factor on all that follows; 0 switches all noise off."""
    force_n: Annotated[float, Meta(ge=0, le=10)] = 0.0
    """Standard deviation of each force component that the sensor reads."""
    torque_nm: Annotated[float, Meta(ge=0, le=10)] = 0.0
    """Standard deviation of each torque component that the sensor reads."""
    along_mm: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """Standard deviation of where the arm ends, along an axis that a motion is commanded on."""
    across_mm: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """The same along each axis that the motion is not commanded on."""
    turn_deg: Annotated[float, Meta(ge=0, le=1)] = 0.0
    """Standard deviation of the arm's rotation about each axis in a motion; not in the thesis."""


class Sensor(_Checked, frozen=True, kw_only=True):
    """How finely the force/torque sensor is read: a receiver card gives whole counts of 1/16384 of its full scale."""

    full_scale_n: Annotated[int, Meta(ge=0, le=32767)] = 0
    """Full scale of each force component [N]; 0, with the other, for readings that are not rounded."""
    full_scale_dnm: Annotated[int, Meta(ge=0, le=32767)] = 0
    """Full scale of each torque component [0.1 N m], the metric unit of a JR3 receiver."""


class Start(_Checked, frozen=True, kw_only=True):
    """Pose of the peg's tip in the hole frame when an episode begins (thesis 6.2.1, 6.4)."""

    x_mm: OffsetMm = 1.6
    """Beside the hole's axis, along X."""
    y_mm: OffsetMm = -2.2
    """Beside it along Y."""
    height_mm: Annotated[float, Meta(gt=0, le=20)] = 1.0
    """How far the centre of the tip is above the mouth (so z = -height)."""
    rx_deg: AngleDeg = 1.8
    """Tilt about X."""
    ry_deg: AngleDeg = 0.4
    """Tilt about Y."""
    rz_deg: AngleDeg = 0.0
    """Turn about the peg."""
    xy_spread_mm: Annotated[float, Meta(ge=0, le=10)] = 0.0
    """Half width of a uniform random offset added to x and to y in each episode."""
    tilt_spread_deg: Annotated[float, Meta(ge=0, le=10)] = 0.0
    """Half width of a uniform random offset added to each of the three angles in each episode."""


class Moves(_Checked, frozen=True, kw_only=True):
    """The agent's actions: one increment each, in the tool frame (thesis 6.1, 6.4)."""

    actions: Literal[5, 9, 11] = 9
    """5: +-X +-Y +Z. 9: and +-rotation about X and Y. 11: and +-rotation about Z."""
    lateral_mm: StepSize = 0.2
    """Size of a move along X or Y."""
    insertion_mm: StepSize = 0.2
    """Size of a move along +Z, the agent's and the guidance's alike."""
    rotation_deg: StepSize = 0.2
    """Size of a rotation."""


class Limits(_Checked, frozen=True, kw_only=True):
    """When contact counts, and when an episode ends."""

    contact_force_n: Annotated[float, Meta(gt=0, le=100)] = 0.3
    """At or above this force the agent decides; below it guidance steps in +Z."""
    collision_force_n: Annotated[float, Meta(gt=0, le=1000)] = 10.0
    """At or above this force the episode ends as a collision (thesis Table B.1)."""
    hard_force_n: Annotated[float, Meta(gt=0, le=10000)] = 20.0
    """Force that no move may reach: the guard beside the robot refuses what could lead above it (thesis 5.3)."""
    deepest_mm: Annotated[float, Meta(ge=0, le=1000)] = 0.0
    """How far below the mouth the guard lets +Z take the tip; 0 for the depth of success and one move more."""
    workspace_mm: Annotated[float, Meta(ge=0, le=1000)] = 0.0
    """How far from the start of an episode the guard lets the tip go; 0 for as far as ``move_limit`` moves can."""
    workspace_deg: Annotated[float, Meta(ge=0, le=180)] = 0.0
    """How far from its start the guard lets the peg be turned; 0 for as far as ``move_limit`` moves can."""
    success_fraction: Annotated[float, Meta(gt=0, le=1)] = 2 / 3
    """Part of the peg's height that must be below the mouth (conference paper 2)."""
    no_progress_moves: Annotated[int, Meta(ge=0, le=100000)] = 0
    """An episode ends after more than this many moves in a row without one in +Z; 0 switches the rule off."""
    move_limit: Annotated[int, Meta(ge=10, le=LONGEST_EPISODE)] = 1000
    """An episode ends after this many moves, whatever happened; not in the thesis, only a safety net."""
    truncation: Literal["untaught", "terminal"] = "untaught"
    """What an episode cut by ``move_limit`` teaches by its last decision: nothing, or that all ends there."""


class InsertionReward(_Checked, frozen=True, kw_only=True, tag_field="kind", tag="insertion"):
    """Reward of thesis chapter 6: what a move costs, whatever force it caused."""

    step: Finite = -1.0
    """For a move in contact other than +Z."""
    insertion_step: Finite = 0.0
    """For a move in contact in +Z."""
    collision: Finite = -100.0
    """For a move that ends in a collision (instead of the others)."""
    no_progress: Finite = -50.0
    """For the move that ends the episode by the no-progress rule (instead of the others)."""


class ForceChangeReward(_Checked, frozen=True, kw_only=True, tag_field="kind", tag="force_change"):
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


class Art2Settings(_Checked, frozen=True, kw_only=True, tag_field="kind", tag="art2"):
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


class QLearning(_Checked, frozen=True, kw_only=True, tag_field="kind", tag="q_learning"):
    """One-step Q-learning (thesis eq. 4.4)."""

    alpha: Annotated[float, Meta(gt=0, le=1)] = 0.3
    """Learning rate."""
    gamma: Fraction = 0.95
    """Discount factor."""


class Sarsa(_Checked, frozen=True, kw_only=True, tag_field="kind", tag="sarsa"):
    """One-step SARSA (thesis eq. 4.5)."""

    alpha: Annotated[float, Meta(gt=0, le=1)] = 0.3
    """Learning rate."""
    gamma: Fraction = 0.95
    """Discount factor."""


class Plugin(_Checked, frozen=True, kw_only=True, tag_field="kind", tag="plugin"):
    """A classifier or learner that an installed package registers by entry point (docs/extending.md)."""

    name: Annotated[str, Meta(pattern=r"^[a-z0-9][a-z0-9_-]{0,63}\Z")]
    """The entry point's name, in the group ``treenail.classifiers`` or ``treenail.learners``."""
    settings: Annotated[dict[str, Setting], Meta(max_length=100)] = {}
    """Whatever it is to be told; it says itself what it takes."""


class Greedy(_Checked, frozen=True, kw_only=True, tag_field="kind", tag="greedy"):
    """Always an action of the highest value; ties are drawn evenly."""


class EpsilonGreedy(_Checked, frozen=True, kw_only=True, tag_field="kind", tag="epsilon_greedy"):
    """Thesis eq. 4.1 with constant epsilon."""

    epsilon: Fraction = 0.1
    """Chance of any action, whatever its value."""


class EpsilonAnnealed(_Checked, frozen=True, kw_only=True, tag_field="kind", tag="epsilon_annealed"):
    """Thesis eqs. 4.1 and 4.2: epsilon = 1 / (mu * n + 1) in episode n."""

    mu: NotNegative = 0.01
    """How fast epsilon falls."""


class Softmax(_Checked, frozen=True, kw_only=True, tag_field="kind", tag="softmax"):
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


class Definition(_Checked, frozen=True, kw_only=True):
    """One experiment."""

    name: Annotated[str, Meta(pattern=r"^[a-z0-9][a-z0-9-]{0,63}\Z")]
    """Lower-case letters, digits and dashes."""
    title: Annotated[str, Meta(max_length=200)] = ""
    """One line for plots and lists."""
    source: Annotated[str, Meta(max_length=500)] = ""
    """Where the settings come from: thesis section, paper."""
    episodes: Annotated[int, Meta(ge=1, le=LONGEST_RUN)] = 2000
    """How long a run is unless the command line says otherwise."""
    parts: Parts = Parts()
    contact: Contact = Contact()
    wrist: Wrist = Wrist()
    noise: Noise = Noise()
    sensor: Sensor = Sensor()
    start: Start = Start()
    moves: Moves = Moves()
    limits: Limits = Limits()
    reward: Reward = InsertionReward()
    classifier: ClassifierSettings = Art2Settings()
    learner: LearnerSettings = QLearning()
    policy: Policy = Softmax()
