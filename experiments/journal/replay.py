"""A run's memory and episode log rebuilt from its journal alone, without physics, every step verified. Pure.

The folds are the workers' own. From the recorded forces the classifier has to come to the recorded states; from these
and the recorded rewards the agent has to come to the recorded actions and policy versions; rewards and summaries have
to be what the definition makes of the rest. What does not agree is counted, the first of it is kept, and the replay
goes on with what the journal says, so that it shows which part of the memory is concerned.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import NamedTuple

from msgspec.structs import replace

from experiments.journal.checks import reward_trouble, step_troubles, summary_troubles
from experiments.journal.magnitudes import Trouble
from services.agent.fold import AgentFold
from services.classifier.fold import ClassifierFold
from services.rules.entries import observation_in
from services.rules.plugins import proposes
from services.rules.results import Digests, episodes_digest
from services.rules.skill import NamedSkill
from services.rules.swaps import fresh_after, fresh_at, in_force, known_in
from services.wire.actions import action_names
from services.wire.definition_file import definition_sha256, run_id
from services.wire.errors import BadPayloadError, DivergedError, FoldError, GapError
from services.wire.messages import EpisodeSummary, JournalEpisode, JournalStep, Reward, RunRecord, Swap


class Mismatch(NamedTuple):
    """Where the journal does not agree with what follows from it."""

    episode: int
    step: int | None
    """Motions made before it; None for the episode's summary."""
    decision: int | None
    field: str
    expected: str
    """What follows from the definition and all before."""
    got: str
    """What the journal has."""

    def __str__(self) -> str:
        where = "summary" if self.step is None else f"step {self.step}, decision {self.decision}"
        return f"episode {self.episode}, {where}: {self.field}: expected {self.expected}, got {self.got}"


class Moment(NamedTuple):
    """The memory between two episodes."""

    decisions: int
    q_table: str
    """SHA-256 in hex of the Q-table."""
    art2: str
    """SHA-256 in hex of the ART2 weights."""
    snapshots: Mapping[str, Mapping[str, bytes | int]]
    """What each worker would put into a checkpoint, by its name."""


class StateMemory(NamedTuple):
    """What is known of one contact state."""

    state: int
    best_action: str
    value: float
    """Of the best action."""
    visits: int
    """Learning updates in it."""
    felt: int
    """Force/torque vectors that the classifier learnt in it."""
    q: tuple[float, ...]
    """Value of each action."""
    visits_by_action: tuple[int, ...]
    prototype: tuple[float, ...]
    """The classifier's weights."""


class _Decision(NamedTuple):
    """A step of a finished episode, which has all of its fields."""

    step: JournalStep
    state: int
    action: int
    policy_version: int
    reward: float


class Replay:
    """A run as far as it has been folded. Give it the journal's episodes in order."""

    def __init__(
        self,
        record: RunRecord,
        began_with: NamedSkill | None = None,
        swaps: Sequence[Swap] = (),
        *,
        at_episodes: Collection[int] = (),
        at_versions: Collection[int] = (),
        at_decisions: Collection[int] = (),
        entry: int | None = None,
    ) -> None:
        """Begin a run that began with a skill, or with nothing learnt; ``swaps`` are all that were made in it.

        Digests are kept of the memory before ``at_episodes``, of the Q-table at policy versions
        ``at_versions``, and of the ART2 weights after so many decisions; the entry of episode ``entry`` is kept too.
        Raises DivergedError when these parts are not of one run.
        """
        _check_record(record, began_with)
        _check_swaps(record, swaps)
        self.record = record
        self.swaps = tuple(swaps)
        self.agent = AgentFold(record.definition, record.run, record.seed, swaps)
        self.classifier = ClassifierFold(record.definition, record.run, swaps)
        self.known_states = 0
        """Contact states that the task has seen."""
        if began_with is not None:
            begin(self.agent, began_with)
            begin(self.classifier, began_with)
            self.known_states = began_with.states
        self.summaries: list[EpisodeSummary] = []
        self.mismatches: Counter[str] = Counter()
        """How many there are, by field."""
        self.first_mismatch: Mismatch | None = None
        self.moments: dict[int, Moment] = {}
        """Memory before each of ``at_episodes``, as far as they were reached."""
        self.q_table_at: dict[int, dict[int, str]] = {}
        """By policy version and, as a table may be begun afresh between two updates, by decisions."""
        self.art2_at: dict[int, str] = {}
        self.entry: JournalEpisode | None = None
        """The one that was to be kept."""
        self._kept = entry
        self._actions = action_names(record.definition.moves)
        self._at_episodes, self._at_versions = frozenset(at_episodes), frozenset(at_versions)
        self._at_decisions = frozenset(at_decisions)
        self._look()
        self._look_between()

    @property
    def episodes(self) -> int:
        """Episodes folded so far."""
        return len(self.summaries)

    @property
    def decisions(self) -> int:
        """Decisions folded so far."""
        return self.classifier.decisions

    def digests(self) -> Digests:
        """Return the digests of the memory and of the episode log, as ``summary.json`` has them."""
        return {
            "q_table": self.agent.learner.digest(),
            "art2": self.classifier.network.digest(),
            "episodes": episodes_digest(self.summaries),
        }

    def states(self) -> list[StateMemory]:
        """Return what is known of each contact state; nothing of the agent's where it proposes moves."""
        art2 = self.classifier.network
        if proposes(self.agent.learner):
            rows = zip(art2.counts.tolist(), art2.prototypes.tolist(), strict=True)
            return [
                StateMemory(state, "", 0.0, 0, count, (), (), tuple(prototype))
                for state, (count, prototype) in enumerate(rows)
            ]
        learner = self.agent.table
        visits, counts, prototypes = learner.visits, art2.counts, art2.prototypes
        found = []
        for state in range(max(learner.states, art2.states)):
            q, best = learner.values(state), learner.best_action(state)
            of_actions = visits[state].tolist() if state < learner.states else [0] * len(self._actions)
            felt = state < art2.states
            found.append(
                StateMemory(
                    state=state,
                    best_action=self._actions[best],
                    value=float(q[best]),
                    visits=sum(of_actions),
                    felt=int(counts[state]) if felt else 0,
                    q=tuple(q.tolist()),
                    visits_by_action=tuple(of_actions),
                    prototype=tuple(prototypes[state].tolist()) if felt else (),
                )
            )
        return found

    def fold(self, entry: JournalEpisode) -> None:
        """Fold the next episode.

        Raises GapError for another one, BadPayloadError for one that is not complete, and FoldError for steps that no
        worker can fold; the replay is of no use then.
        """
        summary = self._checked(entry)
        if fresh_at(self.swaps, entry.episode, "classifier"):
            self.known_states = 0
        for index, step in enumerate(entry.steps):
            try:
                troubles = [*self._fold_step(entry, index, self._complete(step), summary)]
            except (FoldError, BadPayloadError) as error:
                where = f"run {entry.run}, episode {entry.episode}, step {step.step}"
                raise type(error)(f"{where}: {error}") from error
            for trouble in troubles:
                self._note(trouble, entry.episode, step.step, entry.first_decision + index)
        definition = self.record.definition
        for trouble in summary_troubles(definition, entry.steps, summary, self.known_states):
            self._note(trouble, entry.episode, None, None)
        self.known_states = max(self.known_states, summary.states)
        self.summaries.append(summary)
        if entry.episode == self._kept:
            self.entry = entry
        self._look_between()

    def _checked(self, entry: JournalEpisode) -> EpisodeSummary:
        run, summary = self.record.run, entry.summary
        place = (entry.run, entry.episode, entry.first_decision)
        expected = (run, self.episodes, self.decisions)
        for what, wanted, got in zip(("run", "episode", "first_decision"), expected, place, strict=True):
            if wanted != got:
                raise GapError(f"run {run}, episode {self.episodes}: {what}: expected {wanted}, got {got}")
        if (known := known_in(self.swaps, entry.episode)) != entry.swaps:
            raise GapError(f"run {run}, episode {entry.episode}: swaps: expected {known}, got {entry.swaps}")
        if summary is None or (summary.run, summary.episode) != (run, entry.episode):
            got = "none" if summary is None else f"that of episode {summary.episode} of run {summary.run}"
            raise BadPayloadError(f"run {run}, episode {entry.episode}: expected its summary, got {got}")
        return summary

    def _complete(self, step: JournalStep) -> _Decision:
        state, action, version, reward = step.state, step.action, step.policy_version, step.reward
        if state is None or action is None or version is None or reward is None:
            raise BadPayloadError("expected state, action, policy version and reward, got not all of them")
        if action >= len(self._actions):
            raise BadPayloadError(f"expected an action below {len(self._actions)}, got {action}")
        return _Decision(step, state, action, version, reward)

    def _fold_step(
        self, entry: JournalEpisode, index: int, made: _Decision, summary: EpisodeSummary
    ) -> Iterator[Trouble]:
        """Fold one decision and give what does not agree."""
        definition, step = self.record.definition, made.step
        decision = entry.first_decision + index
        yield from step_troubles(definition, entry.steps, index)
        state = self.classifier.observe(observation_in(entry, index))
        if state.state != made.state:
            yield Trouble("state", str(state.state), str(made.state))
        action = self.agent.decide(replace(state, state=made.state))
        self._look()
        if action.action != made.action:
            yield Trouble("action", self._actions[action.action], self._actions[made.action])
        elif action.increment != step.increment:
            yield Trouble("increment", str(action.increment), str(step.increment))
        if action.policy_version != made.policy_version:
            yield Trouble("policy_version", str(action.policy_version), str(made.policy_version))
        if (trouble := reward_trouble(definition, entry.steps, index, summary)) is not None:
            yield trouble
        self.agent.reward(
            Reward(
                run=entry.run,
                episode=entry.episode,
                step=step.step,
                decision=decision,
                reward=made.reward,
                terminal=summary.outcome if index == len(entry.steps) - 1 else None,
                swaps=entry.swaps,
            )
        )
        self._look()

    def _note(self, trouble: Trouble, episode: int, step: int | None, decision: int | None) -> None:
        self.mismatches[trouble.field] += 1
        if self.first_mismatch is None:
            self.first_mismatch = Mismatch(episode, step, decision, *trouble)

    def _look(self) -> None:
        """Keep digests of the memory when it is at a wanted version or decision."""
        version = self.agent.version
        if version in self._at_versions:
            self.q_table_at.setdefault(version, {})[self.agent.decisions] = self.agent.learner.digest()
        if self.decisions in self._at_decisions:
            self.art2_at[self.decisions] = self.classifier.network.digest()

    def _look_between(self) -> None:
        if self.episodes in self._at_episodes:
            snapshots = {"agent": self.agent.snapshot(), "classifier": self.classifier.snapshot()}
            found = Moment(self.decisions, self.agent.learner.digest(), self.classifier.network.digest(), snapshots)
            self.moments[self.episodes] = found


def begin(fold: AgentFold | ClassifierFold, skill: NamedSkill) -> None:
    """Let a blank fold begin with a skill. Raises DivergedError when it does not fit."""
    try:
        fold.begin_with(skill.skill)
    except ValueError as error:
        raise DivergedError(f"skill {skill.sha256[:12]}: {error}") from error


def _check_record(record: RunRecord, began_with: NamedSkill | None) -> None:
    """Raise DivergedError when a record contradicts itself, or when that is not the skill that the run began with."""
    definition = record.definition
    agree = (
        ("definition_sha256", definition_sha256(definition), record.definition_sha256),
        ("name", run_id(definition, record.seed, record.skill_sha256), record.run),
        ("skill", record.skill_sha256, None if began_with is None else began_with.sha256),
    )
    for what, expected, got in agree:
        if expected != got:
            raise DivergedError(f"run {record.run}: {what}: expected {expected}, got {got}")


def _check_swaps(record: RunRecord, swaps: Sequence[Swap]) -> None:
    """Raise DivergedError when a swap cannot have followed upon those before it."""
    before, earliest = record.definition, 1
    for number, swap in enumerate(swaps, start=1):
        after = in_force(before, (swap,))
        agree = (
            ("fresh", fresh_after(before, after), swap.fresh),
            ("changes", True, before != after),
            ("episode", max(earliest, swap.episode), swap.episode),
        )
        for what, expected, got in agree:
            if expected != got:
                raise DivergedError(f"run {record.run}: swap {number}: {what}: expected {expected}, got {got}")
        before, earliest = after, swap.episode
