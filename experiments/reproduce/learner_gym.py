"""Gymnasium's CliffWalking-v1 through the same learner: a world whose right answer everybody knows."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec

from experiments.reproduce import learner_figures as figures
from experiments.reproduce.chapter import Block, Comparison, Comparisons, Figure, Heading, Text
from experiments.reproduce.context import Context
from experiments.reproduce.learner_parts import CONSTANT, NAMES, learn_all, returns
from experiments.reproduce.learner_runs import KINDS, Kind, Learnt, Run
from experiments.reproduce.verdicts import near

TITLE = "Gymnasium's CliffWalking-v1"
EPISODES = 1000
EDGE, TOP = -13.0, -17.0
"""Returns of the path along the edge and of the one along the top."""
SHOWN_RETURN = -150.0


def gym(context: Context) -> tuple[Block, ...]:
    """Return the part of the chapter about CliffWalking-v1."""
    if find_spec("gymnasium") is None:
        return Heading(TITLE), Text("Could not run: the package gymnasium is not installed.")
    runs = [
        Run("CliffWalking-v1", "square", kind, CONSTANT, 0.5, 1.0, EPISODES, seed)
        for kind in KINDS
        for seed in context.seeds
    ]
    learnt = learn_all(context, "CliffWalking-v1", runs)
    sarsa, q = learnt["sarsa", CONSTANT], learnt["q_learning", CONSTANT]
    return (
        Heading(TITLE),
        Text(
            "Not in the thesis: the textbook's cliff of 4 x 12 squares as Gymnasium has it, where squares are told "
            "apart, a fall leads back to the start without ending the episode, and every move costs 1. Learning rate "
            f"0.5, discount 1, ε = 0.1 throughout, {EPISODES} episodes; then one greedy walk. The best possible is "
            "-13, the path along the top -17."
        ),
        Figure(
            "",
            "CliffWalking-v1: mean return of 50 episodes while learning, median and 90 % band of the seeds.",
            figures.both(returns(sarsa), returns(q), SHOWN_RETURN, {"edge, -13": EDGE, "top, -17": TOP}),
        ),
        Comparisons(
            (
                _row("q_learning", q, EDGE),
                _row("sarsa", sarsa, TOP),
            ),
            "In CliffWalking-v1",
        ),
    )


def _row(kind: Kind, runs: Sequence[Learnt], best: float) -> Comparison:
    greedy = [run.greedy_return for run in runs]
    return Comparison(
        f"{NAMES[kind]} in CliffWalking-v1: greedy return",
        f"textbook: {best:g}",
        greedy,
        near(best, 0.5),
        "Not the textbook's result: this would be an error in Treenail, or too few episodes.",
        note=f"Just that in {greedy.count(best)} of {len(greedy)} seeds. With a constant learning rate the values "
        "waver, and a walk is taken from where they happen to be at the end.",
    )
