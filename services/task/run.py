"""One run of the task, and where the task stands in it."""

from __future__ import annotations

from contextlib import suppress

from services.bus.service import Service
from services.rules.entries import reward_in
from services.rules.skill import NamedSkill
from services.task.insertion import Insertion
from services.task.journal import Journal, put_and_confirm, read
from services.task.swaps import Swaps
from services.wire.definition import Definition
from services.wire.definition_file import definition_sha256, run_id
from services.wire.errors import NoAnswerError
from services.wire.keys import SKILL, name_of
from services.wire.messages import Experiment, Home, JournalEpisode, Reward, RunRecord, Skill


class TaskRun:
    """A run of a definition with a seed and, where there is one, a skill that it begins with."""

    def __init__(self, service: Service, definition: Definition, seed: int, skill: NamedSkill | None) -> None:
        self._service = service
        self.skill = skill
        self.record = RunRecord(
            run=run_id(definition, seed, None if skill is None else skill.sha256),
            seed=seed,
            definition=definition,
            definition_sha256=definition_sha256(definition),
            skill_sha256=None if skill is None else skill.sha256,
            contract_sha256=service.contract,
        )
        self.name = self.record.run
        self.insertion = Insertion(definition, self.name, seed)
        if skill is not None:
            self.insertion.expect_states(skill.states)
        self.journal = Journal(service, self.record)
        self.swaps = Swaps(service, self.record)
        self.done = 0
        self.begun = 1
        """Episodes that may have begun, here or in an earlier process: no swap can be made in them any more."""
        self.decisions = 0
        self.first_version = self.version = 0 if skill is None else skill.version
        """Policy version that the run began with, and the last one seen."""
        self.newest: JournalEpisode | None = None
        """The journal's last entry until the first episode of this process begins."""
        self.last_reward: Reward | None = None

    def resume(self) -> bool:
        """Make the store know the run and find its place in the journal; False when stopped meanwhile.

        Waits for the store as long as it takes. Raises CellError when the store knows the run under another contract.
        """
        if not self._keep_skill():
            return False
        place, going_on = self.journal.resume()
        newest = place.newest
        self.swaps.resume(place.swaps)
        if newest is not None and newest.summary is not None:
            self.done = newest.episode + 1
            self.begun = self.done + 1
            self.decisions = newest.first_decision + len(newest.steps)
            self.insertion.expect_states(newest.summary.states)
            self.newest = newest
            self.last_reward = _terminal_reward(newest)
            self._service.log.info("run %s goes on with episode %d", self.name, self.done)
        elif going_on and self.skill is not None:
            self._service.log.info("run %s begins with skill %s", self.name, self.skill.sha256[:12])
        return going_on

    def begin(self) -> Home | None:
        """Begin the next episode: return where to put the peg, or None when stopped.

        Waits until the store has the swaps that are made by then, as long as it takes.
        """
        self.begun = self.done + 1  # before waiting: what is asked for meanwhile is for the episode after it
        if not self.swaps.settle():
            return None
        self.newest = None
        return self.insertion.home(self.done, self.decisions, self.swaps.confirmed)

    def experiment(self, episodes: int) -> Experiment:
        """Return what runs, for ``episodes`` episodes, and how far it is."""
        record = self.record
        return Experiment(
            run=self.name,
            seed=record.seed,
            definition=record.definition,
            definition_sha256=record.definition_sha256,
            skill_sha256=record.skill_sha256,
            first_policy_version=self.first_version,
            episodes=episodes,
            episodes_done=self.done,
            decisions=self.decisions,
            phase=self._service.phase,
            swaps=self.swaps.confirmed,
        )

    def _keep_skill(self) -> bool:
        """See to it that the store has the skill under its name, where workers look for it; False when stopped."""
        if self.skill is None:
            return True
        name = name_of(SKILL, sha256=self.skill.sha256)
        with suppress(NoAnswerError):
            if read(self._service, name, Skill) == self.skill.skill:
                return True
        puts = ((self._service.keys.skill(self.skill.sha256), self.skill.skill),)
        return put_and_confirm(self._service, puts, name)


def _terminal_reward(entry: JournalEpisode) -> Reward | None:
    """Return the last reward of a finished episode, or None when nothing was decided in it."""
    last = entry.steps[-1] if entry.steps else None
    if last is None or last.reward is None or entry.summary is None:
        return None
    return reward_in(entry, len(entry.steps) - 1, last.reward)
