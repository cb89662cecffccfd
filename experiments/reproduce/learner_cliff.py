"""The cliff: Figs. 4.16 to 4.21, Table 4.2, and the falls (thesis 4.5.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from experiments.reproduce import learner_figures as figures
from experiments.reproduce.chapter import (
    Block,
    Comparison,
    Comparisons,
    Figure,
    Heading,
    Table,
    Text,
    in_all_seeds,
)
from experiments.reproduce.context import Context
from experiments.reproduce.figures import BLUE, VERMILION, moving_average
from experiments.reproduce.gridworlds import CLIFF
from experiments.reproduce.learner_parts import CONSTANT, GOAL, NAMES, learn_all, most, returns
from experiments.reproduce.learner_runs import CIRCLES, Kind, Learnt, Run
from experiments.reproduce.verdicts import always, among

EPISODES, STEP_LIMIT = 1000, 1000
OPTIMAL_PATHS = ("ENEEEEEEEES", "NEEEEEEEEES")
"""Both are eleven moves along the edge; the thesis draws the first."""
SAFE_PATH = "NNNEEEEEEEEESSS"
THESIS: dict[Kind, str] = {"sarsa": "NENESSNNNNNNWNGN", "q_learning": "EEEESSNNENENNNGN"}
"""Best moves of states 0 to 15 as printed in Table 4.2, columns "Simulated"."""
NEEDED: dict[Kind, Mapping[int, str]] = {
    "sarsa": {1: "E", 2: "N", 3: "E", 4: "S", 5: "S", 10: "N"},
    "q_learning": {4: "S", 5: "S", 8: "E", 10: "E", 12: "N"},
}
"""The same, columns "Safe" and "Optimal"."""
FALLS: dict[Kind, int] = {"sarsa": 11, "q_learning": 167}
STABLE: dict[Kind, int] = {"sarsa": 30, "q_learning": 60}
LOWEST: dict[Kind, int] = {"sarsa": -131, "q_learning": -371}
FIGURES: dict[Kind, tuple[str, str]] = {"sarsa": ("4.17", "4.18"), "q_learning": ("4.19", "4.20")}
COLOURS: dict[Kind, str] = {"sarsa": BLUE, "q_learning": VERMILION}
PATHS = {"optimal path, -10": -10.0, "safe path, -14": -14.0}
"""Returns of the two."""
SHOWN_RETURN = -400.0
"""Lower end of the figures' axes."""
_ALIKE = (
    "Every square above the cliff looks alike (state 8), and so do all squares with nothing around (state 0). By walls "
    "alone there is a second answer that agrees with itself, one row above the edge, and with a discount of 0.1 the "
    "values of the two differ by hundredths, so that the last few moves decide which one is on top."
)


def cliff(context: Context) -> tuple[Block, ...]:
    """Return the part of the chapter about the cliff."""
    sarsa, q = (_learnt(context, "cliff", kind, "walls") for kind in ("sarsa", "q_learning"))
    apart = _learnt(context, "cliff, squares told apart", "q_learning", "square")
    return (
        Heading("The cliff"),
        Text(
            "The thesis's parameters: learning rate, discount and ε are 0.1 throughout; 1000 episodes; a fall ends the "
            "episode. Its numbers come from one run of each learner; ours from as many as there are seeds."
        ),
        Figure(
            "4.16",
            "The cliff (dark) with the optimal path, return -10, and the safe path, return -14.",
            figures.worlds({"optimal": (CLIFF, OPTIMAL_PATHS[0]), "safe": (CLIFF, SAFE_PATH)}),
        ),
        *_curves("sarsa", sarsa),
        *_curves("q_learning", q),
        Figure(
            "4.21",
            "Both learners: mean of 50 episodes (the thesis: a Bezier curve), median and 90 % band of the seeds. "
            f"Returns below {SHOWN_RETURN:g} are off the axis.",
            figures.both(returns(sarsa), returns(q), SHOWN_RETURN, PATHS),
        ),
        _table(sarsa, q),
        _paths(q, apart),
        Comparisons(
            (
                *_rows("sarsa", sarsa),
                *_rows("q_learning", q),
                _limit_row({"sarsa": sarsa, "q_learning": q}),
                *_path_rows(sarsa, q, apart),
            ),
            "At the cliff",
        ),
    )


def _learnt(context: Context, what: str, kind: Kind, sees: Literal["walls", "square"]) -> Sequence[Learnt]:
    runs = [Run("cliff", sees, kind, CONSTANT, 0.1, 0.1, EPISODES, seed) for seed in context.seeds]
    return learn_all(context, f"{what}, {NAMES[kind]}", runs)[kind, CONSTANT]


def _curves(kind: Kind, runs: Sequence[Learnt]) -> tuple[Block, ...]:
    performance, failures = FIGURES[kind]
    falls = np.zeros((len(runs), EPISODES))
    for row, run in zip(falls, runs, strict=True):
        row[run.falls] = 1.0
    return (
        Figure(
            performance,
            f"{NAMES[kind]}: return of an episode, mean of ten. Returns below {SHOWN_RETURN:g} are off the axis.",
            figures.learning({NAMES[kind]: returns(runs)}, SHOWN_RETURN, PATHS, colours=(COLOURS[kind],)),
        ),
        Figure(failures, f"{NAMES[kind]}: falls in each ten episodes.", figures.failures(falls, COLOURS[kind])),
    )


def _table(sarsa: Sequence[Learnt], q: Sequence[Learnt]) -> Table:
    rows = []
    learnt: tuple[tuple[Kind, Sequence[Learnt]], ...] = (("sarsa", sarsa), ("q_learning", q))
    for state in range(16):
        row = [str(state)]
        for kind, runs in learnt:
            if state == GOAL:
                row += ["G", "G", "G"]
            else:
                ours = most([run.best[state] for run in runs])
                row += [THESIS[kind][state], ours, NEEDED[kind].get(state, "free")]
        rows.append(row)
    head = ("state", "SARSA, thesis", "ours", "safe path", "Q, thesis", "ours", "optimal path")
    caption = "Best move in each state: the thesis's, the one most seeds have, and the one that the path needs."
    return Table("4.2", caption, head, rows)


def _paths(q: Sequence[Learnt], apart: Sequence[Learnt]) -> Table:
    rows = [
        (
            str(seed),
            path_name(by_walls.path),
            str(len(by_walls.falls)),
            path_name(by_square.path),
            str(len(by_square.falls)),
        )
        for seed, (by_walls, by_square) in enumerate(zip(q, apart, strict=True))
    ]
    head = ("seed", "sees walls: greedy path", "falls", "told the square: greedy path", "falls")
    return Table("", "Q-learning, seed by seed: what it takes to keep to the edge.", head, rows)


def path_name(path: str) -> str:
    """Return a greedy path on the cliff in words."""
    if path in OPTIMAL_PATHS:
        return "the edge, 11 moves"
    if path == SAFE_PATH:
        return "the safe path, 15 moves"
    return "walks to and fro" if len(path) >= CIRCLES else f"another, {len(path)} moves"


def stable_from(rewards: Sequence[float]) -> float:
    """Return the episode from which on the mean of ten is as good as late in the run.

    It is the first window of ten episodes whose mean is not below the worst twentieth of those in the second half.
    """
    averages = moving_average(np.array(rewards), figures.WINDOW)
    return float(np.argmax(averages >= np.percentile(averages[len(rewards) // 2 :], 5)))


def _rows(kind: Kind, runs: Sequence[Learnt]) -> list[Comparison]:
    name = NAMES[kind]
    lowest = [float(moving_average(np.array(run.returns), figures.WINDOW).min()) for run in runs]
    return [
        Comparison(
            f"{name}: falls in {EPISODES} episodes",
            str(FALLS[kind]),
            [float(len(run.falls)) for run in runs],
            among(FALLS[kind], "lower"),
            "How often it falls hangs on which of two rows it walks along; see the paths above.",
            note=f"Least {min(len(run.falls) for run in runs)}, most {max(len(run.falls) for run in runs)}.",
        ),
        Comparison(
            f"{name}: stable after",
            f"about {STABLE[kind]} episodes",
            [stable_from(run.returns) for run in runs],
            among(STABLE[kind], "lower"),
            "The thesis reads this off a curve by eye; ours asks for ten episodes as good as late ones, which lie "
            "within a few moves of each other, and so is stricter.",
            "episodes",
            "First ten episodes whose mean return is not below the worst twentieth of the run's second half.",
        ),
        Comparison(
            f"{name}: lowest mean return of ten episodes",
            str(LOWEST[kind]),
            lowest,
            among(LOWEST[kind], "higher"),
            "With no value known yet, some of our first episodes wander on to the limit of 1000 moves, which the "
            "thesis's single run never met. It does not say how it chooses among equal values; we draw evenly.",
        ),
    ]


def _limit_row(runs: Mapping[Kind, Sequence[Learnt]]) -> Comparison:
    return Comparison(
        "Episodes broken off at the limit of 1000 moves, both learners",
        "0",
        [float(sum(_broken_off(run) for run in pair)) for pair in zip(*runs.values(), strict=True)],
        always(0),
        "With a discount of 0.1 the values far from goal and cliff are all but equal; while they are learnt, "
        "the best-valued moves of two of them may lead to and fro, and one blind move in ten seldom leads out.",
        note="; ".join(f"{NAMES[kind]} {sum(map(_broken_off, of))} in all" for kind, of in runs.items()) + ".",
    )


def _broken_off(run: Learnt) -> int:
    """Return how many episodes ended neither at the goal nor in a fall: every move of them cost 1."""
    return sum(reward <= -STEP_LIMIT and episode not in run.falls for episode, reward in enumerate(run.returns))


def _path_rows(sarsa: Sequence[Learnt], q: Sequence[Learnt], apart: Sequence[Learnt]) -> list[Comparison]:
    return [
        in_all_seeds(
            "SARSA: the greedy path is the safe one, return -14",
            "yes (Table 4.2)",
            [run.path == SAFE_PATH for run in sarsa],
            "Too few episodes, or a late run of bad luck; see Table 4.2 above.",
        ),
        in_all_seeds(
            "SARSA: every state of the safe path has the move of Table 4.2",
            "yes",
            [_has(run, "sarsa") for run in sarsa],
            "See Table 4.2 above.",
        ),
        in_all_seeds(
            "Q-learning: the greedy path is the edge, return -10", "yes (Table 4.2)", [_edge(run) for run in q], _ALIKE
        ),
        in_all_seeds(
            "Q-learning: the same when it is told which square it is on",
            "expected of Q-learning",
            [_edge(run) for run in apart],
            "Too few episodes.",
        ),
        in_all_seeds(
            "Q-learning: every state of the optimal path has the move of Table 4.2",
            "yes",
            [_has(run, "q_learning") for run in q],
            "State 10, the start: north first and then east along the edge is eleven moves too, and some seeds learn "
            "that. State 5, the top right corner, is not on the path, and Q-learning is seldom there. State 8 differs "
            "for the reason given for the path.",
        ),
        in_all_seeds(
            "Q-learning falls more often than SARSA, seed by seed",
            "yes, 15 times as often",
            [len(bold.falls) > len(careful.falls) for bold, careful in zip(q, sarsa, strict=True)],
            "See the falls above.",
        ),
    ]


def _edge(run: Learnt) -> bool:
    return run.path in OPTIMAL_PATHS


def _has(run: Learnt, kind: Kind) -> bool:
    return all(run.best[state] == move for state, move in NEEDED[kind].items())
