"""Chapter 6 and Appendix B.2: every experiment of the thesis, many seeds of each, beside its curves and numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from experiments.reproduce import insertion_exploration
from experiments.reproduce.chapter import Block as Part
from experiments.reproduce.chapter import Chapter, Comparisons, Figure, Heading, Table, Text, spread
from experiments.reproduce.context import Context
from experiments.reproduce.figures import BLUE, COLOURS, VERMILION, band, drawing, moving_average, svg
from experiments.reproduce.insertion_compare import Figures, aims, compare, figures_of
from experiments.reproduce.insertion_runs import Gone, Run, insert
from experiments.reproduce.insertion_thesis import REPORTED, Quantity, Reported
from services.wire.definition_file import definition_sha256, load, shipped

QUICK_EPISODES = 30
WINDOW = 10
FIRST = 400
"""Episodes shown beside the whole run, as in Fig. 6.7."""
LABELS: dict[Quantity, str] = {
    "return": "return of the episode",
    "force": "mean force [N]",
    "torque": "mean torque [N m]",
    "failures": "failures per 10 episodes",
}
EXPLORING = ("chamfered-q-egreedy", "chamferless-q-egreedy")
"""Experiments that never stop exploring; what that costs is measured."""
OVERLAP = ("chamfered-q-softmax", "square-q-softmax")
"""Experiments whose contact states are held against the true ones."""


class Done(NamedTuple):
    """One experiment and its runs, one a seed."""

    reported: Reported
    episodes: int
    runs: Sequence[Gone]
    figures: Sequence[Figures]
    """Of each run."""


def chapter(context: Context) -> Chapter:
    """Run all experiments that there is a definition of, and compare."""
    plans = [(reported, _keys(context, reported)) for reported in REPORTED if reported.name in shipped()]
    keys = [key for _, of_one in plans for key in of_one]
    results = dict(zip(keys, context.pieces("insertions", keys, insert, Gone), strict=True))
    done = [_done(reported, [(key, results[key]) for key in of_one]) for reported, of_one in plans]
    parts: list[Part] = [_introduction(context, done), _table(done)]
    parts.append(aims([study.reported for study in done], [study.figures for study in done]))
    for study in done:
        parts += [Heading(f"{study.reported.title} ({study.reported.where})"), *_part(context, study)]
    parts += _policies(done) + _overlap(done)
    return Chapter(parts)


def _keys(context: Context, reported: Reported) -> list[Run]:
    definition = load(reported.name)
    episodes = QUICK_EPISODES if context.quick else definition.episodes
    return [Run(reported.name, definition_sha256(definition), seed, episodes) for seed in context.seeds]


def _done(reported: Reported, pieces: Sequence[tuple[Run, Gone]]) -> Done:
    runs = [run for _, run in pieces]
    return Done(reported, pieces[0][0].episodes, runs, [figures_of(run) for run in runs])


def _introduction(context: Context, done: Sequence[Done]) -> Text:
    seeds = len(done[0].runs)
    how_much = f"Each experiment was run with {seeds} seeds"
    if context.quick:
        how_much += f", {QUICK_EPISODES} episodes each: enough to see that it works, too short for the numbers to hold"
    return Text(
        f"{how_much}. Curves are the median over the seeds of the mean of the last {WINDOW} episodes, with a band from "
        "the 5th to the 95th percentile. Steady from n: of the 100 episodes after the first n at least 98 succeed and "
        "their mean return is within 25 % of that of the run's last quarter. Forces are means over all motions of an "
        "episode; the wrist's stiffness is 15 N/mm and 60 N m/rad. The thesis's torques are divided by ten, because "
        "its sensor gives moments in N m x 10."
    )


def _table(done: Sequence[Done]) -> Table:
    head = ("experiment", "steady from", "return", "force [N]", "torque [N m]", "success", "collisions", "longest run")
    rows = []
    for study in done:
        figures = study.figures
        columns: list[list[float]] = [
            [figure.steady for figure in figures],
            [figure.episode_return for figure in figures],
            [figure.force_n for figure in figures],
            [figure.torque_nm for figure in figures],
            [100 * figure.success for figure in figures],
            [figure.collisions for figure in figures],
            [figure.longest for figure in figures],
        ]
        rows.append((study.reported.name, *(spread(column) for column in columns)))
    caption = "All experiments: median and 90 % interval over seeds; return to success are those of the last quarter."
    return Table("", caption, head, rows)


def _part(context: Context, study: Done) -> list[Part]:
    parts: list[Part] = []
    for quantity in LABELS:
        number = study.reported.figures.get(quantity, "")
        caption = f"{LABELS[quantity][0].upper()}{LABELS[quantity][1:]}, {study.reported.name}."
        parts.append(Figure(number, caption, _curve(study, quantity)))
    rows = compare(study.reported, study.figures)
    if context.quick:
        note = "Short run: the quick report only shows that this can be computed."
        rows = [replace(row, note=f"{row.note} {note}".strip()) for row in rows]
    if rows:
        parts.append(Comparisons(rows))
    if study.reported.name in EXPLORING:
        parts.append(insertion_exploration.table(context, study.reported.name))
    return parts


def _values(study: Done, quantity: Quantity) -> NDArray[np.float64]:
    """Return a quantity of each run and episode, shape (seeds, episodes)."""
    if quantity == "failures":
        return np.array([[letter != "i" for letter in run.outcomes] for run in study.runs], dtype=np.float64)
    by_name = {"return": "returns", "force": "force_n", "torque": "torque_nm"}
    return np.array([getattr(run, by_name[quantity]) for run in study.runs])


def _curve(study: Done, quantity: Quantity) -> str:
    values = _values(study, quantity)
    with drawing() as (figure, ((axes,),)):
        if quantity == "failures":
            whole = values.shape[1] // WINDOW * WINDOW
            blocks = values[:, :whole].reshape(len(values), -1, WINDOW).sum(axis=2)
            starts = np.arange(0, whole, WINDOW)
            axes.bar(starts, np.median(blocks, axis=0), width=WINDOW, align="edge", color=VERMILION, label="median")
            axes.step(starts, blocks.max(axis=0), where="post", color=BLUE, linewidth=0.6, label="worst seed")
            axes.set_ylim(0, WINDOW)
            axes.legend()
        else:
            means = moving_average(values, WINDOW)
            band(axes, list(range(WINDOW - 1, values.shape[1])), means, COLOURS[0], "")
        axes.set_xlabel("episode")
        axes.set_ylabel(LABELS[quantity])
        return svg(figure)


def _policies(done: Sequence[Done]) -> list[Part]:
    """Return the comparison of the two policies over the first episodes, Figs. 6.7 and B.16."""
    both = [study for study in done if study.reported.name in ("chamfered-q-softmax", "chamfered-q-egreedy")]
    if len(both) < 2:
        return []
    with drawing() as (figure, ((axes,),)):
        for study, colour in zip(both, COLOURS, strict=False):
            values = _values(study, "return")[:, :FIRST]
            span = list(range(WINDOW - 1, values.shape[1]))
            band(axes, span, moving_average(values, WINDOW), colour, study.reported.name)
        axes.set_xlabel("episode")
        axes.set_ylabel(LABELS["return"])
        axes.legend()
        drawn = svg(figure)
    caption = f"Softmax and epsilon-greedy over the first {FIRST} episodes (the thesis smoothed its 6.7)."
    return [Heading("Two policies (6.2.1)"), Figure("6.7, B.16", caption, drawn)]


def _overlap(done: Sequence[Done]) -> list[Part]:
    """Return how far a class tells the true contact state, for the round and the square peg."""
    compared = [study for study in done if study.reported.name in OVERLAP]
    if len(compared) < len(OVERLAP):
        return []
    rows = []
    with drawing(1, 2) as (figure, ((left, right),)):
        for study, colour in zip(compared, COLOURS, strict=False):
            first = study.runs[0].blocks
            starts = [block.first_episode for block in first]
            left.plot(starts, [block.entropy_bit for block in first], color=colour, label=study.reported.name)
            right.plot(starts, [block.states for block in first], color=colour)
            last = [run.blocks[-1] for run in study.runs]
            rows.append(
                (
                    study.reported.name,
                    spread([block.states for block in last]),
                    spread([block.purity for block in last]),
                    spread([block.adjusted_rand_index for block in last]),
                    spread([block.entropy_bit for block in last]),
                )
            )
        left.set_ylabel("uncertainty [bit]")
        right.set_ylabel("classes met")
        for axes in (left, right):
            axes.set_xlabel("episode")
        left.legend()
        drawn = svg(figure)
    text = Text(
        "The thesis's square peg forgot what it had learnt, and the thesis supposes that contacts which need different "
        "moves fall into one class (6.5, 7.4). The simulator knows what touches, so that this can be measured: the "
        "uncertainty about the true contact state that is left when the class is known; 0 where each class is one."
    )
    head = ("experiment", "classes met", "purity", "adjusted Rand index", "uncertainty [bit]")
    caption = "Classes against true contact states, last 100 episodes: median and 90 % interval over seeds."
    figure_caption = (
        "Uncertainty about the contact that a class leaves, and classes met, by block of 100 episodes; first seed."
    )
    return [Heading("What a class tells"), text, Table("", caption, head, rows), Figure("", figure_caption, drawn)]
