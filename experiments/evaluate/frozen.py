"""A learnt skill as a controller: nothing is learnt any more, and no move tried but the best that is surely known."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from experiments.evaluate.controllers import Choice
from services.agent.fold import learner_of
from services.agent.learning import Learner
from services.agent.policies import choose
from services.classifier.fold import classifier_of
from services.rules.bounds import Bounds
from services.rules.plugins import feels, hears, proposes
from services.rules.skill import NamedSkill, fits
from services.rules.skill_memory import untried
from services.rules.swaps import in_force
from services.rules.wrench import Reference, Wrench
from services.wire.definition import Definition, FeltModel, Greedy, LearnerSettings, Plugin
from services.wire.errors import UnusableError
from services.wire.messages import Observation
from services.wire.randomness import Role, generator

CAUTION = 5.0
"""Standard deviations of what a felt model thinks of a move that are taken off: a frozen skill tries nothing, and of a
move that looks good where it was never made it would never hear that it is not (docs/decisions/0043-force-stays.md)."""


class FrozenSkill:
    """What was learnt, applied to a task that it may never have seen.

    A force vector that fits no contact state is one of a state without values: every move is as good there, and one is
    drawn. A move that was never learnt from in any state, as in a skill that was carried over from other moves, is not
    known and never made. Raises SkillError when the skill does not fit the task's moves and sensor.
    """

    def __init__(self, skill: NamedSkill, definition: Definition, seed: int) -> None:
        fits(skill.skill, definition)
        learnt = in_force(skill.skill.definition, skill.skill.swaps)
        self._classifier = classifier_of(learnt.classifier)
        self._learner = learner_of(replace(learnt, policy=Greedy(), learner=_cautious(learnt.learner)), seed)
        self._classifier.restore(skill.skill.classifier)
        self._learner.restore(skill.skill.agent)
        self._reference, self._bounds = Reference(definition), Bounds(definition)
        self._strange = self._classifier.states
        self._seed = seed
        never = () if isinstance(learnt.learner, Plugin) else untried(skill.skill.agent)
        self._known = [action for action in range(definition.moves.count) if action not in never]
        self._all_known = not never or not self._known

    def begin(self) -> None:
        """Begin an episode; there is nothing to forget."""

    def decide(self, felt: Observation) -> Choice:
        """Return the best move in the contact state that is felt, as far as it is sure."""
        self._tell(felt)
        try:
            wrench = self._reference.felt(felt.force_n, felt.torque_nm)
            state = self._classifier.classify(*wrench).state
        except ValueError as error:
            raise UnusableError(f"observation: decision {felt.decision}: {error}") from error
        state = self._strange if state < 0 else state
        if proposes(self._learner):
            increment = self._learner.proposal(state, wrench, felt.episode).increment
            return Choice(self._bounds.counts_as(increment), state, increment)
        if not self._all_known:
            return Choice(self._best_known(state, wrench, felt), state)
        if feels(self._learner):
            return Choice(self._learner.decide_felt(None, state, wrench, felt.episode, felt.step), state)
        return Choice(self._learner.decide(None, state, felt.episode, felt.step), state)

    def _tell(self, felt: Observation) -> None:
        """Tell a classifier that hears it where in the episode it is."""
        if hears(self._classifier):
            if felt.previous_action is None:
                self._classifier.begin()
            else:
                self._classifier.took(felt.previous_action)

    def _best_known(self, state: int, wrench: Wrench, felt: Observation) -> int:
        """Return the best of the moves that were ever learnt from; of equals one is drawn."""
        uniform = generator(self._seed, Role.POLICY, felt.episode, felt.step).random()
        values = self._values(state, wrench, felt.episode)
        return self._known[choose([values[action] for action in self._known], Greedy(), 0, uniform)]

    def _values(self, state: int, wrench: Wrench, episode: int) -> Sequence[float]:
        """Return what each move is worth."""
        assert not proposes(self._learner)
        if feels(self._learner):
            opinion = self._learner.opinion(state, wrench, episode)
            values: list[float] = (opinion.values - CAUTION * opinion.deviation).tolist()
            return values
        assert isinstance(self._learner, Learner)
        row: list[float] = self._learner.values(state).tolist()
        return row


def _cautious(learner: LearnerSettings) -> LearnerSettings:
    return replace(learner, caution=CAUTION) if isinstance(learner, FeltModel) else learner
