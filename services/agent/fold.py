"""The agent as a pure fold: its memory after decision n is a function of what the run began with and 0..n alone.

It begins with the definition, the seed and perhaps a skill; states and rewards follow. Swaps take effect at their
episodes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from services.agent.learning import Learner as TdLearner
from services.rules import plugins
from services.rules.bounds import Bounds, on_grid
from services.rules.entries import reward_in, state_in
from services.rules.place import Place, split_place, with_place
from services.rules.plugins import ContinuousLearner, Learner, Lesson, Opinion, Proposal, feels, proposes
from services.rules.timeline import Timeline
from services.rules.wrench import Reference, Wrench
from services.wire.actions import Increment, repeatable
from services.wire.definition import Definition, FeltModel, InsertionReward, Plugin
from services.wire.errors import DivergedError, ForeignRunError, GapError, UnusableError
from services.wire.messages import Action, Force, JournalEpisode, Reward, Skill, State, Swap, Torque

_FORGOTTEN = "fold_forgotten"
_NOTHING = Wrench((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def learner_of(definition: Definition, seed: int) -> Learner | ContinuousLearner:
    """Return a learner that has learnt nothing. Raises PluginError for one of another package."""
    moves, settings, policy = definition.moves, definition.learner, definition.policy
    if isinstance(settings, Plugin):
        return plugins.learner(definition, settings, seed)
    if isinstance(settings, FeltModel):
        from services.agent.felt import FeltLearner  # here: others need no compiler

        return FeltLearner(moves, settings, policy, seed, _known_cost(definition) if settings.force_stays else 0.0)
    return TdLearner(moves.count, settings, policy, seed, repeatable(moves))


def _known_cost(definition: Definition) -> float:
    """Return what each newton that stays costs a move by the reward, without shaping: that pays changes alone."""
    reward = definition.reward
    return reward.force_per_n if isinstance(reward, InsertionReward) else 0.0


class AgentFold:
    """A learner with a place in the run: decisions seen before are answered again, and nothing is learnt twice."""

    def __init__(self, definition: Definition, run: str, seed: int, swaps: Sequence[Swap] = ()) -> None:
        self.learner = learner_of(definition, seed)
        self.timeline = Timeline(definition, swaps)
        self.run = run
        self._seed = seed
        self._forgotten = 0
        """Decisions whose lesson is in no table: those of tables that swaps ended, and those that taught nothing."""
        self.decisions = 0
        """States folded so far: the decision number that comes next."""
        self.rewards = 0
        """Rewards folded so far: never more than ``decisions``, never less than one below."""
        self.episode = 0
        """Episode of the last state folded."""
        self._reference = Reference(definition)
        self._bounds = Bounds(definition)
        self._previous: Lesson | None = None
        self._answers: dict[int, tuple[State, Action]] = {}
        self._received: dict[int, Reward] = {}

    def decide(self, state: State) -> Action:
        """Return the action for a state, after learning from the reward before it.

        Raises ForeignRunError, GapError (states, or the reward before this one, are missing; nothing is changed) or
        DivergedError (this decision was seen with another state).
        """
        if state.run != self.run:
            raise ForeignRunError(f"state: expected run {self.run}, got {state.run}")
        if state.decision < self.decisions:
            return self._again(state)
        if state.decision > self.decisions:
            raise GapError(f"state: expected decision {self.decisions}, got {state.decision}")
        if self.rewards < self.decisions:
            raise GapError(f"state: the reward of decision {self.decisions - 1} is missing")
        if state.episode < self.episode:
            raise DivergedError(f"state: expected episode {self.episode} or later, got {state.episode}")
        self._swap(self.timeline.due(state))
        try:
            chosen, increment = self._decide(state)
        except ValueError as error:
            raise UnusableError(f"state: decision {state.decision}: {error}") from error
        if state.episode > self.episode:
            self._answers.clear()
            self._received.clear()
            self.episode = state.episode
        self._previous = None
        action = Action(
            run=self.run,
            episode=state.episode,
            step=state.step,
            decision=state.decision,
            state=state.state,
            action=chosen,
            policy_version=self.version,
            swaps=state.swaps,
            increment=increment,
        )
        self._answers[state.decision] = (state, action)
        self.decisions += 1
        return action

    def reward(self, reward: Reward) -> bool:
        """Take the reward of the last decision; True when it was new.

        Raises ForeignRunError, GapError (its decision has not been taken here) or DivergedError (another reward came
        for this decision before).
        """
        if reward.run != self.run:
            raise ForeignRunError(f"reward: expected run {self.run}, got {reward.run}")
        if reward.decision < self.rewards:
            earlier = self._received.get(reward.decision)
            if earlier is not None and earlier != reward:
                raise DivergedError(f"reward: decision {reward.decision} came again with another reward")
            return False
        if reward.decision >= self.decisions:
            raise GapError(f"reward: expected one below decision {self.decisions}, got {reward.decision}")
        state, action = self._answers[reward.decision]
        if reward.terminal is None:
            self._previous = self._lesson(state, action, reward)
        elif self._ended_from_outside(reward):
            self._forgotten += 1
        else:
            self._finish(self._lesson(state, action, reward))
        self._received[reward.decision] = reward
        self.rewards += 1
        return True

    @property
    def version(self) -> int:
        """Policy version: decisions so far that were learnt from or given up; it never falls."""
        return self._forgotten + self.learner.version

    @property
    def table(self) -> Learner:
        """The learner, of those that choose from a list of moves. Raises ValueError for one that proposes moves."""
        if proposes(self.learner):
            raise ValueError("agent: expected a learner with values of actions, got one that proposes moves")
        return self.learner

    @property
    def between_episodes(self) -> bool:
        """True when nothing of an episode is under way, so that ``snapshot`` is complete."""
        return self.rewards == self.decisions and self._previous is None

    def opinion(self, state: int, force_n: Force, torque_nm: Torque) -> Opinion | None:
        """Return what a learner that feels thinks of each action at a sample as it is read; None of another learner.

        Raises ValueError for numbers out of range.
        """
        if proposes(self.learner) or not feels(self.learner):
            return None
        return self.learner.opinion(state, self._reference.felt(force_n, torque_nm), self.episode)

    def proposal(self, state: int, force_n: Force, torque_nm: Torque) -> Proposal | None:
        """Return what a learner that proposes moves would do at a sample as it is read; None of another learner.

        Raises ValueError for numbers out of range.
        """
        if not proposes(self.learner):
            return None
        return self.learner.proposal(state, self._reference.felt(force_n, torque_nm), self.episode)

    def replay(self, journal: JournalEpisode) -> None:
        """Fold what is new of a journal entry; raises like ``decide``, also when the actions differ."""
        for offset, step in enumerate(journal.steps):
            decision = journal.first_decision + offset
            if decision < self.rewards or step.state is None:
                continue
            action = self.decide(state_in(journal, offset, step.state))
            if step.action is not None and step.action != action.action:
                raise DivergedError(
                    f"replay: decision {decision}: journal has action {step.action}, got {action.action}"
                )
            if step.action is not None and step.increment != action.increment:
                raise DivergedError(
                    f"replay: decision {decision}: journal has the move {step.increment}, got {action.increment}"
                )
            if step.reward is not None:
                self.reward(reward_in(journal, offset, step.reward))

    def begin_with(self, skill: Skill) -> None:
        """Take over what was learnt in another run, before this one's first decision. Raises ValueError."""
        self.learner.restore(skill.agent)
        self.learner.episodes_before = skill.episodes

    def learnt(self) -> dict[str, bytes | int]:
        """Return what was learnt, without the place in the run. Raises ValueError when an episode is under way."""
        if not self.between_episodes:
            raise ValueError("agent memory: expected to be between episodes")
        return self.learner.snapshot()

    def snapshot(self) -> dict[str, bytes | int]:
        """Return the memory. Raises ValueError when an episode is under way."""
        place = Place(self.decisions, self.episode, self.timeline.made)
        return {**with_place(self.learnt(), place), _FORGOTTEN: self._forgotten}

    def restore(self, snapshot: Mapping[str, bytes | int]) -> None:
        """Take over a memory. Raises ValueError, with nothing changed, when it does not fit."""
        memory, place = split_place(snapshot, "agent")
        forgotten = memory.pop(_FORGOTTEN, None)
        if not isinstance(forgotten, int) or forgotten < 0:
            raise ValueError(f"agent checkpoint: expected {_FORGOTTEN} of 0 or more")
        learner = self._learner_after(place.swaps)
        learner.restore(memory)
        self.learner, self._forgotten = learner, forgotten
        self.timeline.made = place.swaps
        self.decisions = self.rewards = place.decisions
        self.episode = place.episode
        self._previous = None
        self._answers.clear()
        self._received.clear()

    def _decide(self, state: State) -> tuple[int, Increment | None]:
        """Return the learner's action, and the move where it is no listed one. Raises ValueError."""
        learner, previous = self.learner, self._previous
        if proposes(learner):
            proposed = learner.decide_move(previous, state.state, self._felt(state), state.episode, state.step)
            increment = on_grid(Increment(*proposed))
            if complaint := self._bounds.complaint(increment):
                raise ValueError(f"proposed move: {complaint}")
            return self._bounds.counts_as(increment), increment
        if feels(learner):
            return learner.decide_felt(previous, state.state, self._felt(state), state.episode, state.step), None
        lesson = None if previous is None else previous[:3]
        return learner.decide(lesson, state.state, state.episode, state.step), None

    def _finish(self, lesson: Lesson) -> None:
        """Teach an episode's last decision. Raises ValueError."""
        if proposes(self.learner):
            self.learner.finish_move(lesson)
        elif feels(self.learner):
            self.learner.finish_felt(lesson)
        else:
            self.learner.finish(lesson[:3])

    def _lesson(self, state: State, action: Action, reward: Reward) -> Lesson:
        """Return what a decision led to."""
        felt = self._felt(state) if proposes(self.learner) or feels(self.learner) else _NOTHING
        increment = None if action.increment is None else Increment(*action.increment)
        return Lesson(state.state, action.action, reward.reward, felt, reward.terminal, increment)

    def _felt(self, state: State) -> Wrench:
        """Return what was felt in a state. Raises ValueError where nobody says it."""
        if state.force_n is None or state.torque_nm is None:
            raise ValueError("expected force and torque beside the state, got none")
        return self._reference.felt(state.force_n, state.torque_nm)

    def _swap(self, due: Sequence[Swap]) -> None:
        """Make swaps, keeping the table unless one says that it begins afresh."""
        for swap in due:
            if swap.learner is not None or swap.policy is not None or "agent" in swap.fresh:
                learner = self._learner_after(self.timeline.made + 1)
                if "agent" in swap.fresh:
                    self._forgotten = self.version
                else:
                    learner.restore(self.learner.snapshot())
                self.learner = learner
            self.timeline.made += 1

    def _ended_from_outside(self, reward: Reward) -> bool:
        """Return whether an episode was ended from outside: what would have come of its last decision nobody knows.

        The sample after the last motion is not classified, so that there is no state to go on from; and to teach that
        nothing follows would make wandering until the limit look cheap.
        """
        limits = self.timeline.definition.limits
        return reward.terminal == "move_limit" and limits.truncation == "untaught"

    def _learner_after(self, swaps: int) -> Learner | ContinuousLearner:
        """Return the learner after so many swaps, as it is before it learns. Raises ValueError."""
        learner = learner_of(self.timeline.definition_after(swaps), self._seed)
        learner.episodes_before = self.learner.episodes_before
        return learner

    def _again(self, state: State) -> Action:
        earlier = self._answers.get(state.decision)
        if earlier is None:
            raise DivergedError(f"state: decision {state.decision} lies in an earlier episode than {self.episode}")
        if earlier[0].state != state.state:
            raise DivergedError(
                f"state: decision {state.decision} came again as state {state.state}, was {earlier[0].state}"
            )
        return earlier[1]
