"""A classifier that wants to hear where in an episode it is, in its fold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pytest
from msgspec.structs import replace

from services.classifier.fold import ClassifierFold
from services.classifier.fuzzy_art import FuzzyArt
from services.rules import plugins
from services.rules.plugins import Classification, hears
from services.wire.definition import Definition, Felt, Plugin, Setting, Wrist
from services.wire.messages import JournalEpisode, JournalStep, Observation, State

RUN = "test-s0"
FELT = ((0.0, 0.0, -1.0), (0.0, 0.1, 0.0))


class Remembering(FuzzyArt):
    """States that differ by the decision before: of vector and previous action, none at the beginning."""

    def __init__(self, settings: Mapping[str, Setting]) -> None:
        super().__init__(settings)
        self.heard: list[int | None] = []
        self.vectors: list[tuple[Sequence[float], Sequence[float]]] = []

    def begin(self) -> None:
        self.heard.append(None)

    def took(self, action: int) -> None:
        self.heard.append(action)

    def learn(self, force_n: Sequence[float], torque_nm: Sequence[float]) -> Classification:
        self.vectors.append((force_n, torque_nm))
        return super().learn(force_n, torque_nm)


def observation(decision: int, episode: int, previous: int | None) -> Observation:
    force_n, torque_nm = FELT
    return Observation(
        run=RUN,
        episode=episode,
        step=decision,
        decision=decision,
        force_n=force_n,
        torque_nm=torque_nm,
        previous_action=previous,
    )


@pytest.fixture
def fold(monkeypatch: pytest.MonkeyPatch) -> ClassifierFold:
    monkeypatch.setattr(plugins, "classifier", lambda plugin: Remembering(plugin.settings))
    felt = Felt(torque="tip")
    definition = Definition(name="test", wrist=Wrist(sensor_height_mm=100.0), felt=felt, classifier=Plugin(name="mine"))
    return ClassifierFold(definition, RUN)


def network(fold: ClassifierFold) -> Remembering:
    assert isinstance(fold.network, Remembering)
    return fold.network


def test_it_hears_beginnings_and_decisions_once_each(fold: ClassifierFold) -> None:
    assert hears(fold.network) and not hears(FuzzyArt({}))
    seen = [observation(0, 0, None), observation(1, 0, 4), observation(2, 0, 8), observation(3, 1, None)]
    for each in seen:
        fold.observe(each)
        fold.observe(each)  # again: nothing is heard twice
    assert network(fold).heard == [None, 4, 8, None]


def test_from_the_journal_it_hears_the_same(fold: ClassifierFold) -> None:
    steps = tuple(
        JournalStep(step=n, force_n=FELT[0], torque_nm=FELT[1], state=0, action=action, policy_version=0, reward=0.0)
        for n, action in enumerate((4, 8, 2))
    )
    fold.replay(JournalEpisode(run=RUN, episode=0, first_decision=0, steps=steps, summary=None))
    assert network(fold).heard == [None, 4, 8]


def test_it_is_given_the_torque_at_the_point_and_passes_on_what_was_read(fold: ClassifierFold) -> None:
    force_n, torque_nm = (2.0, -3.0, -1.0), (0.5, 0.25, 0.125)
    state: State = fold.observe(replace(observation(0, 0, None), force_n=force_n, torque_nm=torque_nm))
    (vector,) = network(fold).vectors
    assert vector == (force_n, (pytest.approx(0.5 - 0.3), pytest.approx(0.25 - 0.2), 0.125))
    assert (state.force_n, state.torque_nm) == (force_n, torque_nm)
    before = network(fold).digest()
    assert fold.classify(force_n, torque_nm).state == state.state
    assert network(fold).digest() == before
