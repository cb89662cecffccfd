"""One run in one process: the pure cores of sim, task, classifier and agent, joined by plain calls.

It takes the same steps as the distributed run, so it ends in the same bytes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from experiments.lab.guided import make
from experiments.lab.remembered_world import RememberedWorld
from experiments.lab.skills import skill_from
from services.agent.fold import AgentFold
from services.classifier.fold import ClassifierFold
from services.rules.skill import NamedSkill
from services.sim.cell import SimulatedCell
from services.task.insertion import Insertion
from services.wire.codec import contract_sha256
from services.wire.definition import Definition
from services.wire.definition_file import definition_sha256, run_id
from services.wire.messages import EpisodeSummary, Home, Move, Observation, RunRecord, Swap


class InProcessRun:
    """A run of one definition with one seed, that may begin with a learnt skill."""

    def __init__(
        self,
        definition: Definition,
        seed: int,
        *,
        remember: bool = False,
        skill: NamedSkill | None = None,
        swaps: Sequence[Swap] = (),
    ) -> None:
        """Prepare the run; ``remember`` answers motions that were simulated before from memory, with the same bytes.

        ``skill`` has to fit the definition, see ``services.rules.skill.fits``; ``swaps`` are as
        ``services.rules.swaps.planned`` gives them.
        """
        self._swaps = tuple(swaps)
        self._began_with = skill
        sha256 = None if skill is None else skill.sha256
        self.run = run_id(definition, seed, sha256)
        self.record = RunRecord(
            run=self.run,
            seed=seed,
            definition=definition,
            definition_sha256=definition_sha256(definition),
            skill_sha256=sha256,
            contract_sha256=contract_sha256(),
        )
        world = RememberedWorld(definition) if remember else None
        self.cell = SimulatedCell(definition, self.run, seed, world)
        self.task = Insertion(definition, self.run, seed)
        self.classifier = ClassifierFold(definition, self.run, swaps)
        self.agent = AgentFold(definition, self.run, seed, swaps)
        if skill is not None:
            self.classifier.begin_with(skill.skill)
            self.agent.begin_with(skill.skill)
            self.task.expect_states(skill.states)
        self.episodes_done = 0
        self.decisions = 0

    def episodes(self, count: int) -> Iterator[EpisodeSummary]:
        """Run ``count`` more episodes, one at a time."""
        for _ in range(count):
            yield self._episode()

    def learnt(self) -> NamedSkill:
        """Return what has been learnt so far, the skill that it began with included."""
        return skill_from(self.record, self.episodes_done, self.agent, self.classifier, self._began_with)

    def _episode(self) -> EpisodeSummary:
        motion: Home | Move = self.task.home(self.episodes_done, self.decisions, self._swaps)
        while True:
            reached = make(self.task, self.cell, motion)
            if reached.reward is not None:
                self.agent.reward(reached.reward)
            if isinstance(reached.then, EpisodeSummary):
                self.episodes_done += 1
                self.decisions += reached.then.decisions
                return reached.then
            motion = self._decide(reached.then)

    def _decide(self, observation: Observation) -> Move:
        """Return the motion that the workers decide for."""
        return self.task.act(self.agent.decide(self.classifier.observe(observation)))
