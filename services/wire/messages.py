"""The messages: closed, frozen, versioned types with units in the field names. docs/contract.md is generated from here.

Frames: forces and torques are those acting on the peg, in the tool frame (origin at the tip, +Z in the direction of
insertion); torques refer to the sensor's point, ``wrist.sensor_height_mm`` behind the tip. Increments are in the tool
frame, translation first; rotations turn about axes through the tip. Times are nanoseconds of the publisher's clock;
the simulator's clock is simulated and a function of episode and step alone.

Every loop message carries ``run``, ``episode``, ``step`` (motions made in this episode before it) and ``decision``
(decisions taken in this run before it): the last is without gaps, so that a worker sees at once what it missed.
"""

from __future__ import annotations

from typing import Annotated, ClassVar

from msgspec import Meta, Struct

from services.wire.agent_messages import PolicyAnswer as PolicyAnswer
from services.wire.agent_messages import QTable as QTable
from services.wire.definition import Definition
from services.wire.message_base import MOST_SWAPS
from services.wire.message_base import Count as Count
from services.wire.message_base import Decision as Decision
from services.wire.message_base import Degree as Degree
from services.wire.message_base import Episode as Episode
from services.wire.message_base import Episodes as Episodes
from services.wire.message_base import Force as Force
from services.wire.message_base import Message as Message
from services.wire.message_base import Millimetre as Millimetre
from services.wire.message_base import Motion as Motion
from services.wire.message_base import Nanoseconds as Nanoseconds
from services.wire.message_base import Newton as Newton
from services.wire.message_base import NewtonMetre as NewtonMetre
from services.wire.message_base import Number as Number
from services.wire.message_base import Outcome as Outcome
from services.wire.message_base import Reason as Reason
from services.wire.message_base import RunId as RunId
from services.wire.message_base import Seed as Seed
from services.wire.message_base import ServiceName as ServiceName
from services.wire.message_base import Sha256 as Sha256
from services.wire.message_base import StateNumber as StateNumber
from services.wire.message_base import States as States
from services.wire.message_base import Step as Step
from services.wire.message_base import SwapCount as SwapCount
from services.wire.message_base import Torque as Torque
from services.wire.robot_messages import Home as Home
from services.wire.robot_messages import Move as Move
from services.wire.robot_messages import Moved as Moved
from services.wire.robot_messages import Resume as Resume
from services.wire.robot_messages import Stop as Stop
from services.wire.sensor_messages import FtPacket as FtPacket
from services.wire.sensor_messages import Zero as Zero
from services.wire.swap_messages import Swap as Swap
from services.wire.swap_messages import Swapped as Swapped
from services.wire.swap_messages import SwapRequest as SwapRequest
from services.wire.swap_messages import Swaps as Swaps


class LoopMessage(Message, frozen=True, kw_only=True):
    """What every message of the loop carries."""

    VERSION: ClassVar[int] = 2

    run: RunId
    episode: Episode
    step: Step
    decision: Decision
    swaps: SwapCount = 0
    """Swaps in force in this episode: a worker that knows of fewer sees at once that it missed one."""


PoseNumbers = tuple[Number, Number, Number, Number, Number, Number, Number]


class Truth(Message, frozen=True, kw_only=True):
    """Where the simulated peg really is: for viewers and evaluation only, the learner never sees it.

    Poses of the tip in the hole frame: x, y, z [mm] and the quaternion w, x, y, z.
    """

    run: RunId
    episode: Episode
    step: Step
    flange: PoseNumbers
    peg: PoseNumbers
    contact: Annotated[str, Meta(max_length=200)]
    """True contact state; empty for none."""


class Refusal(Message, frozen=True, kw_only=True):
    """Error reply to any query: a stable reason for programs, a sentence for people."""

    VERSION: ClassVar[int] = 2

    reason: Reason
    message: Annotated[str, Meta(max_length=1000)]


class Complete(Message, frozen=True, kw_only=True):
    """Error reply of the store to a question with ``?complete``, after all values: so many there were.

    Without it, a store that is not there could not be told from one that has nothing, nor a part from all. It is an
    error reply because Zenoh takes good ones for keys only that were asked for.
    """

    values: Count


class Observation(LoopMessage, frozen=True, kw_only=True):
    """One F/T sample, felt in contact, to be classified."""

    VERSION: ClassVar[int] = 3

    force_n: Force
    torque_nm: Torque
    previous_action: Annotated[int, Meta(ge=0, le=63)] | None = None
    """What the decision before it in this episode was; None at the episode's first."""


class State(LoopMessage, frozen=True, kw_only=True):
    """The contact state of an observation."""

    VERSION: ClassVar[int] = 3

    state: StateNumber
    states: States
    """Number of classes after this observation."""
    match: Annotated[float, Meta(ge=-1, le=1.000001)]
    force_n: Force | None = None
    """The sample that was classified, as it was observed; None where it is not known."""
    torque_nm: Torque | None = None


class Action(LoopMessage, frozen=True, kw_only=True):
    """The agent's decision; ``action`` indexes the experiment's action set, ``state`` is the state it was taken in."""

    VERSION: ClassVar[int] = 3

    state: StateNumber
    action: Annotated[int, Meta(ge=0, le=63)]
    policy_version: Count
    """Number of decisions behind this one that were learnt from, or that a swap or the move limit made worthless."""
    increment: Motion | None = None
    """The move itself, within ``moves.continuous``, where it is no listed one; ``action`` is then what it counts as."""


class Reward(LoopMessage, frozen=True, kw_only=True):
    """Reward of the decision of the same step; ``terminal`` is set when the episode ended before another decision."""

    reward: Number
    terminal: Outcome | None


class EpisodeSummary(Message, frozen=True, kw_only=True):
    """One finished episode. Force and torque are means and peaks of the magnitudes after each motion."""

    run: RunId
    episode: Episode
    episode_return: Number
    moves: Step
    decisions: Decision
    mean_force_n: Annotated[float, Meta(ge=0, le=1e6)]
    peak_force_n: Annotated[float, Meta(ge=0, le=1e6)]
    mean_torque_nm: Annotated[float, Meta(ge=0, le=1e6)]
    peak_torque_nm: Annotated[float, Meta(ge=0, le=1e6)]
    states: States
    """Contact states known when the episode ended, as far as the task has seen them."""
    outcome: Outcome


class Experiment(Message, frozen=True, kw_only=True):
    """Reply to ``experiment``: what runs, and how far it is."""

    VERSION: ClassVar[int] = 9
    LARGEST_BYTES: ClassVar[int] = 1 << 20

    run: RunId
    seed: Seed
    definition: Definition
    definition_sha256: Sha256
    skill_sha256: Sha256 | None
    """The skill that the workers started from; None for a run that began with nothing learnt."""
    first_policy_version: Count
    """Learning updates in that skill: the policy version that the run began with."""
    episodes: Episodes
    """Length of the run."""
    episodes_done: Episodes
    decisions: Decision
    phase: Annotated[str, Meta(max_length=200)]
    """"running", "finished" or "waiting for ..."."""
    swaps: Annotated[tuple[Swap, ...], Meta(max_length=MOST_SWAPS)] = ()
    """Those in force and those set for episodes to come; the definition is the one that the run began with."""


class ClassifierStates(Message, frozen=True, kw_only=True):
    """Reply to ``classifier/states``: prototypes in the classifier's input encoding, presentations per class."""

    LARGEST_BYTES: ClassVar[int] = 1 << 22

    run: RunId
    decisions: Decision
    states: States
    encoding: str
    prototypes: tuple[tuple[Number, ...], ...]
    counts: tuple[Count, ...]
    digest: Sha256


class Classified(Message, frozen=True, kw_only=True):
    """Reply to ``classifier/classify``: the contact state of one F/T vector; nothing is learnt from it."""

    run: RunId
    decisions: Decision
    states: States
    state: StateNumber | None
    """None when it fits no state known so far."""
    match: Annotated[float, Meta(ge=-1, le=1.000001)]


class RunRecord(Message, frozen=True, kw_only=True):
    """``journal/<run>/run``: what the run is; its presence proves that the store knows the run."""

    VERSION: ClassVar[int] = 8
    LARGEST_BYTES: ClassVar[int] = 1 << 20

    run: RunId
    seed: Seed
    definition: Definition
    definition_sha256: Sha256
    skill_sha256: Sha256 | None
    contract_sha256: Sha256


class JournalStep(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One decision in the journal; the last of an unfinished episode may lack action and reward."""

    step: Step
    force_n: Force
    torque_nm: Torque
    state: StateNumber | None = None
    action: Annotated[int, Meta(ge=0, le=63)] | None = None
    policy_version: Count | None = None
    reward: Number | None = None
    increment: Motion | None = None
    """The move, where it is no listed one."""


class JournalEpisode(Message, frozen=True, kw_only=True):
    """``journal/<run>/<block>/<episode>`` and ``task/steps``: all decisions of one episode, in order."""

    VERSION: ClassVar[int] = 4
    LARGEST_BYTES: ClassVar[int] = 1 << 24

    run: RunId
    episode: Episode
    first_decision: Decision
    steps: tuple[JournalStep, ...]
    summary: EpisodeSummary | None
    """None while the episode is under way."""
    swaps: SwapCount = 0
    """Swaps in force in this episode."""
    zeros: Annotated[tuple[Zero, ...], Meta(max_length=1000)] = ()
    """What was taken from the samples, where the definition asks for a tare."""


class Checkpoint(Message, frozen=True, kw_only=True):
    """``checkpoint/<run>/<service>/<episode>``: a worker's memory after all episodes before ``episode``."""

    LARGEST_BYTES: ClassVar[int] = 1 << 24

    run: RunId
    service: ServiceName
    episode: Episode
    decisions: Decision
    contract_sha256: Sha256
    snapshot: dict[str, bytes | int]


class Skill(Message, frozen=True, kw_only=True):
    """``checkpoint/skill/<sha256>``, and an exported file: all that was learnt in a run, for another run to begin with.

    It is named by the SHA-256 of its encoded bytes.
    """

    VERSION: ClassVar[int] = 8
    LARGEST_BYTES: ClassVar[int] = 1 << 24

    run: RunId
    """Where it was learnt."""
    seed: Seed
    definition: Definition
    definition_sha256: Sha256
    contract_sha256: Sha256
    skill_sha256: Sha256 | None
    """What that run itself had begun with."""
    actions: tuple[str, ...]
    episodes: Count
    """Episodes that it was learnt in, those of ``skill_sha256`` included."""
    agent: dict[str, bytes | int]
    """Memory of the learner."""
    classifier: dict[str, bytes | int]
    """Memory of the classifier."""
    swaps: Annotated[tuple[Swap, ...], Meta(max_length=MOST_SWAPS)] = ()
    """Those that were in force when it was taken: with them the definition says what learnt it."""


class Alive(Message, frozen=True, kw_only=True):
    """Reply to ``alive/<service>``, and published as heartbeat by the work loop: who is here and how it goes."""

    service: ServiceName
    instance: Annotated[str, Meta(max_length=64)]
    host: Annotated[str, Meta(max_length=255)]
    pid: Count
    version: Annotated[str, Meta(max_length=64)]
    contract_sha256: Sha256
    started_t_ns: Nanoseconds
    beat: Count
    """Heartbeats so far; one that stands still with its liveliness token present is a hung process."""
    handled: Count
    """Messages handled."""
    refused: dict[str, Count]
    """Messages refused, by error name."""
    run: RunId | None
    phase: Annotated[str, Meta(max_length=200)]


MESSAGES: tuple[type[Message], ...] = (
    FtPacket,
    Home,
    Move,
    Moved,
    Resume,
    Stop,
    Truth,
    Refusal,
    Complete,
    Observation,
    State,
    Action,
    Reward,
    EpisodeSummary,
    SwapRequest,
    Swapped,
    Swaps,
    Experiment,
    QTable,
    PolicyAnswer,
    ClassifierStates,
    Classified,
    RunRecord,
    JournalEpisode,
    Checkpoint,
    Skill,
    Alive,
)
