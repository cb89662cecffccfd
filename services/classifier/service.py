"""The classifier on the bus: observations in, contact states out."""

from __future__ import annotations

from services.bus.answers import Request, ft_vector
from services.bus.service import Options, Service
from services.bus.worker import Worker
from services.classifier.fold import ClassifierFold
from services.wire.errors import BadPayloadError
from services.wire.keys import CLASSIFIER_STATES, CLASSIFY, OBSERVATION, STATE
from services.wire.messages import Classified, ClassifierStates, Experiment, Observation, State


def blank(experiment: Experiment) -> ClassifierFold:
    """Return the memory of a classifier that has seen nothing."""
    return ClassifierFold(experiment.definition, experiment.run, experiment.swaps)


def serve(options: Options) -> None:
    """Run the classifier until it is stopped."""
    with Service("classifier", options) as service:
        service.claim()
        work(service)


def work(service: Service) -> None:
    """Be the classifier of a cell until stopped."""
    worker: Worker[ClassifierFold] = Worker(service, blank)
    if not worker.load():
        return
    publish = service.publisher(STATE, State)

    def observe(observation: Observation) -> None:
        def apply() -> None:
            fold = worker.fold
            # Only of a complete memory: with observations missing it would not be what the key says.
            complete = (observation.run, observation.decision) == (fold.run, fold.decisions)
            if complete and observation.episode > fold.episode:
                worker.checkpoint_before(observation.episode)
            publish(fold.observe(observation))

        worker.catching_up(apply)

    service.subscribe(OBSERVATION, Observation, observe, "task")
    service.answer(CLASSIFIER_STATES, lambda _: states(worker))
    service.answer(CLASSIFY, lambda request: classify(worker, request), "ft")
    worker.loop()


def states(worker: Worker[ClassifierFold]) -> ClassifierStates:
    """Answer ``classifier/states``."""
    fold = worker.fold
    return ClassifierStates(
        run=fold.run,
        decisions=fold.decisions,
        states=fold.network.states,
        encoding=fold.network.encoding,
        prototypes=tuple(tuple(row) for row in fold.network.prototypes.tolist()),
        counts=tuple(fold.network.counts.tolist()),
        digest=fold.network.digest(),
    )


def classify(worker: Worker[ClassifierFold], request: Request) -> Classified:
    """Answer ``classifier/classify?ft=fx,fy,fz,tx,ty,tz``; nothing is learnt. Raises BadPayloadError."""
    fold = worker.fold
    force_n, torque_nm = ft_vector(request.parameters.get("ft", ""))
    try:
        classification = fold.classify(force_n, torque_nm)
    except ValueError as error:
        raise BadPayloadError(f"ft: {error}") from error
    state = classification.state if classification.state >= 0 else None
    return Classified(
        run=fold.run, decisions=fold.decisions, states=classification.states, state=state, match=classification.match
    )
