"""The maze: Figs. 4.12, 4.14, 4.15, A.1, A.2 and Tables 4.1, A.1 (thesis 4.5.1)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

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
from experiments.reproduce.gridworlds import MAZES
from experiments.reproduce.learner_parts import GOAL, NAMES, Runs, learn_all, most, returns
from experiments.reproduce.learner_runs import KINDS, POLICIES, Kind, Learnt, Place, Run

OPTIMAL = {1: "E", 2: "E", 3: "E", 4: "N", 5: "S", 6: "S", 7: "S", 9: "E"}
"""The last column of Tables 4.1 and A.1."""
SHORTEST = {"narrow": "SSEENEESSS", "wide": "SEENEESSSS"}
SHORTEST_RETURN = -9.0
SHOWN_RETURN = -120.0
"""Lower end of the figures' axes."""
NUMBERS: dict[Kind, tuple[str, str, str]] = {"sarsa": ("4.14", "4.15", "4.1"), "q_learning": ("A.1", "A.2", "A.1")}
"""Figure of epsilon-greedy, figure of softmax, table."""
THESIS: dict[Kind, Sequence[str]] = {
    "sarsa": (
        "EEEENSSSNENNNNGN",
        "EEEENSSSWEWNNNGN",
        "EEEENSSSEENNENGN",
        "EEEENSSSEESNENGN",
        "EEEENSSSEEENNNGN",
        "EEEENSSSEEENNNGN",
        "EEEENSSSEEENNNGN",
    ),
    "q_learning": (
        "EEEENSSSNENNNNGN",
        "EEEENSSSEEWNNNGN",
        "EEEENSSSNESNWNGN",
        "EEEENSSSEEWNENGN",
        "EEEENSSSEENNNNGN",
        "EEEENSSSNENNNNGN",
        "EEEENSSSEEENNNGN",
    ),
}
"""Best moves of states 0 to 15 as printed in Tables 4.1 and A.1, by column."""
NARROW_POLICIES = ("μ = 0.001", "μ = 1", "β = 2")


def maze(context: Context) -> tuple[Block, ...]:
    """Return the part of the chapter about the maze."""
    episodes, few = (200, 50) if context.quick else (500, 200)
    wide = learn_all(context, "maze, open", _runs(context, "maze wide", tuple(POLICIES), episodes))
    narrow = learn_all(context, "maze, corridor", _runs(context, "maze narrow", NARROW_POLICIES, few))
    apart = learn_all(context, "maze, squares told apart", _runs(context, "maze narrow", ("β = 2",), few, apart=True))
    blocks: list[Block] = [
        Heading("The maze"),
        Text(
            "The drawing of the maze (Fig. 4.12) is lost with the thesis's figures. Its ten-move path, the best moves "
            "in Table 4.1 and the states met leave two layouts. The agent sees only which of the four squares around "
            f"it are walls. Learning rate 0.1, discount 0.9, {episodes} episodes; the thesis does not say how many."
        ),
        Figure("4.12", "The two mazes that fit what the thesis says, with their shortest paths.", _drawn()),
        *_narrow(narrow, apart, few),
    ]
    for kind in KINDS:
        blocks += _learner(kind, {policy: runs for (of, policy), runs in wide.items() if of == kind})
    return (*blocks, Comparisons([row for kind in KINDS for row in _rows(kind, wide)], "In the open maze"))


def _runs(context: Context, world: Place, policies: Sequence[str], episodes: int, apart: bool = False) -> list[Run]:
    return [
        Run(world, "square" if apart else "walls", kind, policy, 0.1, 0.9, episodes, seed)
        for kind in KINDS
        for policy in policies
        for seed in context.seeds
    ]


def _drawn() -> str:
    titles = {"wide": "open", "narrow": "corridor"}
    return figures.worlds({titles[name]: (MAZES[name], SHORTEST[name]) for name in titles})


def right(learnt: Learnt) -> int:
    """Return in how many of the states on the optimal path the best move is the table's."""
    return sum(learnt.best[state] == move for state, move in OPTIMAL.items())


def _narrow(narrow: Runs, apart: Runs, episodes: int) -> tuple[Block, ...]:
    """Say why only one of the two mazes is the thesis's."""
    rows = [
        (f"{NAMES[kind]}, {policy}", f"{np.median([right(run) for run in runs]):g} of {len(OPTIMAL)}", _arrived(runs))
        for (kind, policy), runs in narrow.items()
    ]
    rows += [
        (f"{NAMES[kind]}, {policy}, squares told apart", "-", _arrived(runs)) for (kind, policy), runs in apart.items()
    ]
    return (
        Text(
            "Only the open maze reproduces the thesis. In the corridor maze the square below the start and the two "
            "above the goal look alike (walls left and right, state 6), so that the value of being close to the goal "
            "also makes turning back to the start look like winning, and the agent walks to and fro there. When it "
            f"is told which square it is on, it learns that maze too ({episodes} episodes each):"
        ),
        Table(
            "",
            "The corridor maze: what is learnt where squares that look alike are one state.",
            ("learner", "states right, median", "greedy path arrives in ten moves"),
            rows,
        ),
        Text("All that follows is in the open maze."),
    )


def _arrived(runs: Sequence[Learnt]) -> str:
    return f"{sum(len(run.path) == 10 for run in runs)} of {len(runs)} seeds"


def _learner(kind: Kind, runs: Mapping[str, Sequence[Learnt]]) -> list[Block]:
    """Return one learner's two figures and its table."""
    greedy, soft, table = NUMBERS[kind]
    curves = {policy: returns(learnt) for policy, learnt in runs.items()}
    blocks: list[Block] = []
    for number, sign, name in ((greedy, "μ", "ε-greedy"), (soft, "β", "softmax")):
        some = {policy: curve for policy, curve in curves.items() if policy.startswith(sign)}
        caption = (
            f"{NAMES[kind]} with the {name} policy: return of an episode, mean of ten, median and 90 % band of the "
            f"seeds; dotted the best possible, {SHORTEST_RETURN:g}. Returns below {SHOWN_RETURN:g} are off the axis."
        )
        blocks.append(Figure(number, caption, figures.learning(some, SHOWN_RETURN, {"best possible": SHORTEST_RETURN})))
    caption = (
        f"Best move in each state after {NAMES[kind]}. Each cell: the thesis's, then the one most seeds have, with "
        "their share where not all do. States that are not on the optimal path are free; N stands for never met."
    )
    return [*blocks, Table(table, caption, ("state", *runs, "optimal"), _policy_rows(kind, runs))]


def _policy_rows(kind: Kind, runs: Mapping[str, Sequence[Learnt]]) -> list[list[str]]:
    rows = []
    for state in range(16):
        cells = [
            "G | G" if state == GOAL else f"{printed[state]} | {most([run.best[state] for run in learnt])}"
            for printed, learnt in zip(THESIS[kind], runs.values(), strict=True)
        ]
        rows.append([str(state), *cells, "G" if state == GOAL else OPTIMAL.get(state, "free")])
    return rows


def _rows(kind: Kind, wide: Runs) -> list[Comparison]:
    runs = {policy: wide[kind, policy] for policy in POLICIES}
    seeds = range(len(runs["β = 1"]))
    means = {policy: returns(learnt).mean(axis=1) for policy, learnt in runs.items()}
    late = {policy: returns(learnt)[:, -100:].mean(axis=1) for policy, learnt in runs.items()}
    greedy, soft, table = NUMBERS[kind]
    short = "A short run, or squares that look alike; see the table for the states."
    return [
        in_all_seeds(
            f"{NAMES[kind]}: all {len(OPTIMAL)} states of the optimal path learnt, with each of the seven policies",
            f"yes (Table {table})",
            [all(right(learnt[seed]) == len(OPTIMAL) for learnt in runs.values()) for seed in seeds],
            short,
        ),
        in_all_seeds(
            f"{NAMES[kind]}: the greedy path is the shortest, ten moves, with each of the seven policies",
            "yes (4.5.1)",
            [all(learnt[seed].path == SHORTEST["wide"] for learnt in runs.values()) for seed in seeds],
            short,
        ),
        in_all_seeds(
            f"{NAMES[kind]}: μ = 0.001 does worst by far, less than half as well as any other μ",
            f"yes (Fig. {greedy})",
            [all(means["μ = 0.001"][s] < 2 * means[f"μ = {mu}"][s] for mu in ("0.01", "0.1", "1")) for s in seeds],
            "The more is explored the lower the returns, but by less than in the thesis's words.",
        ),
        in_all_seeds(
            f"{NAMES[kind]}: the smaller β, the lower the return, and none settles at the best possible",
            f"yes (Fig. {soft})",
            [bool(late["β = 1"][s] < late["β = 2"][s] <= late["β = 5"][s] < SHORTEST_RETURN) for s in seeds],
            "At β = 5 hardly any move is left to chance, so that a hundred episodes may all be the best possible.",
        ),
    ]
