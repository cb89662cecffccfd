"""The experiment definition: every setting that a run's result depends on, as closed, frozen, checked types.

One TOML file holds one definition (``services/wire/definitions/*.toml``). Units are in the field names. All ranges are
closed intervals and are enforced on load; see ``definition_file.py`` for reading, overriding and hashing.

Frames: the *hole frame* has its origin in the centre of the hole's mouth and +Z pointing into the hole. The *tool
frame* sits at the centre of the peg's tip, +Z along the peg, towards insertion; the two coincide when the peg stands
straight and centred on the mouth.
"""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from services.wire.definition_base import AngleDeg, Checked, OffsetMm
from services.wire.definition_base import Finite as Finite
from services.wire.definition_base import Fraction as Fraction
from services.wire.definition_base import NotNegative as NotNegative
from services.wire.definition_base import Setting as Setting
from services.wire.definition_forces import Calibration as Calibration
from services.wire.definition_forces import Drift as Drift
from services.wire.definition_forces import Sensor as Sensor
from services.wire.definition_forces import Tool as Tool
from services.wire.definition_learning import TD_LEARNERS as TD_LEARNERS
from services.wire.definition_learning import Art2Settings as Art2Settings
from services.wire.definition_learning import ClassifierSettings as ClassifierSettings
from services.wire.definition_learning import EpsilonAnnealed as EpsilonAnnealed
from services.wire.definition_learning import EpsilonGreedy as EpsilonGreedy
from services.wire.definition_learning import Exploring as Exploring
from services.wire.definition_learning import FeltModel as FeltModel
from services.wire.definition_learning import ForceChangeReward as ForceChangeReward
from services.wire.definition_learning import Greedy as Greedy
from services.wire.definition_learning import InsertionReward as InsertionReward
from services.wire.definition_learning import LearnerSettings as LearnerSettings
from services.wire.definition_learning import Plugin as Plugin
from services.wire.definition_learning import Policy as Policy
from services.wire.definition_learning import QLearning as QLearning
from services.wire.definition_learning import Reward as Reward
from services.wire.definition_learning import Sarsa as Sarsa
from services.wire.definition_learning import Shaping as Shaping
from services.wire.definition_learning import Softmax as Softmax
from services.wire.definition_learning import TdSettings as TdSettings
from services.wire.definition_learning import Thompson as Thompson
from services.wire.definition_learning import Unclassified as Unclassified
from services.wire.definition_moves import Continuous as Continuous
from services.wire.definition_moves import Moves as Moves
from services.wire.definition_moves import NamedMove as NamedMove
from services.wire.definition_world import Change, Hole
from services.wire.message_base import LONGEST_EPISODE, LONGEST_RUN


class Parts(Checked, frozen=True, kw_only=True):
    """Geometry of peg and hole (thesis 6.2, Fig. 6.4)."""

    shape: Literal["round", "square", "rectangle", "triangle"] = "round"
    """Cross-section of peg and hole; a triangle is equilateral, one side facing +X."""
    peg_width_mm: Annotated[float, Meta(ge=2, le=100)] = 24.8
    """Diameter of a round peg, side of a square or triangular one, of a rectangular one the side along X."""
    peg_breadth_mm: Annotated[float, Meta(ge=0, le=100)] = 0.0
    """Side of a rectangular peg along Y; 0 for every other shape."""
    peg_height_mm: Annotated[float, Meta(ge=2, le=100)] = 14.7
    """Length of the part of the peg that goes into the hole."""
    clearance_mm: Annotated[float, Meta(gt=0, le=10)] = 0.5
    """Gap between peg and hole on each side when the peg stands centred (docs/decisions/0005)."""
    chamfer_mm: Annotated[float, Meta(ge=0, le=10)] = 3.0
    """Radial width of the 45 degree chamfer round the mouth; 0 for none. The thesis does not give it."""


class Contact(Checked, frozen=True, kw_only=True):
    """Material of the contact between peg and hole."""

    friction: Annotated[float, Meta(ge=0, le=2)] = 0.3
    """Coulomb friction coefficient, static and dynamic."""
    stiffness_n_per_mm: Annotated[float, Meta(ge=0, le=10000)] = 0.0
    """How stiff the peg's surface is at each point that touches; 0 for a rigid one (docs/decisions/0007)."""


class Wrist(Checked, frozen=True, kw_only=True):
    """Compliance between flange and peg, and where the sensor sits. Simulated force means nothing without it."""

    stiffness_n_per_mm: Annotated[float, Meta(ge=0.1, le=1000)] = 15.0
    """Translational stiffness along each axis."""
    stiffness_nm_per_rad: Annotated[float, Meta(ge=0.1, le=10000)] = 60.0
    """Rotational stiffness about each axis."""
    sensor_height_mm: Annotated[float, Meta(ge=0, le=500)] = 130.0
    """Distance from the peg's tip back to the sensor: torques refer to this point, and the wrist gives way in it."""
    sensor_mount: Literal["given", "unknown"] = "given"
    """How the sensor's axes stand to the tool's: by the three angles below, or turned in a way drawn for each run."""
    sensor_rx_deg: Annotated[float, Meta(ge=-180, le=180)] = 0.0
    """Turn of the sensor's axes in the tool frame, R = Rz Ry Rx: what is read is the load along the turned axes."""
    sensor_ry_deg: Annotated[float, Meta(ge=-180, le=180)] = 0.0
    """The same about Y."""
    sensor_rz_deg: Annotated[float, Meta(ge=-180, le=180)] = 0.0
    """The same about Z."""


class Noise(Checked, frozen=True, kw_only=True):
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


class Start(Checked, frozen=True, kw_only=True):
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
    x_spread_mm: Annotated[float, Meta(ge=0, le=10)] = 0.0
    """What is added to ``xy_spread_mm`` for x alone."""
    y_spread_mm: Annotated[float, Meta(ge=0, le=10)] = 0.0
    """The same for y alone."""
    rx_spread_deg: Annotated[float, Meta(ge=0, le=10)] = 0.0
    """What is added to ``tilt_spread_deg`` for the tilt about X alone."""
    ry_spread_deg: Annotated[float, Meta(ge=0, le=10)] = 0.0
    """The same about Y."""
    rz_spread_deg: Annotated[float, Meta(ge=0, le=10)] = 0.0
    """The same for the turn about the peg."""
    decimals: Annotated[int, Meta(ge=0, le=9)] = 0
    """Decimals that a start pose is rounded to once it is drawn, for a robot that is told no more; 0 for all."""

    @property
    def spreads(self) -> tuple[float, float, float, float, float]:
        """Half widths of the random offsets of x, y [mm], rx, ry and rz [deg]."""
        xy, tilt = self.xy_spread_mm, self.tilt_spread_deg
        return (
            xy + self.x_spread_mm,
            xy + self.y_spread_mm,
            tilt + self.rx_spread_deg,
            tilt + self.ry_spread_deg,
            tilt + self.rz_spread_deg,
        )


SPREADS = tuple(name for name in Start.__struct_fields__ if "_spread_" in name)
"""The keys of a start that make it a random one."""


class Limits(Checked, frozen=True, kw_only=True):
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


class Felt(Checked, frozen=True, kw_only=True):
    """Which point the torques refer to that classifier, reward and learner are given; the guard feels as it is read."""

    torque: Literal["as_read", "tip", "lever"] = "as_read"
    """"as_read": the sensor. "tip": the peg's tip, wrist.sensor_height_mm ahead. "lever": ``lever_mm`` ahead."""
    lever_mm: Annotated[float, Meta(ge=-1000, le=1000)] = 0.0
    """How far the point is ahead of the sensor, towards the tip; with torque = "lever" only."""


class Definition(Checked, frozen=True, kw_only=True):
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
    tool: Tool = Tool()
    drift: Drift = Drift()
    calibration: Calibration = Calibration()
    start: Start = Start()
    moves: Moves = Moves()
    limits: Limits = Limits()
    felt: Felt = Felt()
    reward: Reward = InsertionReward()
    shaping: Shaping = Shaping()
    classifier: ClassifierSettings = Art2Settings()
    learner: LearnerSettings = QLearning()
    policy: Policy = Softmax()
    hole: Hole = Hole()
    changes: Annotated[tuple[Change, ...], Meta(max_length=8)] = ()
    """What of the parts is another from some episode on (a worn tool), in the order of the episodes."""
