"""Where two runs part, from their journals: definition, first step that is not the same, and what came of it. Pure."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from typing import NamedTuple

import msgspec

from services.rules.results import succeeded
from services.rules.swaps import words
from services.wire.actions import action_names
from services.wire.definition import Definition
from services.wire.messages import EpisodeSummary, JournalEpisode, JournalStep, RunRecord, Swap

_OF_A_STEP = ("step", "force_n", "torque_nm", "state", "action", "increment", "reward", "policy_version")
_OF_A_SUMMARY = tuple(name for name in EpisodeSummary.__struct_fields__ if name not in ("run", "episode"))


class Difference(NamedTuple):
    """A setting that is not the same; None where a run has no such setting."""

    field: str
    a: object
    b: object


class Parting(NamedTuple):
    """The first thing in two journals that is not the same."""

    episode: int
    step: int | None
    """Motions made before it in this episode of A; None for what is of the whole episode."""
    decision: int | None
    field: str
    a: object
    b: object

    def __str__(self) -> str:
        where = f"episode {self.episode}"
        if self.step is not None:
            where += f", step {self.step}, decision {self.decision}"
        return f"{where}: {self.field}: {self.a} in A, {self.b} in B"


class Share(NamedTuple):
    """Episodes from the parting on that both runs have, by what is the same in them."""

    same: int
    different: int


class Course(NamedTuple):
    """How the episodes of one run went, as means."""

    episodes: int
    episode_return: float
    force_n: float
    success: float
    """Fraction inserted, 0..1."""


class Comparison:
    """Two runs as far as they have been compared. Give it the journals' episodes in order."""

    def __init__(
        self,
        a: RunRecord,
        b: RunRecord,
        first_versions: tuple[int, int] = (0, 0),
        swaps: tuple[Sequence[Swap], Sequence[Swap]] = ((), ()),
    ) -> None:
        """``first_versions`` are the policy versions that the runs began with: 0 without a skill."""
        self.settings = [*differences(a, b), *swap_differences(*swaps)]
        self.parting: Parting | None = None
        self.pairs: list[tuple[EpisodeSummary, EpisodeSummary]] = []
        """Summaries of each episode from the parting on."""
        self.episodes = 0
        """Episodes compared so far."""
        self._first_versions = first_versions
        self._actions = action_names(a.definition.moves), action_names(b.definition.moves)

    def add(self, a: JournalEpisode, b: JournalEpisode) -> None:
        """Compare the next episode."""
        if self.parting is None:
            self.parting = next(self._partings(a, b), None)
        if self.parting is not None and a.summary is not None and b.summary is not None:
            self.pairs.append((a.summary, b.summary))
        self.episodes += 1

    def outcomes(self) -> Share:
        """Return in how many episodes from the parting on the outcome is the same."""
        return _share([a.outcome == b.outcome for a, b in self.pairs])

    def returns(self) -> Share:
        """Return in how many episodes from the parting on the return is the same."""
        return _share([a.episode_return == b.episode_return for a, b in self.pairs])

    def courses(self) -> tuple[Course, Course] | None:
        """Return how the episodes from the parting on went in each run; None without a parting."""
        if not self.pairs:
            return None
        return _course([a for a, _ in self.pairs]), _course([b for _, b in self.pairs])

    def _partings(self, a: JournalEpisode, b: JournalEpisode) -> Iterator[Parting]:
        """Give whatever is not the same in an episode, in the order of events."""
        for index, (in_a, in_b) in enumerate(zip(a.steps, b.steps, strict=False)):
            for field in _OF_A_STEP:
                one, other = self._value(in_a, field, 0), self._value(in_b, field, 1)
                if one != other:
                    yield Parting(a.episode, in_a.step, a.first_decision + index, field, one, other)
        if len(a.steps) != len(b.steps):
            yield Parting(a.episode, None, None, "decisions", len(a.steps), len(b.steps))
        for field in _OF_A_SUMMARY:
            one, other = getattr(a.summary, field, None), getattr(b.summary, field, None)
            if one != other:
                yield Parting(a.episode, None, None, field, one, other)

    def _value(self, step: JournalStep, field: str, run: int) -> object:
        """Return what a step has in a field: an action by its name, updates since the run began."""
        value: object = getattr(step, field)
        if field == "action" and isinstance(value, int):
            return self._actions[run][value] if value < len(self._actions[run]) else value
        if field == "policy_version" and isinstance(value, int):
            return value - self._first_versions[run]
        return value


def differences(a: RunRecord, b: RunRecord) -> Iterator[Difference]:
    """Give what two runs do not have in common from the beginning: settings by their dotted names, seed and skill."""
    in_a, in_b = _flat(a.definition), _flat(b.definition)
    for field in dict.fromkeys((*in_a, *in_b)):
        if in_a.get(field) != in_b.get(field):
            yield Difference(field, in_a.get(field), in_b.get(field))
    for field in ("seed", "skill_sha256"):
        if getattr(a, field) != getattr(b, field):
            yield Difference(field, getattr(a, field), getattr(b, field))


def swap_differences(a: Sequence[Swap], b: Sequence[Swap]) -> Iterator[Difference]:
    """Give the swaps that two runs do not have in common; by what name they were asked for does not matter."""
    for number, (in_a, in_b) in enumerate(zip_longest(a, b), start=1):
        one, other = (None if swap is None else words(swap) for swap in (in_a, in_b))
        if one != other:
            yield Difference(f"swap {number}", one, other)


def _flat(definition: Definition) -> dict[str, object]:
    """Return the settings of a definition by their dotted names."""

    def walk(fields: dict[str, object], prefix: str) -> Iterator[tuple[str, object]]:
        for name, value in fields.items():
            if isinstance(value, dict):
                yield from walk(value, f"{prefix}{name}.")
            else:
                yield f"{prefix}{name}", value

    return dict(walk(msgspec.to_builtins(definition), ""))


def _share(same: Sequence[bool]) -> Share:
    return Share(sum(same), len(same) - sum(same))


def _course(episodes: Sequence[EpisodeSummary]) -> Course:
    return Course(
        len(episodes),
        statistics.fmean(summary.episode_return for summary in episodes),
        statistics.fmean(summary.mean_force_n for summary in episodes),
        statistics.fmean(succeeded(summary) for summary in episodes),
    )
