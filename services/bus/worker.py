"""A stateless worker: its memory is a fold over the run, loaded from checkpoint and journal, and caught up when behind.

A worker never acts on a blank memory: without an answer from the store, or with a checkpoint or a journal that do not
give the whole of it, it waits, and says so. What it folds is numbered without gaps, so that it notices by itself when
something is missing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Generic, Protocol, TypeVar

from services.bus.service import Service
from services.rules.skill import decode
from services.rules.timeline import Timeline
from services.wire import codec
from services.wire.errors import ContractError, DivergedError, FoldError, ForeignRunError, GapError, NoAnswerError
from services.wire.keys import (
    CHECKPOINT,
    ENTRY,
    EXPERIMENT,
    HEAD,
    HEARTBEAT,
    JOURNAL_BLOCK,
    NEWEST_CHECKPOINT,
    SKILL,
    TASK_STEPS,
    name_of,
)
from services.wire.messages import Alive, Checkpoint, Experiment, JournalEpisode, Skill
from services.wire.text import one_line

CHECKPOINT_EVERY = 20
"""Episodes between checkpoints; what lies after the newest one is replayed from the journal."""
NO_MEMORY = "waiting for store"
"""How the phase begins of a worker that has no memory to work with."""
_RETRY_S = 0.1


class Fold(Protocol):
    """What a worker needs of its memory."""

    decisions: int
    timeline: Timeline

    def begin_with(self, skill: Skill) -> None:
        """Take over what another run has learnt; ValueError when it does not fit."""

    def replay(self, journal: JournalEpisode) -> None:
        """Fold what is new of a journal entry."""

    def snapshot(self) -> dict[str, bytes | int]:
        """Return the memory between episodes."""

    def restore(self, snapshot: Mapping[str, bytes | int]) -> None:
        """Take over a memory; ValueError when it does not fit."""


F = TypeVar("F", bound=Fold)


class Worker(Generic[F]):
    """A service whose memory is a fold of the run that the task runs."""

    def __init__(self, service: Service, blank: Callable[[Experiment], F]) -> None:
        self.service = service
        self._blank = blank
        self._checkpointed = 0
        self._stale = False
        self.experiment: Experiment
        self.fold: F

    def load(self) -> bool:
        """Learn from the task what runs, and load the memory of it from the store; False when stopped meanwhile."""
        service = self.service
        before = service.phase
        experiment = service.wait_for("task (no experiment)", service.ask_experiment)
        while experiment is not None and not service.stopping:
            self.experiment = experiment
            service.run = experiment.run
            try:
                self.fold = self._remember()
            except (ContractError, FoldError, NoAnswerError) as error:
                service.phase = one_line(f"{NO_MEMORY} ({error})", 200)
                service.complain(service.phase, topic="memory")
                service.work_until(lambda: False, _RETRY_S)
                # The task may have taken up another run meanwhile.
                experiment = service.ask_experiment() or experiment
                continue
            service.phase = before
            self._stale = False
            service.log.info("memory of run %s: %d decisions", experiment.run, self.fold.decisions)
            return True
        return False

    def loop(self) -> None:
        """Say that the service is alive and work until stopped, loading another run's memory when the task changed.

        To be called when everything is subscribed to: what came between loading and subscribing is fetched first.
        """
        # A task that took up a run that is over already has nothing more to tell in it.
        self.service.subscribe(name_of(HEARTBEAT, service="task"), Alive, self._on_task, "task")
        self._settle()
        self.service.ready()
        while not self.service.stopping:
            self.service.work(1.0)
            if self._stale and self.load():
                self._settle()

    def catching_up(self, apply: Callable[[], None]) -> None:
        """Apply one message; when something before it is missing, fetch that from task and journal and try again.

        A message that still cannot be applied is refused: the task sends it again.
        """
        try:
            try:
                apply()
            except GapError:
                self._catch_up()
                apply()
        except ForeignRunError:
            self._look_for_another_run()
            raise

    def checkpoint_before(self, episode: int) -> None:
        """Put a checkpoint of the memory after all episodes before ``episode``, when it is time for one."""
        if episode // CHECKPOINT_EVERY == self._checkpointed // CHECKPOINT_EVERY:
            return
        self._checkpointed = episode
        service = self.service
        checkpoint = Checkpoint(
            run=self.experiment.run,
            service=service.name,
            episode=episode,
            decisions=self.fold.decisions,
            contract_sha256=service.contract,
            snapshot=self.fold.snapshot(),
        )
        service.put(service.keys.checkpoint(checkpoint.run, service.name, episode), checkpoint)
        service.put(service.keys.checkpoint_latest(checkpoint.run, service.name), checkpoint)

    # -- details -------------------------------------------------------------------------------------------------

    def _remember(self) -> F:
        """Return the memory that the store has of this run, complete up to the newest episode in it.

        Raises NoAnswerError while the store does not answer or does not know the run, and ContractError or FoldError
        when what it has cannot be used.
        """
        service, run = self.service, self.experiment.run
        samples = {str(sample.key_expr): sample for sample in service.fetch_stored(name_of(HEAD, run=run))}
        if service.keys.run_record(run) not in samples:
            raise NoAnswerError("it has no memory of this run")
        latest = samples.get(service.keys.journal_latest(run))
        journalled = 0
        if latest is not None:
            newest = codec.decode(JournalEpisode, latest.payload.to_bytes(), str(latest.encoding))
            journalled = newest.first_decision + len(newest.steps)
        for checkpoint in self._checkpoints():
            try:
                return self._from(checkpoint, journalled)
            except FoldError as error:
                service.complain(
                    f"checkpoint before episode {checkpoint.episode} is passed over: {error}", topic="checkpoint"
                )
        return self._from(None, journalled)

    def _checkpoints(self) -> Iterator[Checkpoint]:
        """Give this run's checkpoints, the newest first. Raises like ``_remember``."""
        service, run = self.service, self.experiment.run
        latest = service.stored(name_of(NEWEST_CHECKPOINT, run=run, service=service.name), Checkpoint)
        yield from latest
        # Only when that could not be gone on with is it worth to ask for those before it.
        numbered = service.stored(name_of(CHECKPOINT, run=run, service=service.name), Checkpoint, 10.0)
        yield from (checkpoint for checkpoint in reversed(numbered) if checkpoint not in latest)

    def _from(self, checkpoint: Checkpoint | None, journalled: int) -> F:
        """Return the memory that comes of a checkpoint, or of nothing, and the journal after it.

        ``journalled`` decisions are in the journal. Raises FoldError, and like ``_remember``.
        """
        service, run = self.service, self.experiment.run
        fold = self._blank(self.experiment)
        self._begin(fold)
        self._checkpointed = 0
        if checkpoint is not None:
            if (checkpoint.run, checkpoint.service) != (run, service.name):
                raise DivergedError(f"expected {service.name} of run {run}, got {checkpoint.service}")
            try:
                fold.restore(checkpoint.snapshot)
            except ValueError as error:
                raise DivergedError(str(error)) from error
            self._checkpointed = checkpoint.episode
        try:
            self._replay_journal(fold, self._checkpointed // JOURNAL_BLOCK)
        except GapError:
            self._lacking(fold, journalled)
            raise
        self._lacking(fold, journalled)
        return fold

    def _lacking(self, fold: F, journalled: int) -> None:
        """Raise GapError when a memory does not come as far as the journal, which has ``journalled`` decisions."""
        if fold.decisions < journalled:
            decisions = f"decisions {fold.decisions} to {journalled - 1} of run {self.experiment.run}"
            advice = "`treenail store check FILE` says what of the store's file is there"
            raise GapError(f"neither checkpoint nor journal has {decisions}; {advice}")

    def _begin(self, fold: F) -> None:
        """Take over the skill that the run began with, if any. Raises like ``_remember``."""
        sha256 = self.experiment.skill_sha256
        if sha256 is None:
            return
        samples = self.service.fetch_stored(name_of(SKILL, sha256=sha256), 10.0)
        if not samples:
            raise NoAnswerError(f"expected skill {sha256[:12]} in the store, got none")
        stored = decode(samples[0].payload.to_bytes(), str(samples[0].encoding))
        if stored.sha256 != sha256:
            raise DivergedError(f"skill: expected {sha256[:12]}, got {stored.sha256[:12]}")
        try:
            fold.begin_with(stored.skill)
        except ValueError as error:
            raise DivergedError(f"skill {sha256[:12]}: {error}") from error

    def _replay_journal(self, fold: F, block: int) -> None:
        """Fold all that the journal has from a block on."""
        run = self.experiment.run
        while entries := self.service.stored(name_of(ENTRY, run=run, block=block), JournalEpisode, 10.0):
            for entry in entries:
                fold.replay(entry)
            block += 1

    def _settle(self) -> None:
        """Catch up once; a task that does not answer will repeat all that it has not journalled."""
        try:
            self._catch_up()
        except (ContractError, FoldError, NoAnswerError) as error:
            self.service.complain(f"nothing to catch up with: {error}", topic="settle")

    def _catch_up(self) -> None:
        """Fold what happened without us: whole episodes from the journal, then the one under way from the task."""
        before = self.fold.decisions
        under_way = self.service.fetch(TASK_STEPS, JournalEpisode)
        # Asked for after the steps, so that it knows all swaps that are in force in them.
        experiment = self.service.fetch(EXPERIMENT, Experiment)
        for run in (under_way.run, experiment.run):
            if run != self.experiment.run:
                raise ForeignRunError(f"task: expected run {self.experiment.run}, got {run}")
        self.fold.timeline.learn_of(experiment.swaps)
        self.experiment = experiment
        if under_way.first_decision > self.fold.decisions:
            memory = self._remember()
            if memory.decisions > self.fold.decisions:
                self.fold = memory
        self.fold.replay(under_way)
        self.service.log.info("caught up: decisions %d to %d", before, self.fold.decisions)

    def _on_task(self, task: Alive) -> None:
        if task.run not in (None, self.experiment.run):
            self._look_for_another_run()

    def _look_for_another_run(self) -> None:
        experiment = self.service.ask_experiment()
        self._stale = experiment is not None and experiment.run != self.experiment.run
