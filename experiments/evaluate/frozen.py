"""A learnt skill as a controller: nothing is learnt any more, and no move is tried but the best known."""

from __future__ import annotations

from msgspec.structs import replace

from experiments.evaluate.controllers import Choice
from services.agent.fold import learner_of
from services.classifier.fold import classifier_of
from services.rules.plugins import feels
from services.rules.skill import NamedSkill, fits
from services.rules.swaps import in_force
from services.rules.wrench import Reference
from services.wire.definition import Definition, Greedy
from services.wire.errors import UnusableError
from services.wire.messages import Observation


class FrozenSkill:
    """What was learnt, applied to a task that it may never have seen.

    A force vector that fits no contact state is one of a state without values: every move is as good there, and one is
    drawn. Raises SkillError when the skill does not fit the task's moves and sensor.
    """

    def __init__(self, skill: NamedSkill, definition: Definition, seed: int) -> None:
        fits(skill.skill, definition)
        learnt = in_force(skill.skill.definition, skill.skill.swaps)
        self._classifier = classifier_of(learnt.classifier)
        self._learner = learner_of(replace(learnt, policy=Greedy()), seed)
        self._classifier.restore(skill.skill.classifier)
        self._learner.restore(skill.skill.agent)
        self._reference = Reference(definition)
        self._strange = self._classifier.states

    def begin(self) -> None:
        """Begin an episode; there is nothing to forget."""

    def decide(self, felt: Observation) -> Choice:
        """Return the best move in the contact state that is felt."""
        try:
            wrench = self._reference.felt(felt.force_n, felt.torque_nm)
            state = self._classifier.classify(*wrench).state
        except ValueError as error:
            raise UnusableError(f"observation: decision {felt.decision}: {error}") from error
        state = self._strange if state < 0 else state
        if feels(self._learner):
            return Choice(self._learner.decide_felt(None, state, wrench, felt.episode, felt.step), state)
        return Choice(self._learner.decide(None, state, felt.episode, felt.step), state)
