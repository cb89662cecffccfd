"""What a run had learnt after any number of episodes, from checkpoints and journal, by the workers' own folds.

Exact: a worker's memory is a function of what the run began with and of its steps, so it does not matter when or where
they are folded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypedDict

from services.agent.fold import AgentFold
from services.classifier.fold import ClassifierFold
from services.rules.skill import NamedSkill, named
from services.rules.swaps import in_force
from services.wire.actions import action_names
from services.wire.errors import DivergedError, TreenailError
from services.wire.messages import Checkpoint, JournalEpisode, RunRecord, Skill, Swap


class SkillDigests(TypedDict):
    """SHA-256 in hex of a skill's Q-table and ART2 weights, as in a run's results."""

    q_table: str
    art2: str


def skill_after(
    record: RunRecord,
    episode: int,
    checkpoints: Mapping[str, Checkpoint],
    journal: Sequence[JournalEpisode],
    began_with: NamedSkill | None,
    swaps: Sequence[Swap] = (),
) -> NamedSkill:
    """Return what a run with these swaps had learnt after all its episodes before ``episode``.

    ``checkpoints`` are those of "agent" and "classifier" to begin from, before ``episode`` or at it, if any; in
    ``journal`` are all episodes from the earlier of these up to ``episode``, in order. Raises TreenailError when some
    are missing, and FoldError when these parts are not of one run.
    """
    sha256 = None if began_with is None else began_with.sha256
    if record.skill_sha256 != sha256:
        raise DivergedError(f"run {record.run}: expected skill {record.skill_sha256} to begin with, got {sha256}")
    agent = AgentFold(record.definition, record.run, record.seed, swaps)
    classifier = ClassifierFold(record.definition, record.run, swaps)
    for service, fold in (("agent", agent), ("classifier", classifier)):
        _go_to(fold, checkpoints.get(service), began_with)
        first = checkpoints[service].episode if service in checkpoints else 0
        missing = set(range(first, episode)) - {entry.episode for entry in journal}
        if missing:
            raise TreenailError(f"run {record.run}: expected episode {min(missing)} in the journal, got none")
        for entry in journal:
            if entry.episode < episode:
                fold.replay(entry)
    return skill_from(record, episode, agent, classifier, began_with)


def skill_from(
    record: RunRecord,
    episodes: int,
    agent: AgentFold,
    classifier: ClassifierFold,
    began_with: NamedSkill | None,
) -> NamedSkill:
    """Return what two folds have learnt in a run of so many episodes that began with a skill, or with nothing."""
    before = 0 if began_with is None else began_with.skill.episodes
    return named(
        Skill(
            run=record.run,
            seed=record.seed,
            definition=record.definition,
            definition_sha256=record.definition_sha256,
            contract_sha256=record.contract_sha256,
            skill_sha256=record.skill_sha256,
            actions=action_names(record.definition.moves),
            episodes=before + episodes,
            agent=agent.learnt(),
            classifier=classifier.learnt(),
            swaps=classifier.timeline.known[: classifier.timeline.made],
        )
    )


def digests(skill: Skill) -> SkillDigests:
    """Return the digests of what a skill holds, which have to fit its definition (ValueError otherwise)."""
    learnt_by = in_force(skill.definition, skill.swaps)
    agent = AgentFold(learnt_by, skill.run, skill.seed)
    classifier = ClassifierFold(learnt_by, skill.run)
    agent.begin_with(skill)
    classifier.begin_with(skill)
    return {"q_table": agent.learner.digest(), "art2": classifier.network.digest()}


def _go_to(fold: AgentFold | ClassifierFold, checkpoint: Checkpoint | None, began_with: NamedSkill | None) -> None:
    """Bring a blank fold to where a checkpoint stands, or to the beginning of the run."""
    try:
        if began_with is not None:
            fold.begin_with(began_with.skill)
        if checkpoint is not None:
            fold.restore(checkpoint.snapshot)
    except ValueError as error:
        raise DivergedError(f"checkpoint: {error}") from error
