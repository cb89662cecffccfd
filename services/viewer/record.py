"""Messages in, plain columns out: what is shown of a cell, without Rerun, clock or bus.

Entities: ``wrist/force`` [N], ``wrist/torque`` [N m] and ``wrist/magnitude`` [N] carry what is felt; ``decision/*``
what was decided in which state; ``progress/*`` one value an episode; ``log`` one line an episode; ``scene/*`` where
the peg is; ``agent/*`` the action values; ``about`` which run it is. Time is when a message came, in nanoseconds since
the viewer's start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from services.rules.hole import UPRIGHT, standing
from services.viewer.decimate import Floats, Nanoseconds, distinct, extremes, spread
from services.viewer.recent import History, Pace, Progress, Recent
from services.wire.errors import BadPayloadError
from services.wire.messages import (
    Action,
    EpisodeSummary,
    Experiment,
    FtPacket,
    PoseNumbers,
    QTable,
    Reward,
    State,
    Truth,
)

BUCKET_NS = 100_000_000
"""Of what is faster than this, only the extremes are shown."""

FORCE = "wrist/force"
TORQUE = "wrist/torque"
MAGNITUDE = "wrist/magnitude"
STATE = "decision/state"
ACTION = "decision/action"
REWARD = "decision/reward"
RETURN = "progress/return"
FAILURES = "progress/failures"
RUN = "progress/run"
LOG = "log"
ABOUT = "about"
PEG = "scene/peg"
FLANGE = "scene/flange"
HOLE = "scene/hole"
PUSH = "scene/flange/force"
"""The force as an arrow, in the frame that it is told in: the flange's tool frame."""
PUSH_MM_PER_N = 3.0
LONGEST_PUSH_MM = 30.0
FEELS_N = 0.05
"""A force below this is shown as none: an arrow of noise would only twitch."""


@dataclass(frozen=True)
class Series:
    """Rows of numbers, one or several columns, for one plot."""

    entity: str
    times_ns: Nanoseconds
    """Shape (n,), rising."""
    values: Floats
    """Shape (n, columns)."""
    episodes: tuple[int, ...] | None = None
    """Episode of each row, for what there is one of in an episode."""


@dataclass(frozen=True)
class Placement:
    """Where a body is: its tip in the hole frame [mm] and its orientation, a unit quaternion x, y, z, w."""

    entity: str
    time_ns: int
    translation: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]


@dataclass(frozen=True)
class Push:
    """What pushes on the peg, as an arrow from its tip; None for nothing that is worth one."""

    time_ns: int
    arrow_mm: tuple[float, float, float] | None
    label: str


@dataclass(frozen=True)
class Lines:
    """Lines of text, one an episode."""

    entity: str
    times_ns: Nanoseconds
    episodes: tuple[int, ...]
    texts: tuple[str, ...]
    levels: tuple[str, ...]


@dataclass(frozen=True)
class Table:
    """The action values at one time, one row an action, one column a state."""

    time_ns: int
    actions: tuple[str, ...]
    values: Floats
    """Shape (actions, states)."""
    visited: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]
    """Which of them were ever tried, same shape."""
    best: tuple[int, ...]
    """Best action of each state."""


@dataclass(frozen=True)
class Bars:
    """The returns of the whole run so far, as bars over the number of the episode."""

    entity: str
    time_ns: int
    firsts: Floats
    """First episode of each bar, shape (n,)."""
    values: Floats
    """Shape (n,)."""
    width: int
    """Episodes a bar."""


@dataclass(frozen=True)
class About:
    """What is seen: which run, and how far it is."""

    time_ns: int
    text: str


Item = Series | Placement | Push | Lines | Table | Bars | About


class Recorder:
    """Collects what came since the last ``flush`` and hands it out as columns."""

    def __init__(self, cell: str = "a") -> None:
        self._cell = cell
        self._experiment: Experiment | None = None
        self._done = 0
        """Episodes of the run, as far as is known."""
        self._pace = Pace()
        self.run: str | None = None
        """The run that the newest episode belongs to, or that the task said it runs."""
        self._limit_n = math.nan
        self._recent = Recent()
        self._history = History()
        self._wrench: list[tuple[float, ...]] = []
        self._states: list[int] = []
        self._actions: list[int] = []
        self._rewards: list[float] = []
        self._episodes: list[tuple[EpisodeSummary, Progress]] = []
        self._truth: Truth | None = None
        self._tilted = False
        """Whether a hole was ever shown tilted: it has to be put upright again then."""
        self._more = False
        """Whether anything came since the whole run was sent."""
        self._shown: tuple[str, int, str] | None = None
        """Which action values were sent since anything came: run, decisions, digest."""

    def experiment(self, experiment: Experiment) -> None:
        """Take what runs: the collision limit, and whose episodes to average."""
        self._limit_n = experiment.definition.limits.collision_force_n
        self._follow(experiment.run)
        self._experiment, self._done = experiment, max(self._done, experiment.episodes_done)
        self._more = True

    def ft(self, packet: FtPacket) -> None:
        """Take F/T samples. Raises BadPayloadError when there are not as many torques as forces."""
        if len(packet.force_n) != len(packet.torque_nm):
            counts = f"{len(packet.force_n)} forces and {len(packet.torque_nm)} torques"
            raise BadPayloadError(f"FtPacket: expected as many torques as forces, got {counts}")
        for force, torque in zip(packet.force_n, packet.torque_nm, strict=True):
            self._wrench.append((*force, *torque, math.hypot(*force)))

    def state(self, state: State) -> None:
        """Take a contact state."""
        self._states.append(state.state)

    def action(self, action: Action) -> None:
        """Take a decision."""
        self._actions.append(action.action)

    def reward(self, reward: Reward) -> None:
        """Take a reward."""
        self._rewards.append(reward.reward)

    def episode(self, summary: EpisodeSummary) -> None:
        """Take a finished episode; one seen before is passed over."""
        self._follow(summary.run)
        progress = self._recent.take(summary)
        if progress is not None:
            self._done = max(self._done, summary.episode + 1)
            self._episodes.append((summary, progress))
            self._history.take(summary.episode, summary.episode_return)

    def truth(self, truth: Truth) -> None:
        """Take the true pose; only the newest one is shown."""
        self._truth = truth

    def flush(self, start_ns: int, end_ns: int) -> list[Item]:
        """Return what came after ``start_ns`` and until ``end_ns``, and forget it."""
        force_n = self._wrench[-1][:3] if self._wrench else None
        items: list[Item] = [*self._wrench_items(start_ns, end_ns), *self._decision_items(start_ns, end_ns)]
        items += self._episode_items(start_ns, end_ns)
        if self._truth is not None:
            items += self._placements(self._truth, end_ns)
            if force_n is not None:
                items.append(_push(end_ns, (force_n[0], force_n[1], force_n[2])))
            self._truth = None
        if items:  # time moves on anyway; and old ones will be dropped for lack of memory
            self._more, self._shown = True, None
        return items

    def _placements(self, truth: Truth, time_ns: int) -> list[Item]:
        """Return where the bodies are, seen by a cell whose hole may be tilted."""
        experiment, stands = self._experiment, None
        if experiment is not None and experiment.run == truth.run:
            stands = standing(experiment.definition.hole, experiment.seed, truth.episode)
        self._tilted = self._tilted or stands is not None
        if not self._tilted:
            return [_placement(PEG, time_ns, truth.peg), _placement(FLANGE, time_ns, truth.flange)]
        stands = stands or UPRIGHT
        return [
            _placement(HOLE, time_ns, (0.0, 0.0, 0.0, *stands.turn)),
            _placement(PEG, time_ns, stands.in_cell(truth.peg)),
            _placement(FLANGE, time_ns, stands.in_cell(truth.flange)),
        ]

    def whole_run(self, time_ns: int) -> list[Item]:
        """Return the run so far: its name and its returns; nothing while nothing came since the last time.

        What is sent moves the time on the screens along: the plots of a cell that rests would run empty.
        """
        more, self._more = self._more, False
        if not more:
            return []
        items: list[Item] = []
        if self._experiment is not None:
            length = max(self._experiment.episodes, self._done)
            left = self._pace.left(time_ns, self._done, length)
            episode = f"episode {self._done} of {length}" + (f", {left} left" if left else "")
            items.append(About(time_ns, f"{name(self._experiment, self._cell)}\n{episode}"))
        firsts, means, width = self._history.bars()
        if len(firsts):
            items.append(Bars(RUN, time_ns, firsts, means, width))
        return items

    def table(self, answer: QTable, time_ns: int) -> Table | None:
        """Return the action values for showing; None while the agent knows no state, and while nothing changes.

        Raises BadPayloadError when there is not one row a state and one column an action.
        """
        _check_shape(answer)
        version = (answer.run, answer.decisions, answer.digest)
        if not answer.q or version == self._shown:
            return None
        self._shown = version
        return Table(
            time_ns=time_ns,
            actions=answer.actions,
            values=np.array(answer.q, dtype=np.float64).T,
            visited=np.array(answer.visits, dtype=np.int64).T > 0,
            best=answer.best_action,
        )

    # -- details -------------------------------------------------------------------------------------------------

    def _follow(self, run: str) -> None:
        if run != self.run:
            self.run = run
            self._recent = Recent()
            self._history = History()
            self._experiment, self._done = None, 0
            self._pace = Pace()

    def _wrench_items(self, start_ns: int, end_ns: int) -> list[Series]:
        if not self._wrench:
            return []
        values = np.array(self._wrench, dtype=np.float64)
        self._wrench.clear()
        buckets = max(1, round((end_ns - start_ns) / BUCKET_NS))
        times, kept = extremes(spread(start_ns, end_ns, len(values)), values, buckets)
        limit = np.full((len(kept), 1), self._limit_n)
        return [
            Series(FORCE, times, kept[:, 0:3]),
            Series(TORQUE, times, kept[:, 3:6]),
            Series(MAGNITUDE, times, np.hstack([kept[:, 6:7], limit])),
        ]

    def _decision_items(self, start_ns: int, end_ns: int) -> list[Series]:
        items = []
        for entity, numbers in ((STATE, self._states), (ACTION, self._actions)):
            if numbers:
                times = spread(start_ns, end_ns, len(numbers))
                times, kept = distinct(times, np.array(numbers, dtype=np.int64))
                items.append(Series(entity, times, kept[:, None].astype(np.float64)))
                numbers.clear()
        if self._rewards:
            rewards = np.array(self._rewards, dtype=np.float64)[:, None]
            self._rewards.clear()
            buckets = max(1, round((end_ns - start_ns) / BUCKET_NS))
            items.append(Series(REWARD, *extremes(spread(start_ns, end_ns, len(rewards)), rewards, buckets)))
        return items

    def _episode_items(self, start_ns: int, end_ns: int) -> list[Item]:
        if not self._episodes:
            return []
        done, self._episodes = self._episodes, []
        times = spread(start_ns, end_ns, len(done))
        numbers = tuple(progress.episode for _, progress in done)
        returns = np.array([(progress.episode_return, progress.mean_return) for _, progress in done])
        failures = np.array([(float(progress.failures),) for _, progress in done])
        texts = tuple(line(summary) for summary, _ in done)
        levels = tuple("INFO" if summary.outcome == "inserted" else "WARN" for summary, _ in done)
        return [
            Series(RETURN, times, returns, numbers),
            Series(FAILURES, times, failures, numbers),
            Lines(LOG, times, numbers, texts, levels),
        ]


def name(experiment: Experiment, cell: str) -> str:
    """Return what a run is called: experiment, seed, cell; and how much of the experiment, when it is not all of it."""
    whole = experiment.definition.episodes
    quick = f", quick: {experiment.episodes} of {whole} episodes" if experiment.episodes < whole else ""
    return f"{experiment.definition.name}, seed {experiment.seed}, cell {cell}{quick}"


def line(summary: EpisodeSummary) -> str:
    """Return one episode as a line of text: outcome, return, mean and peak force; its number is on a timeline."""
    return (
        f"{summary.outcome:<11}{summary.episode_return:7.1f} {summary.mean_force_n:5.2f} {summary.peak_force_n:5.2f} N"
    )


def _check_shape(answer: QTable) -> None:
    """Raise BadPayloadError for a table that is none."""
    states, actions = len(answer.q), len(answer.actions)
    widths = {len(row) for row in (*answer.q, *answer.visits)}
    if not (len(answer.visits) == len(answer.best_action) == states and widths <= {actions}):
        expected = f"{states} rows of {actions} values, {states} of visits and {states} best actions"
        raise BadPayloadError(f"QTable: expected {expected}, got other sizes")
    if any(best >= actions for best in answer.best_action):
        raise BadPayloadError(f"QTable: expected best actions below {actions}, got {max(answer.best_action)}")


def _placement(entity: str, time_ns: int, pose: PoseNumbers) -> Placement:
    x, y, z, qw, qx, qy, qz = pose
    return Placement(entity, time_ns, (x, y, z), (qx, qy, qz, qw))


def _push(time_ns: int, force_n: tuple[float, float, float]) -> Push:
    size = math.hypot(*force_n)
    if not size >= FEELS_N:
        return Push(time_ns, None, "")
    scale = min(PUSH_MM_PER_N, LONGEST_PUSH_MM / size)
    fx, fy, fz = force_n
    return Push(time_ns, (scale * fx, scale * fy, scale * fz), f"{size:.1f} N")
