"""Classifiers and learners of other packages: what they have to be, and how they are found.

A learner is of one of three kinds, told by its methods: a ``Learner`` is given the class of what is felt, a
``FeelingLearner`` force and torque beside it; both answer the number of a move. A ``ContinuousLearner`` answers a move.

A package registers a class under the entry point group ``treenail.classifiers`` or ``treenail.learners``; a definition
names it with ``kind = "plugin"``. Only what is installed can be named: nothing is ever loaded from a message.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, NamedTuple, Protocol, TypeGuard, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

from services.rules.bounds import Bounds
from services.rules.wrench import Wrench
from services.wire.actions import Increment
from services.wire.definition import Definition, Plugin, Setting
from services.wire.errors import TreenailError
from services.wire.messages import Outcome
from services.wire.text import in_words

if TYPE_CHECKING:
    from typing_extensions import TypeIs

CLASSIFIERS, LEARNERS = "treenail.classifiers", "treenail.learners"
"""Groups of entry points."""

T = TypeVar("T")


class PluginError(TreenailError):
    """A plug-in that is not installed, cannot be loaded, or refuses its settings."""


class ClassifierFullError(Exception):
    """An input fits no class, and no other can be made. Nothing was learnt."""


class Classification(NamedTuple):
    """Answer to one presentation."""

    state: int
    """Number of the class, from 0 in order of birth; -1 if ``classify`` found none that fits."""
    states: int
    """Number of classes after this presentation."""
    match: float
    """How well it fits the class answered, in [0, 1]; where none fits, the best one, or 0 if there is no class."""
    new: bool
    """Whether this presentation made the class."""


class Classifier(Protocol):
    """What turns F/T vectors into contact states. Called with its settings, for example ``FuzzyArt({"rho": 0.9})``.

    Its answers depend on its settings and the vectors learnt so far and on nothing else: no clock, no dice, no file.
    Settings that it does not like are a ValueError, which must say what was expected and what came.
    """

    @property
    def states(self) -> int:
        """Number of classes."""

    @property
    def encoding(self) -> str:
        """Name of the inputs that the prototypes stand in."""

    @property
    def prototypes(self) -> NDArray[np.float64]:
        """One row a class, shape (states, inputs)."""

    @property
    def counts(self) -> NDArray[np.int64]:
        """Presentations that each class has learnt, shape (states,)."""

    def learn(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> Classification:
        """Classify one vector (three components each, [N] and [N m]) and learn it; make a class if none fits.

        ValueError for a vector that it cannot take; ClassifierFullError when no class can be made.
        """

    def classify(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> Classification:
        """Classify one vector and change nothing. ValueError as ``learn``."""

    def snapshot(self) -> dict[str, bytes | int]:
        """Return all that was learnt, the number of classes as ``states`` among it."""

    def restore(self, snapshot: Mapping[str, bytes | int]) -> None:
        """Take over a snapshot, to the last bit. ValueError, with nothing changed, when it does not fit."""

    def digest(self) -> str:
        """Return a SHA-256 in hex: equal for equal memories."""


class EpisodicClassifier(Classifier, Protocol):
    """A classifier whose states may know more than one vector: it hears where in an episode it is.

    What it keeps of an episode is forgotten when the next begins, and need not be in ``snapshot``.
    """

    def begin(self) -> None:
        """Hear that the vector that is learnt next is an episode's first."""

    def took(self, action: int) -> None:
        """Hear which action was decided on since the last vector, before the one that came of it is learnt."""


class Memory(Protocol):
    """What every learner has: what it learnt is a function of the updates alone."""

    episodes_before: int
    """Episodes that it was learnt in before this run; whoever begins with a skill sets it."""

    @property
    def states(self) -> int:
        """Rows of the table: 1 + the highest state updated so far; 0 of who keeps nothing by states."""

    @property
    def version(self) -> int:
        """Number of updates so far."""

    def snapshot(self) -> dict[str, bytes | int]:
        """Return all that was learnt, ``states`` and ``version`` among it."""

    def restore(self, snapshot: Mapping[str, bytes | int]) -> None:
        """Take over a snapshot, to the last bit. ValueError, with nothing changed, when it does not fit."""

    def digest(self) -> str:
        """Return a SHA-256 in hex: equal for equal memories."""


class Learner(Memory, Protocol):
    """What learns actions. Called as ``Learner(actions, settings, policy, seed)``, ``settings`` being a mapping.

    Its table is a function of the updates alone, and an action of (table, seed, episode, step). The easiest way to one
    is a subclass of ``services.agent.learning.Learner``.
    """

    @property
    def actions(self) -> int:
        """Number of actions."""

    @property
    def q(self) -> NDArray[np.float64]:
        """Action values, shape (states, actions)."""

    @property
    def visits(self) -> NDArray[np.int64]:
        """Number of updates of each value, shape (states, actions)."""

    def values(self, state: int) -> NDArray[np.float64]:
        """Return the values of a state, shape (actions,). ValueError when it is out of range."""

    def chances(self, state: int, episode: int) -> NDArray[np.float64]:
        """Return the probability of each action in a state, shape (actions,). ValueError when out of range."""

    def best_action(self, state: int) -> int:
        """Return an action of the highest value."""

    def decide(self, previous: tuple[int, int, float] | None, state: int, episode: int, step: int) -> int:
        """Learn from ``previous`` (state, action, reward), which led to ``state``, and return the action to take there.

        ``previous`` is None at an episode's first decision. ValueError, with nothing changed, for numbers out of range.
        """

    def finish(self, previous: tuple[int, int, float]) -> None:
        """Learn from the last (state, action, reward) of an episode, unless ``limits.truncation`` leaves it out."""


class Lesson(NamedTuple):
    """What a decision led to, for a learner that feels."""

    state: int
    action: int
    reward: float
    felt: Wrench
    """What was felt when it was decided."""
    outcome: Outcome | None = None
    """How the episode ended with it; None when another decision followed."""
    increment: Increment | None = None
    """The move, of a learner that proposes moves; ``action`` is then what it counted as."""


class FeelingLearner(Learner, Protocol):
    """A learner that is given what is felt beside its class; for one that has these methods the others are not called.

    ``decide`` and ``finish`` are then ``decide_felt`` and ``finish_felt``; ``values``, ``chances`` and ``best_action``
    answer for a state alone, the three here for a state and what is felt in it.
    """

    def decide_felt(self, previous: Lesson | None, state: int, felt: Wrench, episode: int, step: int) -> int:
        """Learn from ``previous``, which led to here, and return the action to take. ValueError as ``decide``."""

    def finish_felt(self, previous: Lesson) -> None:
        """Learn from the last decision of an episode, unless ``limits.truncation`` leaves it out."""

    def opinion(self, state: int, felt: Wrench, episode: int) -> Opinion:
        """Return what is thought of each action; changes nothing. ValueError for numbers out of range."""


class Opinion(NamedTuple):
    """What a learner that feels thinks of each action in one state at one wrench; rows of shape (actions,)."""

    values: NDArray[np.float64]
    """Their sum: of the model's part and the table's."""
    model: NDArray[np.float64]
    """What the move is thought to earn at once."""
    table: NDArray[np.float64]
    """What is thought to come after it."""
    deviation: NDArray[np.float64]
    """Standard deviation of the model's part."""
    chances: NDArray[np.float64]
    """Probability that the policy takes it."""


class ContinuousLearner(Memory, Protocol):
    """What learns moves within bounds. Called as ``ContinuousLearner(bounds, settings, seed)``.

    A proposal is made as it is but for its last decimals, which are rounded towards 0 (``services.rules.bounds``); one
    out of bounds stops the run. ``Bounds.within`` makes a proposal that is in bounds. The definition's policy is not
    heeded: how it tries moves is its own.
    """

    def decide_move(self, previous: Lesson | None, state: int, felt: Wrench, episode: int, step: int) -> Increment:
        """Learn from ``previous``, which led to here, and return the move to make. ValueError as ``Learner.decide``."""

    def finish_move(self, previous: Lesson) -> None:
        """Learn from the last decision of an episode, unless ``limits.truncation`` leaves it out."""

    def proposal(self, state: int, felt: Wrench, episode: int) -> Proposal:
        """Return what would be done without trying; changes nothing. ValueError for numbers out of range."""


class Proposal(NamedTuple):
    """What a learner of moves thinks in one state at one wrench."""

    increment: Increment
    """The move that it would make without trying; within bounds."""
    spread: Increment
    """Standard deviation that it tries moves with, axis by axis."""
    worth: float
    """What it thinks that the move earns, in its own measure."""


def proposes(learner: Learner | ContinuousLearner) -> TypeIs[ContinuousLearner]:
    """Return whether a learner answers moves, not their numbers."""
    return _proposes(type(learner))


def feels(learner: Learner) -> TypeGuard[FeelingLearner]:
    """Return whether a learner is to be given what is felt."""
    return _has(type(learner), ("decide_felt", "finish_felt", "opinion"))


def hears(classifier: Classifier) -> TypeGuard[EpisodicClassifier]:
    """Return whether a classifier is to be told where in an episode it is."""
    return _has(type(classifier), ("begin", "took"))


def _proposes(kind: Callable[..., object]) -> bool:
    return _has(kind, ("decide_move", "finish_move", "proposal"))


@cache
def _has(kind: Callable[..., object], methods: tuple[str, ...]) -> bool:
    """Return whether a class has these methods; asked at every decision, so it is looked up once."""
    return all(callable(getattr(kind, name, None)) for name in methods)


def installed(group: str) -> dict[str, EntryPoint]:
    """Return what installed packages register in a group, by name; PluginError when two claim the same name."""
    points: dict[str, EntryPoint] = {}
    for point in entry_points(group=group):
        other = points.setdefault(point.name, point)
        if other.value != point.value:
            both = f"{other.value} and {point.value}"
            raise PluginError(f"{group}: expected one plug-in named {point.name!r}, got {both}")
    return points


def classifier(plugin: Plugin) -> Classifier:
    """Return a classifier that has learnt nothing. Raises PluginError."""
    return _build(CLASSIFIERS, "classifier", plugin, lambda kind: kind(dict(plugin.settings)))


def learner(definition: Definition, plugin: Plugin, seed: int) -> Learner | ContinuousLearner:
    """Return a learner for a definition that has learnt nothing. Raises PluginError."""
    bounds, settings = Bounds(definition), dict(plugin.settings)

    def construct(kind: Callable[..., Learner | ContinuousLearner]) -> Learner | ContinuousLearner:
        if not _proposes(kind):
            return kind(definition.moves.count, settings, definition.policy, seed)
        if not bounds.axes:
            raise PluginError(
                f"learner {plugin.name!r} proposes moves within bounds: expected some in moves.continuous, got none"
            )
        return kind(bounds, settings, seed)

    return _build(LEARNERS, "learner", plugin, construct)


def check(definition: Definition) -> None:
    """Raise PluginError when a definition names what is not there, or what refuses its settings."""
    if isinstance(definition.classifier, Plugin):
        classifier(definition.classifier)
    if isinstance(definition.learner, Plugin):
        learner(definition, definition.learner, 0)


def settings_as(wanted: type[T], given: Mapping[str, Setting]) -> T:
    """Return a plug-in's settings as the msgspec struct that it wants them in. Raises ValueError."""
    try:
        return msgspec.convert(given, wanted)
    except msgspec.ValidationError as error:
        raise ValueError(in_words(str(error))) from None


def _build(group: str, what: str, plugin: Plugin, construct: Callable[[Callable[..., T]], T]) -> T:
    """Load a plug-in's class, call ``construct`` with it and return the result. Raises PluginError."""
    points = installed(group)
    if plugin.name not in points:
        names = ", ".join(sorted(points)) or "nothing that is installed"
        raise PluginError(f"{what}.name: expected one of {names}, got {plugin.name!r}; is its package installed?")
    point = points[plugin.name]
    try:
        kind = point.load()
    except Exception as error:  # an import runs whatever code the package has
        raise PluginError(f"{what} {plugin.name!r}: {point.value} cannot be loaded: {_line(error)}") from error
    try:
        return construct(kind)
    except (TypeError, ValueError) as error:
        raise PluginError(f"{what} {plugin.name!r}: settings: {_line(error)}") from error


def _line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split()) if str(error) else type(error).__name__
