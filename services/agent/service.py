"""The agent on the bus: contact states and rewards in, actions out."""

from __future__ import annotations

from msgspec.structs import replace

from services.agent.fold import AgentFold
from services.agent.learning import MAX_STATES
from services.bus.answers import Asked, Request, ft_vector, state_number
from services.bus.relay import Relay
from services.bus.service import Options, Service
from services.bus.worker import Worker
from services.rules.plugins import feels, proposes
from services.wire.actions import action_names
from services.wire.errors import BadPayloadError, RefusedError
from services.wire.keys import ACTION, CLASSIFY, POLICY, Q_TABLE, REWARD, STATE
from services.wire.messages import Action, Classified, Experiment, Force, PolicyAnswer, QTable, Reward, State, Torque

CLASSIFIER_WITHIN_S = 1.0
"""How long the classifier has for its part of a policy query: less than any client waits for ours."""


def blank(experiment: Experiment) -> AgentFold:
    """Return the memory of an agent that has decided nothing."""
    return AgentFold(experiment.definition, experiment.run, experiment.seed, experiment.swaps)


def serve(options: Options) -> None:
    """Run the agent until it is stopped."""
    with Service("agent", options) as service:
        service.claim()
        work(service)


def work(service: Service) -> None:
    """Be the agent of a cell until stopped."""
    worker: Worker[AgentFold] = Worker(service, blank)
    if not worker.load():
        return
    shell = AgentShell(service, worker)
    service.subscribe(STATE, State, shell.on_state, "classifier")
    service.subscribe(REWARD, Reward, shell.on_reward, "task")
    service.answer(Q_TABLE, lambda _: q_table(worker))
    service.answer_later(POLICY, shell.on_policy, "state", "ft")
    worker.loop()
    shell.classifier.close()


class AgentShell:
    """Joins states and rewards, which come from two services and so in either order."""

    def __init__(self, service: Service, worker: Worker[AgentFold]) -> None:
        self._worker = worker
        self.classifier = Relay(service, CLASSIFY, Classified, CLASSIFIER_WITHIN_S)
        """Policy queries that wait for the state of an F/T vector."""
        self._publish = service.publisher(ACTION, Action)
        self._early: State | None = None
        """A state whose predecessor's reward is still on its way."""

    def on_state(self, state: State) -> None:
        """Decide about a state, or keep it until the reward before it has come."""
        fold = self._worker.fold
        if state.run == fold.run and state.decision == fold.decisions and fold.rewards < fold.decisions:
            self._early = state
            return
        self._worker.catching_up(lambda: self._publish(self._worker.fold.decide(state)))

    def on_reward(self, reward: Reward) -> None:
        """Take a reward, and decide about the state that waited for it."""
        self._worker.catching_up(lambda: self._take(reward))
        early, self._early = self._early, None
        if early is not None:
            self.on_state(early)

    def on_policy(self, asked: Asked, request: Request) -> None:
        """Answer ``agent/policy``: a state at once, an F/T vector when the classifier has said which state it is."""
        given = request.parameters
        state, ft = given.get("state"), given.get("ft")
        if (state is None) == (ft is None):
            forms = f"{POLICY}?state=7 or {POLICY}?ft=fx,fy,fz,tx,ty,tz"
            raise BadPayloadError(f"policy: expected {forms}, got {'neither' if state is None else 'both'}")
        if state is not None:
            asked.reply(policy(self._worker, state_number(state), None))
            return
        force_n, torque_nm = ft_vector(ft or "")
        text = ",".join(repr(component) for component in (*force_n, *torque_nm))
        self.classifier.answer(asked, f"ft={text}", lambda classified: self._policy_of(classified, force_n, torque_nm))

    def _policy_of(self, classified: Classified, force_n: Force, torque_nm: Torque) -> PolicyAnswer:
        run = self._worker.fold.run
        if classified.run != run:
            raise RefusedError(f"{CLASSIFY}: expected one of run {run}, got one of {classified.run}")
        if (proposed := proposal(self._worker.fold, classified, force_n, torque_nm)) is not None:
            return proposed
        answer = policy(self._worker, classified.state, classified.match)
        return with_opinion(self._worker.fold, answer, force_n, torque_nm)

    def _take(self, reward: Reward) -> None:
        if self._worker.fold.reward(reward) and reward.terminal is not None:
            self._worker.checkpoint_before(reward.episode + 1)


def q_table(worker: Worker[AgentFold]) -> QTable:
    """Answer ``agent/q_table``: with no rows where moves are proposed, as there are no values of actions."""
    fold, learner = worker.fold, worker.fold.learner
    if proposes(learner):
        return QTable(
            run=fold.run,
            decisions=fold.decisions,
            policy_version=fold.version,
            actions=(),
            q=(),
            visits=(),
            best_action=(),
            digest=learner.digest(),
            partial=True,
        )
    return QTable(
        run=fold.run,
        decisions=fold.decisions,
        policy_version=fold.version,
        actions=action_names(worker.experiment.definition.moves),
        q=tuple(tuple(row) for row in learner.q.tolist()),
        visits=tuple(tuple(row) for row in learner.visits.tolist()),
        best_action=tuple(learner.best_action(state) for state in range(learner.states)),
        digest=learner.digest(),
        partial=feels(learner),
    )


def policy(worker: Worker[AgentFold], state: int | None, match: float | None) -> PolicyAnswer:
    """Return what the agent would do in a state; None is one that nobody has felt yet. Raises BadPayloadError."""
    fold, learner = worker.fold, worker.fold.learner
    if proposes(learner):
        raise BadPayloadError(f"state: expected {POLICY}?ft=..., as moves are proposed by what is felt, got a state")
    row = learner.states if state is None else state
    if row >= MAX_STATES:
        raise BadPayloadError(f"state: expected one below {MAX_STATES}, got {row}")
    in_table = row < learner.states
    actions = action_names(worker.experiment.definition.moves)
    values = learner.values(row)
    return PolicyAnswer(
        run=fold.run,
        policy_version=fold.version,
        state=state,
        match=match,
        known=in_table,
        actions=actions,
        values=tuple(values.tolist()),
        probabilities=tuple(learner.chances(row, fold.episode).tolist()),
        visits=tuple(learner.visits[row].tolist()) if in_table else (0,) * len(actions),
        best_action=learner.best_action(row),
        partial=feels(learner),
    )


def proposal(fold: AgentFold, classified: Classified, force_n: Force, torque_nm: Torque) -> PolicyAnswer | None:
    """Return the move that a learner of moves would make at a sample; None of another. Raises BadPayloadError."""
    try:
        proposed = fold.proposal(
            classified.states if classified.state is None else classified.state, force_n, torque_nm
        )
    except ValueError as error:
        raise BadPayloadError(f"ft: {error}") from error
    if proposed is None:
        return None
    return PolicyAnswer(
        run=fold.run,
        policy_version=fold.version,
        state=classified.state,
        match=classified.match,
        known=fold.version > 0,
        actions=(),
        values=(),
        probabilities=(),
        visits=(),
        best_action=0,
        increment=proposed.increment,
        spread=proposed.spread,
        worth=proposed.worth,
    )


def with_opinion(fold: AgentFold, answer: PolicyAnswer, force_n: Force, torque_nm: Torque) -> PolicyAnswer:
    """Return an answer with what a learner that feels thinks at a sample, and why. Raises BadPayloadError."""
    state = fold.learner.states if answer.state is None else answer.state
    try:
        opinion = fold.opinion(state, force_n, torque_nm)
    except ValueError as error:
        raise BadPayloadError(f"ft: {error}") from error
    if opinion is None:
        return answer
    return replace(
        answer,
        values=tuple(opinion.values.tolist()),
        probabilities=tuple(opinion.chances.tolist()),
        best_action=int(opinion.values.argmax()),
        partial=False,
        model=tuple(opinion.model.tolist()),
        table=tuple(opinion.table.tolist()),
        deviations=tuple(opinion.deviation.tolist()),
    )
