"""The classifier as a pure fold: its memory after decision n is a function of what the run began with and 0..n alone.

It begins with the definition and perhaps a skill; observations follow. Swaps take effect at their episodes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from services.classifier.art2 import Art2
from services.classifier.unclassified import OneClass
from services.rules import plugins
from services.rules.entries import observation_in
from services.rules.place import Place, split_place, with_place
from services.rules.plugins import Classification, Classifier, ClassifierFullError, hears
from services.rules.timeline import Timeline
from services.rules.wrench import Reference
from services.wire.definition import Art2Settings, ClassifierSettings, Definition, Unclassified
from services.wire.errors import DivergedError, ForeignRunError, GapError, UnusableError
from services.wire.messages import Force, JournalEpisode, Observation, Skill, State, Swap, Torque


def classifier_of(settings: ClassifierSettings) -> Classifier:
    """Return a classifier that has learnt nothing. Raises ValueError, or PluginError for one of another package."""
    if isinstance(settings, Unclassified):
        return OneClass()
    return Art2(settings) if isinstance(settings, Art2Settings) else plugins.classifier(settings)


class ClassifierFold:
    """A classifier with a place in the run: what was seen before is answered again and not learnt twice."""

    def __init__(self, definition: Definition, run: str, swaps: Sequence[Swap] = ()) -> None:
        self.network = classifier_of(definition.classifier)
        self.timeline = Timeline(definition, swaps)
        self._reference = Reference(definition)
        self.run = run
        self.decisions = 0
        """Observations folded so far: the decision number that comes next."""
        self.episode = 0
        """Episode of the last observation folded."""
        self._answers: dict[int, tuple[Observation, State]] = {}

    def observe(self, observation: Observation) -> State:
        """Return the state of an observation, learning it if it is new.

        Raises ForeignRunError, GapError (observations before it are missing; nothing is changed) or DivergedError
        (this decision was seen with another sample).
        """
        if observation.run != self.run:
            raise ForeignRunError(f"observation: expected run {self.run}, got {observation.run}")
        if observation.decision < self.decisions:
            return self._again(observation)
        if observation.decision > self.decisions:
            raise GapError(f"observation: expected decision {self.decisions}, got {observation.decision}")
        if observation.episode < self.episode:
            raise DivergedError(f"observation: expected episode {self.episode} or later, got {observation.episode}")
        self._swap(self.timeline.due(observation))
        try:
            self._tell(observation)
            classification = self.network.learn(*self._reference.felt(observation.force_n, observation.torque_nm))
        except (ValueError, ClassifierFullError) as error:
            raise UnusableError(f"observation: decision {observation.decision}: {error}") from error
        if observation.episode > self.episode:
            self._answers.clear()
            self.episode = observation.episode
        state = State(
            run=self.run,
            episode=observation.episode,
            step=observation.step,
            decision=observation.decision,
            state=classification.state,
            states=classification.states,
            match=classification.match,
            swaps=observation.swaps,
            force_n=observation.force_n,
            torque_nm=observation.torque_nm,
        )
        self._answers[observation.decision] = (observation, state)
        self.decisions += 1
        return state

    def classify(self, force_n: Force, torque_nm: Torque) -> Classification:
        """Return the class of a sample as it is read, and learn nothing. Raises ValueError as the classifier does."""
        return self.network.classify(*self._reference.felt(force_n, torque_nm))

    def replay(self, journal: JournalEpisode) -> None:
        """Fold the decisions of a journal entry that are new; raises like ``observe``, also when states differ."""
        for offset, step in enumerate(journal.steps):
            decision = journal.first_decision + offset
            if decision < self.decisions:
                continue
            state = self.observe(observation_in(journal, offset))
            if step.state is not None and step.state != state.state:
                raise DivergedError(f"replay: decision {decision}: journal has state {step.state}, got {state.state}")

    def begin_with(self, skill: Skill) -> None:
        """Take over what was learnt in another run, before this one's first decision. Raises ValueError."""
        self.network.restore(skill.classifier)

    def learnt(self) -> dict[str, bytes | int]:
        """Return what was learnt, without the place in the run."""
        return self.network.snapshot()

    def snapshot(self) -> dict[str, bytes | int]:
        """Return the memory, to be taken between episodes."""
        return with_place(self.learnt(), Place(self.decisions, self.episode, self.timeline.made))

    def restore(self, snapshot: Mapping[str, bytes | int]) -> None:
        """Take over a memory. Raises ValueError, with nothing changed, when it does not fit."""
        memory, place = split_place(snapshot, "classifier")
        network = classifier_of(self.timeline.definition_after(place.swaps).classifier)
        network.restore(memory)
        self.network = network
        self.timeline.made = place.swaps
        self.decisions, self.episode = place.decisions, place.episode
        self._answers.clear()

    def _swap(self, due: Sequence[Swap]) -> None:
        """Make swaps: another classifier knows no states yet."""
        for swap in due:
            if "classifier" in swap.fresh:
                settings = self.timeline.definition_after(self.timeline.made + 1).classifier
                try:
                    self.network = classifier_of(settings)
                except ValueError as error:
                    raise UnusableError(f"swap: classifier: {error}") from error
            self.timeline.made += 1

    def _tell(self, observation: Observation) -> None:
        """Tell a classifier that hears it where in the episode it is."""
        if hears(self.network):
            if observation.previous_action is None:
                self.network.begin()
            else:
                self.network.took(observation.previous_action)

    def _again(self, observation: Observation) -> State:
        earlier = self._answers.get(observation.decision)
        if earlier is None:
            raise DivergedError(
                f"observation: decision {observation.decision} lies in an earlier episode than {self.episode}"
            )
        if earlier[0] != observation:
            raise DivergedError(f"observation: decision {observation.decision} came again with another sample")
        return earlier[1]
