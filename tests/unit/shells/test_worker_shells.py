"""The classifier's shell, and what both workers do when the task takes up another run."""

from __future__ import annotations

from functools import partial
from typing import Any

from msgspec.structs import replace

from services.agent import service as agent_service
from services.bus.testing import FakeService
from services.bus.worker import CHECKPOINT_EVERY
from services.classifier.service import work
from services.wire.keys import CLASSIFIER_STATES, CLASSIFY, EXPERIMENT, HEARTBEAT, OBSERVATION, TASK_STEPS
from services.wire.messages import Checkpoint, Classified, ClassifierStates, Refusal, State


def play(scene: Any, service: FakeService, first: int, last: int) -> None:
    """Publish some observations, a tenth of a second apart."""
    for decision in range(first, last):
        observed = scene.observations[decision]
        service.later(
            0.1 * (decision - first + 1), partial(service.hear, OBSERVATION, observed, scene.sessions["task"])
        )


def test_it_classifies_as_the_fold_does_and_repeats_what_it_has_said(scene: Any) -> None:
    classifier = scene.service("classifier")
    play(scene, classifier, 0, 8)
    classifier.later(1.0, partial(play, scene, classifier, 6, 9))
    classifier.run_for(work, 3.0)
    assert classifier.published(State) == [*scene.states[:8], *scene.states[6:9]]
    assert not classifier.refused


def test_what_it_missed_it_fetches_and_what_nobody_has_it_refuses(scene: Any) -> None:
    classifier = scene.service("classifier")
    classifier.later(0.5, lambda: scene.stand(classifier.bus, 4, 11))
    classifier.later(0.6, lambda: play(scene, classifier, 11, 12))
    classifier.later(1.0, lambda: classifier.bus.answers.pop(TASK_STEPS))
    classifier.later(1.1, lambda: play(scene, classifier, 20, 21))
    classifier.run_for(work, 2.0)
    assert classifier.published(State) == [scene.states[11]]
    assert classifier.refused == {"NoAnswerError": 1}


def test_another_run_and_another_sender_are_refused(scene: Any) -> None:
    classifier = scene.service("classifier")
    observed = scene.observations[0]
    classifier.later(0.1, lambda: classifier.hear(OBSERVATION, observed))
    classifier.later(0.2, lambda: classifier.hear(OBSERVATION, observed, scene.sessions["agent"]))
    other = replace(observed, run="other-s1")
    classifier.later(0.3, lambda: classifier.hear(OBSERVATION, other, scene.sessions["task"]))
    classifier.run_for(work, 1.0)
    assert classifier.refused == {"StrangerError": 2, "ForeignRunError": 1}
    assert classifier.published(State) == []


def test_it_starts_again_from_checkpoint_and_journal(scene: Any) -> None:
    bus = scene.bus()
    first = scene.service("classifier", bus)
    half = sum(len(entry.steps) for entry in scene.journal[: CHECKPOINT_EVERY + 3])
    play(scene, first, 0, half)
    first.run_for(work, 30.0)
    assert {checkpoint.episode for checkpoint in first.published(Checkpoint)} == {CHECKPOINT_EVERY}
    scene.stand(bus, CHECKPOINT_EVERY + 3)
    bus.tokens.clear()
    again = scene.service("classifier", bus)
    said = len(again.published(State))
    play(scene, again, half, half + 4)
    again.run_for(work, 2.0)
    assert again.published(State)[said:] == scene.states[half : half + 4]


def test_a_damaged_checkpoint_is_never_taken_for_a_memory(scene: Any) -> None:
    bus = scene.bus(2)
    classifier = scene.service("classifier", bus)
    bad = Checkpoint(
        run=scene.run, service="classifier", episode=2, decisions=4, contract_sha256=classifier.contract, snapshot={}
    )
    classifier.store(scene.keys.checkpoint_latest(scene.run, "classifier"), bad)
    classifier.later(0.5, lambda: play(scene, classifier, 4, 6))
    classifier.run_for(work, 2.0)
    assert classifier.published(State) == scene.states[4:6], "it comes from the journal"


def test_when_the_task_takes_up_another_run_both_workers_load_its_memory(scene: Any) -> None:
    other = "0123456789abcdef-s9"
    for name, do in (("classifier", work), ("agent", agent_service.work)):
        worker = scene.service(name)
        store = FakeService("store", worker.bus, zid=scene.sessions["store"])

        def change(worker: FakeService = worker, store: FakeService = store) -> None:
            store.store(scene.keys.run_record(other), replace(scene.record(), run=other))
            worker.bus.answers[EXPERIMENT] = scene.experiment(run=other)
            worker.bus.answers[TASK_STEPS] = replace(scene.under_way(0), run=other)
            alive = replace(worker.status(), service="task", instance="1-x", run=other, phase="running")
            worker.hear(HEARTBEAT.replace("<service>", "task"), alive, scene.sessions["task"])

        worker.later(0.5, change)
        worker.run_for(do, 3.0)
        assert worker.run == other
        assert worker.phase == "running"


def test_queries_are_answered_and_bad_ones_refused_in_words(scene: Any) -> None:
    classifier = scene.service("classifier")
    play(scene, classifier, 0, 4)
    answers: list[Any] = []

    def ask() -> None:
        answers.append(classifier.answer_to(ClassifierStates, CLASSIFIER_STATES))
        answers.append(classifier.answer_to(Classified, f"{CLASSIFY}?ft=1,0.2,-2,0,0.02,0"))
        answers.append(classifier.answer_to(Classified, f"{CLASSIFY}?ft=1,2,3"))
        answers.append(classifier.answer_to(Classified, f"{CLASSIFY}?ft=nan,0,0,0,0,0"))

    classifier.later(1.0, ask)
    classifier.run_for(work, 2.0)
    states, classified, short, strange = answers
    assert isinstance(states, ClassifierStates) and states.decisions == 4
    assert isinstance(classified, Classified) and classified.state is not None
    assert isinstance(short, Refusal) and "six numbers" in short.message
    assert isinstance(strange, Refusal) and "'nan'" in strange.message
