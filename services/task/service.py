"""The task on the bus: it drives the loop, keeps the journal, and waits for whoever is missing."""

from __future__ import annotations

from services.task.insertion import Insertion
from services.task.journal import Journal
from services.task.robot import Robot
from services.wire.definition import Definition
from services.wire.definition_file import definition_sha256, run_id
from services.wire.errors import DivergedError, ForeignRunError, GapError
from services.wire.keys import ACTION, EPISODE, EXPERIMENT, OBSERVATION, REWARD, TASK_STEPS
from services.wire.messages import (
    Action,
    EpisodeSummary,
    Experiment,
    Home,
    JournalEpisode,
    Move,
    Observation,
    Reward,
    RunRecord,
)
from services.wire.service import Options, Service

REPEAT_S = 1.0
"""An observation that nobody has acted on is published again after this; it is sooner when a worker comes alive."""


def serve(options: Options, definition: Definition, seed: int, episodes: int) -> None:
    """Run ``episodes`` episodes of a definition with a seed, going on where the store's journal ends."""
    with Service("task", options) as service:
        service.claim()
        shell = TaskShell(service, definition, seed, episodes)
        if not shell.resume():
            return
        service.watch(shell.on_alive)
        service.ready()
        shell.run_episodes()


class TaskShell:
    """One run of the task."""

    def __init__(self, service: Service, definition: Definition, seed: int, episodes: int) -> None:
        self._service = service
        self._seed = seed
        self._episodes = episodes
        self._definition = definition
        self._sha256 = definition_sha256(definition)
        self._run = service.run = run_id(definition, seed)
        self._insertion = Insertion(definition, self._run, seed)
        self._journal = Journal(
            service,
            RunRecord(
                run=self._run,
                seed=seed,
                definition=definition,
                definition_sha256=self._sha256,
                skill_sha256=None,
                contract_sha256=service.contract,
            ),
        )
        self._robot = Robot(service)
        self._publish_observation = service.publisher(OBSERVATION, Observation)
        self._publish_reward = service.publisher(REWARD, Reward)
        self._publish_episode = service.publisher(EPISODE, EpisodeSummary)
        self._done = 0
        self._decisions = 0
        self._policy_version = 0
        self._alive: set[str] = set()
        self._came = False
        self._asked: Observation | None = None
        """The observation that was published last, and in ``_action`` the answer to it."""
        self._action: Action | None = None
        self._last_reward: Reward | None = None
        service.subscribe(ACTION, Action, self._on_action, "agent")
        service.answer(EXPERIMENT, lambda _: self._experiment())
        service.answer(TASK_STEPS, lambda _: self._newest or self._insertion.record())
        self._newest: JournalEpisode | None = None
        """The journal's last entry until the first episode of this process begins."""

    def resume(self) -> bool:
        """Find the run's place in the journal; False when stopped meanwhile."""
        newest, going_on = self._journal.resume()
        if newest is not None and newest.summary is not None:
            self._done = newest.episode + 1
            self._decisions = newest.first_decision + len(newest.steps)
            self._insertion.expect_states(newest.summary.states)
            self._newest = newest
            self._last_reward = _terminal_reward(newest)
            self._service.log.info("run %s goes on with episode %d", self._run, self._done)
        return going_on

    def run_episodes(self) -> None:
        """Run what is left, then serve queries until stopped."""
        service = self._service
        while self._done < self._episodes and not service.stopping:
            summary = self._episode()
            if summary is None or not self._journal.append(self._insertion.record()):
                return
            self._done += 1
            self._decisions += summary.decisions
            service.phase = "running"
            self._publish_episode(summary)
        service.phase = "finished"
        while not service.stopping:
            # The agent may have missed the very last reward; nothing follows that would make it ask.
            if self._last_reward is not None:
                self._publish_reward(self._last_reward)
            service.work_until(lambda: False, REPEAT_S)

    def on_alive(self, name: str, alive: bool) -> None:
        """Note who came and went; what a newcomer missed is sent again at once."""
        (self._alive.add if alive else self._alive.discard)(name)
        self._came = self._came or alive
        if not alive:
            self._service.log.warning("%s is gone", name)

    def _episode(self) -> EpisodeSummary | None:
        """Run one episode; None when stopped before its end."""
        insertion = self._insertion
        motion: Home | Move = insertion.home(self._done, self._decisions)
        self._newest = None
        while True:
            felt_after = self._robot.go(motion)
            if felt_after is None:
                return None
            moved, packet = felt_after
            felt = insertion.feel(moved, packet.force_n[-1], packet.torque_nm[-1])
            if felt.reward is not None:
                self._last_reward = felt.reward
                self._publish_reward(felt.reward)
            if isinstance(felt.then, EpisodeSummary):
                return felt.then
            if isinstance(felt.then, Observation):
                action = self._decide(felt.then)
                if action is None:
                    return None
                motion = insertion.act(action)
            else:
                motion = felt.then

    def _decide(self, observation: Observation) -> Action | None:
        """Publish an observation until the agent has acted on it; None when stopped."""
        service = self._service
        self._asked, self._action = observation, None
        while not service.stopping:
            self._came = False
            self._publish_observation(observation)
            service.work_until(lambda: self._action is not None or self._came, REPEAT_S)
            if self._action is not None:
                service.phase = "running"
                return self._action
            missing = sorted({"classifier", "agent"} - self._alive)
            service.phase = f"waiting for {' and '.join(missing) or 'classifier or agent (no action)'}"
            service.complain(service.phase)
            if self._last_reward is not None:
                self._publish_reward(self._last_reward)
        return None

    def _on_action(self, action: Action) -> None:
        if action.run != self._run:
            raise ForeignRunError(f"action: expected run {self._run}, got {action.run}")
        asked = self._asked
        if asked is None or action.decision < asked.decision or (action.decision == asked.decision and self._action):
            return  # an answer given twice
        if action.decision > asked.decision:
            raise GapError(f"action: expected decision {asked.decision}, got {action.decision}")
        if (action.episode, action.step) != (asked.episode, asked.step):
            expected, got = f"{asked.episode}, {asked.step}", f"{action.episode}, {action.step}"
            raise DivergedError(f"action: expected episode and step {expected}, got {got}")
        if action.action >= self._definition.moves.actions:
            raise DivergedError(f"action: expected one below {self._definition.moves.actions}, got {action.action}")
        if not self._policy_version <= action.policy_version <= action.decision:
            expected = f"{self._policy_version} to {action.decision}"
            raise DivergedError(f"action: expected a policy of version {expected}, got {action.policy_version}")
        self._policy_version = action.policy_version
        self._action = action

    def _experiment(self) -> Experiment:
        return Experiment(
            run=self._run,
            seed=self._seed,
            definition=self._definition,
            definition_sha256=self._sha256,
            skill_sha256=None,
            first_policy_version=0,
            episodes=self._episodes,
            episodes_done=self._done,
            decisions=self._decisions,
            phase=self._service.phase,
        )


def _terminal_reward(entry: JournalEpisode) -> Reward | None:
    """Return the last reward of a finished episode, or None when nothing was decided in it."""
    last = entry.steps[-1] if entry.steps else None
    if last is None or last.reward is None or entry.summary is None:
        return None
    return Reward(
        run=entry.run,
        episode=entry.episode,
        step=last.step,
        decision=entry.first_decision + len(entry.steps) - 1,
        reward=last.reward,
        terminal=entry.summary.outcome,
    )
