"""Why epsilon-greedy runs go on failing: how many failures follow a random move, and how the same table does without.

A run learns for a while. Of its second half, every failed episode is looked at: was a move made in it that was not the
best one known? Then what was learnt is taken over by a run with the greedy policy, which explores nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

from msgspec.structs import replace

from experiments.lab.in_process import InProcessRun
from experiments.reproduce.chapter import Table
from experiments.reproduce.context import Context
from experiments.reproduce.verdicts import interval
from services.wire.definition import Definition, Greedy
from services.wire.definition_file import definition_sha256, load
from services.wire.messages import Move, Observation

EPISODES, GREEDY_EPISODES = 600, 200
QUICK_EPISODES, QUICK_GREEDY_EPISODES = 20, 10
OTHER_SEED = 1000
"""Is added to a run's seed for the greedy one: the arm's errors are not to be those that were learnt with."""


@dataclass(frozen=True)
class Exploring:
    """What one of these runs depends on."""

    name: str
    definition_sha256: str
    seed: int
    episodes: int
    greedy_episodes: int
    version: int = 1


@dataclass(frozen=True)
class Explored:
    """How it went."""

    success: float
    """Part of the second half's episodes that succeeded."""
    failures: int
    """Episodes of the second half that failed,"""
    failures_after_exploring: int
    """and those of them in which a move was made that was not the best one known."""
    greedy_success: float
    greedy_return: float
    """Mean over the greedy run."""


class WatchedRun(InProcessRun):
    """A run that notes whether a move of the episode under way was not the best one known."""

    def __init__(self, definition: Definition, seed: int) -> None:
        super().__init__(definition, seed)
        self.explored = False

    def _decide(self, observation: Observation) -> Move:
        move = super()._decide(observation)
        step = self.task.record().steps[-1]
        if step.state is not None and step.action is not None:
            # The values that were decided by: learning from the reward before it comes first.
            values = self.agent.table.values(step.state)
            self.explored = self.explored or bool(values[step.action] < values.max())
        return move


def explore(key: Exploring) -> Explored:
    """Learn, and go on greedily."""
    definition = load(key.name)
    run = WatchedRun(definition, key.seed)
    half = key.episodes // 2
    inserted = failures = after = 0
    for summary in run.episodes(key.episodes):
        if summary.episode >= half:
            inserted += summary.outcome == "inserted"
            failures += summary.outcome != "inserted"
            after += summary.outcome != "inserted" and run.explored
        run.explored = False
    greedy = InProcessRun(replace(definition, policy=Greedy()), key.seed + OTHER_SEED, skill=run.learnt())
    summaries = list(greedy.episodes(key.greedy_episodes))
    return Explored(
        success=inserted / (inserted + failures),
        failures=failures,
        failures_after_exploring=after,
        greedy_success=sum(summary.outcome == "inserted" for summary in summaries) / len(summaries),
        greedy_return=sum(summary.episode_return for summary in summaries) / len(summaries),
    )


def table(context: Context, name: str) -> Table:
    """Return the figures of one experiment over the seeds."""
    episodes, more = (QUICK_EPISODES, QUICK_GREEDY_EPISODES) if context.quick else (EPISODES, GREEDY_EPISODES)
    keys = [Exploring(name, definition_sha256(load(name)), seed, episodes, more) for seed in context.seeds]
    explored = context.pieces("insertions with and without exploring", keys, explore, Explored)
    failures, after = (
        sum(piece.failures for piece in explored),
        sum(piece.failures_after_exploring for piece in explored),
    )
    rows = [
        (f"success, episodes {episodes // 2} to {episodes}", _spread([100 * piece.success for piece in explored], "%")),
        ("failures in them, all seeds", str(failures)),
        ("of these, with an exploratory move before", str(after)),
        (
            f"success of {more} episodes without exploring",
            _spread([100 * piece.greedy_success for piece in explored], "%"),
        ),
        ("return of these", _spread([piece.greedy_return for piece in explored], "")),
    ]
    caption = f"{name}: what exploring costs; median and 90 % interval over {len(explored)} seeds."
    return Table("", caption, ("", "Treenail"), rows)


def _spread(values: list[float], unit: str) -> str:
    low, median, high = interval(values)
    return f"{median:.4g} ({low:.4g} to {high:.4g}) {unit}".strip()
