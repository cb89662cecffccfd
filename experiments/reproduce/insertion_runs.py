"""The runs behind the chapter on insertions: each a definition with a seed, in one process, kept by definition hash."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from experiments.lab.agreement import adjusted_rand_index, contingency, purity
from experiments.lab.in_process import InProcessRun
from services.wire.definition import Definition
from services.wire.definition_file import definition_sha256, load
from services.wire.errors import TreenailError
from services.wire.messages import EpisodeSummary, Move, Observation

BLOCK = 100
"""Episodes over which agreement with the true contact states is told."""
LETTERS = {"inserted": "i", "collision": "c", "no_progress": "p", "move_limit": "m"}


@dataclass(frozen=True)
class Run:
    """What a run depends on."""

    name: str
    definition_sha256: str
    seed: int
    episodes: int
    version: int = 1


@dataclass(frozen=True)
class Block:
    """How the contact states of some episodes agree with the true ones."""

    first_episode: int
    decisions: int
    states: int
    """Contact states met."""
    purity: float
    """Part of the decisions whose true contact state is the commonest one of their class."""
    adjusted_rand_index: float
    entropy_bit: float
    """Mean uncertainty about the true contact state when the class is known."""


@dataclass(frozen=True)
class Gone:
    """How a run went: one entry an episode."""

    returns: list[float]
    force_n: list[float]
    torque_nm: list[float]
    outcomes: str
    """One letter an episode, see LETTERS."""
    states: int
    blocks: list[Block] = field(default_factory=list)


class WatchedRun(InProcessRun):
    """A run that notes the true contact state, which no learner sees, beside each class."""

    def __init__(self, definition: Definition, seed: int) -> None:
        super().__init__(definition, seed)
        self.pairs: list[tuple[int, str]] = []
        """Class and true contact state of each decision."""

    def _decide(self, observation: Observation) -> Move:
        # Asked again by the run, the classifier gives the same answer and learns nothing more.
        self.pairs.append((self.classifier.observe(observation).state, self.cell.world.contact_state()))
        return super()._decide(observation)


def insert(run: Run) -> Gone:
    """Make a run. Raises TreenailError when the definition is not the one that ``run`` means."""
    definition = load(run.name)
    if definition_sha256(definition) != run.definition_sha256:
        raise TreenailError(f"{run.name}: expected definition {run.definition_sha256[:12]}, got another one")
    watched = WatchedRun(definition, run.seed)
    episodes: list[EpisodeSummary] = []
    blocks: list[Block] = []
    for summary in watched.episodes(run.episodes):
        episodes.append(summary)
        if len(episodes) % BLOCK == 0 or len(episodes) == run.episodes:
            blocks += _block(len(episodes) - 1, watched.pairs)
            watched.pairs = []
    return Gone(
        [summary.episode_return for summary in episodes],
        [summary.mean_force_n for summary in episodes],
        [summary.mean_torque_nm for summary in episodes],
        "".join(LETTERS[summary.outcome] for summary in episodes),
        episodes[-1].states,
        blocks,
    )


def _block(last_episode: int, pairs: Sequence[tuple[int, str]]) -> list[Block]:
    """Return the agreement in one block; nothing where nothing was decided."""
    if not pairs:
        return []
    names = {truth: index for index, truth in enumerate(sorted({truth for _, truth in pairs}))}
    states, truths = [state for state, _ in pairs], [names[truth] for _, truth in pairs]
    table = contingency(states, truths)
    block = Block(
        first_episode=last_episode // BLOCK * BLOCK,
        decisions=len(pairs),
        states=len(table),
        purity=purity(states, truths),
        adjusted_rand_index=adjusted_rand_index(states, truths),
        entropy_bit=_entropy_bit(table),
    )
    return [block]


def _entropy_bit(table: NDArray[np.int64]) -> float:
    """Return the conditional entropy of the truth (columns), given the class (rows) [bit]."""
    of_class = table.sum(axis=1, keepdims=True)
    parts = table / of_class
    logs = np.log2(parts, out=np.zeros_like(parts), where=parts > 0)
    return float(-(parts * logs).sum(axis=1) @ of_class[:, 0] / of_class.sum())
