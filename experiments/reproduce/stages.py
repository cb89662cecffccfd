"""What 6.5 and 7.2 say of every cylindrical peg: three stages of learning, and a force reduced to one tenth."""

from __future__ import annotations

from collections.abc import Sequence

from experiments.reproduce.chapter import Comparison
from experiments.reproduce.insertion_compare import figures_of
from experiments.reproduce.variants import Tried
from experiments.reproduce.verdicts import at_least, at_most, near

FIRST = 15
"""Episodes of the first stage: in the middle of 10 to 20."""
BEGIN = 10
"""Episodes whose force is the initial one."""


def stages(name: str, runs: Sequence[Tried]) -> list[Comparison]:
    """Return the comparisons for the runs of one condition, at least one."""
    figures = [figures_of(run.gone) for run in runs]
    failed = [100 * (1 - run.gone.outcomes[:FIRST].count("i") / len(run.gone.outcomes[:FIRST])) for run in runs]
    fallen = [
        sum(run.gone.force_n[:BEGIN]) / len(run.gone.force_n[:BEGIN]) / last.force_n
        for run, last in zip(runs, figures, strict=True)
    ]
    return [
        Comparison(
            f"{name}: failed of the first {FIRST} episodes",
            "80 % in the first 10 to 20 (2211)",
            failed,
            near(80.0, 20.0, better="lower"),
            "More of the first insertions succeed here, or fewer, than the thesis's: start, clearance and contact are "
            "alike in what is told, and in nothing else.",
            unit="%",
        ),
        Comparison(
            f"{name}: steady from episode",
            "up to 70 (2212)",
            [figure.steady for figure in figures],
            at_most(70, beats_at=35),
            "Steady is strict here: two failures in a hundred at most. One learning rate and one vigilance serve all.",
        ),
        Comparison(
            f"{name}: force of the first {BEGIN} episodes, as a multiple of that of the last quarter",
            "10 (2298)",
            fallen,
            at_least(10, beats_at=20),
            "Means over all moves of an episode. Even who knows nothing touches lightly most of the time here, and the "
            "reward prices moves, not force.",
        ),
    ]
