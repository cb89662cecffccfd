"""The task on the bus: it drives the loop, keeps the journal, and waits for whoever is missing."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial

from services.bus.answers import Request
from services.bus.inbox import HEARTBEAT_S
from services.bus.service import Options, Service
from services.bus.worker import NO_MEMORY
from services.rules.forces import TareError
from services.rules.swaps import planned
from services.task.robot import Robot
from services.task.run import TaskRun
from services.task.skills import Skills
from services.wire.definition import Definition
from services.wire.errors import DivergedError, ForeignRunError, GapError
from services.wire.keys import (
    ACTION,
    EPISODE,
    EXPERIMENT,
    HEARTBEAT,
    OBSERVATION,
    REWARD,
    SWAP,
    TASK_STEPS,
    WORKERS,
    name_of,
)
from services.wire.messages import Action, Alive, EpisodeSummary, Home, Move, Observation, Reward, Swapped, SwapRequest

REPEAT_S = 1.0
"""An observation that nobody has acted on is published again after this; it is sooner when a worker comes alive."""


def serve(options: Options, definition: Definition, seed: int, episodes: int, swaps: Sequence[str] = ()) -> None:
    """Run ``episodes`` episodes of a definition with a seed, going on where the store's journal ends.

    ``swaps`` are those that the run has from its beginning, in the words of ``services.rules.swaps.spec``. In a fleet,
    the first cell takes the seed, the second the next one, and so on.
    """
    with Service("task", options) as service:
        service.claim()
        work(service, definition, seed + service.place, episodes, swaps)


def work(service: Service, definition: Definition, seed: int, episodes: int, swaps: Sequence[str] = ()) -> None:
    """Be the task of a cell until stopped."""
    shell = TaskShell(service, definition, seed, episodes, swaps)
    if not shell.resume():
        return
    service.watch(shell.on_alive)
    service.ready()
    shell.run_episodes()


class TaskShell:
    """The task: it works on the run that definition, seed and the skill in the store determine."""

    def __init__(
        self, service: Service, definition: Definition, seed: int, episodes: int, swaps: Sequence[str] = ()
    ) -> None:
        self._service = service
        self._planned = swaps
        self._seed = seed
        self._episodes = episodes
        self._definition = definition
        self._skills = Skills(service, definition)
        self._now = TaskRun(service, definition, seed, None)
        self._robot = Robot(service, definition.sensor, lambda packet: self._now.insertion.tare_again(packet))
        self._publish_observation = service.publisher(OBSERVATION, Observation)
        self._publish_reward = service.publisher(REWARD, Reward, with_next=True)  # an observation, as a rule
        self._publish_episode = service.publisher(EPISODE, EpisodeSummary)
        self._alive: set[str] = set()
        self._came = False
        self._blank_until: dict[str, float] = {}
        """Workers without a memory, and until when that is believed without another heartbeat [s]."""
        self._asked: Observation | None = None
        """The observation that was published last, and in ``_action`` the answer to it."""
        self._action: Action | None = None
        service.subscribe(ACTION, Action, self._on_action, "agent")
        for name in WORKERS:
            service.subscribe(name_of(HEARTBEAT, service=name), Alive, partial(self._on_worker, name), name)

    def resume(self) -> bool:
        """Find out which run it is and where it stands, and say so; False when stopped meanwhile.

        Waits for the store as long as it takes.
        """
        chosen = self._skills.at_start(self._now.record)
        if chosen is None or not self._take_up(TaskRun(self._service, self._definition, self._seed, chosen.skill)):
            return False
        self._service.answer(EXPERIMENT, lambda _: self._now.experiment(self._episodes))
        self._service.answer(SWAP, self._on_swap)
        self._service.answer(TASK_STEPS, lambda _: self._now.newest or self._now.insertion.record())
        return True

    def run_episodes(self) -> None:
        """Run what is left, then serve queries until stopped; when the store's skill changes, the run is another."""
        service = self._service
        while not service.stopping:
            chosen = self._skills.between_episodes(self._now.skill)
            if chosen is not None:
                following = TaskRun(service, self._definition, self._seed, chosen.skill)
                if not self._take_up(following):
                    return
            if self._now.done >= self._episodes:
                self._rest()
            elif not self._advance():
                return

    def _take_up(self, run: TaskRun) -> bool:
        """Work on a run from where its journal ends; False when stopped meanwhile."""
        if not run.resume():
            return False
        swaps = planned(run.name, self._definition, self._planned, self._episodes)
        run.swaps.plan(swaps, run.begun)
        self._now, self._asked, self._action = run, None, None
        # What an earlier process of this run has seen counts as well.
        steps = () if run.newest is None else run.newest.steps
        run.version = max([run.version, *(step.policy_version or 0 for step in steps)])
        self._service.run, self._service.phase = run.name, "running"
        return True

    def _advance(self) -> bool:
        """Run one episode and store it; False when stopped meanwhile."""
        now, service = self._now, self._service
        home = now.begin()
        summary = None if home is None else self._episode(home)
        if summary is None or not now.journal.append(now.insertion.record()):
            return False
        now.done += 1
        now.decisions += summary.decisions
        service.phase = "running"
        self._publish_episode(summary)
        return True

    def _rest(self) -> None:
        """Wait a moment after the end of the run."""
        self._service.phase = "finished"
        # The agent may have missed the very last reward; nothing follows that would make it ask.
        if self._now.last_reward is not None:
            self._publish_reward(self._now.last_reward)
        self._service.work_until(lambda: self._skills.noticed, REPEAT_S)

    def on_alive(self, name: str, alive: bool) -> None:
        """Note who came and went; what a newcomer missed is sent again at once."""
        if alive:
            self._alive.add(name)
            self._came = True
        else:
            self._alive.discard(name)
            self._service.log.warning("%s is gone", name)

    def _episode(self, home: Home) -> EpisodeSummary | None:
        """Run the episode that begins there; None when stopped before its end."""
        now, insertion = self._now, self._now.insertion
        motion: Home | Move = home
        while True:
            felt_after = self._robot.go(motion)
            if felt_after is None:
                return None
            moved, packet = felt_after
            try:
                felt = insertion.sense(moved, packet)
            except TareError as error:
                self._robot.wait(str(error))
                continue
            if felt.reward is not None:
                now.last_reward = felt.reward
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
            service.phase = f"waiting for {self._missing()}"
            service.complain(service.phase)
            if self._now.last_reward is not None:
                self._publish_reward(self._now.last_reward)
        return None

    def _missing(self) -> str:
        """Return who keeps an observation from being acted on, and why as far as they have said so."""
        now = time.monotonic()
        blank = {name for name, until in self._blank_until.items() if now < until}
        missing = [name for name in WORKERS if name in blank or name not in self._alive]
        words = [f"{name} (no checkpoint)" if name in blank else name for name in sorted(missing)]
        return " and ".join(words) or "classifier or agent (no action)"

    def _on_swap(self, request: Request) -> Swapped:
        now, asked = self._now, request.message(SwapRequest)
        return now.swaps.ask(asked, now.begun, self._episodes)

    def _on_worker(self, name: str, worker: Alive) -> None:
        """Note whether a worker says that it has no memory to work with; what it says holds for three heartbeats."""
        blank = worker.phase.startswith(NO_MEMORY)
        self._blank_until[name] = time.monotonic() + 3.0 * HEARTBEAT_S if blank else 0.0

    def _on_action(self, action: Action) -> None:
        now = self._now
        if action.run != now.name:
            raise ForeignRunError(f"action: expected run {now.name}, got {action.run}")
        asked = self._asked
        if asked is None or action.decision < asked.decision or (action.decision == asked.decision and self._action):
            return  # an answer given twice
        if action.decision > asked.decision:
            raise GapError(f"action: expected decision {asked.decision}, got {action.decision}")
        if (action.episode, action.step, action.swaps) != (asked.episode, asked.step, asked.swaps):
            expected, got = (f"{message.episode}, {message.step}, {message.swaps}" for message in (asked, action))
            raise DivergedError(f"action: expected episode, step and swaps {expected}, got {got}")
        if complaint := now.insertion.complaint(action):
            raise DivergedError(complaint)
        highest = now.first_version + action.decision
        if not now.version <= action.policy_version <= highest:
            expected = f"{now.version} to {highest}"
            raise DivergedError(f"action: expected a policy of version {expected}, got {action.policy_version}")
        now.version = action.policy_version
        self._action = action
