"""The agent on the bus: contact states and rewards in, actions out."""

from __future__ import annotations

from services.agent.fold import AgentFold
from services.agent.policies import probabilities
from services.wire.actions import action_names
from services.wire.answers import Request
from services.wire.errors import BadPayloadError
from services.wire.keys import ACTION, POLICY, Q_TABLE, REWARD, STATE
from services.wire.messages import Action, Experiment, PolicyAnswer, QTable, Reward, State
from services.wire.service import Options, Service
from services.wire.worker import Worker


def blank(experiment: Experiment) -> AgentFold:
    """Return the memory of an agent that has decided nothing."""
    return AgentFold(experiment.definition, experiment.run, experiment.seed)


def serve(options: Options) -> None:
    """Run the agent until it is stopped."""
    with Service("agent", options) as service:
        service.claim()
        worker: Worker[AgentFold] = Worker(service, blank)
        if not worker.load():
            return
        shell = AgentShell(service, worker)
        service.subscribe(STATE, State, shell.on_state, "classifier")
        service.subscribe(REWARD, Reward, shell.on_reward, "task")
        service.answer(Q_TABLE, lambda _: q_table(worker))
        service.answer(POLICY, lambda request: policy(worker, request), "state")
        worker.loop()


class AgentShell:
    """Joins states and rewards, which come from two services and so in either order."""

    def __init__(self, service: Service, worker: Worker[AgentFold]) -> None:
        self._worker = worker
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

    def _take(self, reward: Reward) -> None:
        if self._worker.fold.reward(reward) and reward.terminal is not None:
            self._worker.checkpoint_before(reward.episode + 1)


def q_table(worker: Worker[AgentFold]) -> QTable:
    """Answer ``agent/q_table``."""
    fold, learner = worker.fold, worker.fold.learner
    return QTable(
        run=fold.run,
        decisions=fold.decisions,
        policy_version=learner.version,
        actions=action_names(worker.experiment.definition.moves),
        q=tuple(tuple(row) for row in learner.q.tolist()),
        visits=tuple(tuple(row) for row in learner.visits.tolist()),
        best_action=tuple(learner.best_action(state) for state in range(learner.states)),
        digest=learner.digest(),
    )


def policy(worker: Worker[AgentFold], request: Request) -> PolicyAnswer:
    """Answer ``agent/policy?state=N``."""
    fold, learner = worker.fold, worker.fold.learner
    text = request.parameters.get("state", "")
    if not (text.isascii() and text.isdigit() and len(text) < 7):
        raise BadPayloadError(f"state: expected a state number, as in {POLICY}?state=7, got {text[:20]!r}")
    state = int(text)
    known = state < learner.states
    actions = action_names(worker.experiment.definition.moves)
    values = learner.q[state] if known else learner.values(state)
    return PolicyAnswer(
        run=fold.run,
        policy_version=learner.version,
        state=state,
        match=None,
        known=known,
        actions=actions,
        values=tuple(values.tolist()),
        probabilities=tuple(probabilities(values, worker.experiment.definition.policy, fold.episode).tolist()),
        visits=tuple(learner.visits[state].tolist()) if known else (0,) * len(actions),
        best_action=learner.best_action(state),
    )
