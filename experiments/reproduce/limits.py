"""Tasks at both collision limits that the thesis names, what its rule against standing still prevents, and a loop."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np

from experiments.reproduce import limits_runs as limits
from experiments.reproduce.chapter import (
    Block,
    CannotRun,
    Chapter,
    Comparison,
    Comparisons,
    Figure,
    Heading,
    Table,
    Text,
    shown,
    spread,
)
from experiments.reproduce.context import Context
from experiments.reproduce.figures import COLOURS, band, drawing, legend, moving_average, svg
from experiments.reproduce.insertion_compare import compare, figures_of
from experiments.reproduce.insertion_thesis import REPORTED
from experiments.reproduce.limits_runs import CHAMFERLESS, CONDITIONS, SQUARE, Condition
from experiments.reproduce.variants import LOOP, Stuck, Tried, by_condition, tried
from experiments.reproduce.verdicts import Verdict, always

WINDOW, EVERY = 10, 10
"""Episodes of a moving average, and from point to point of a curve, which keeps the drawing small."""
HERE = "the table below counts"
"""Words of a reason that is written for another chapter."""
ENDLESS = "+RZ -RZ"
"""The loop that the thesis saw (2257)."""
Runs = Mapping[Condition, Sequence[Tried]]


def chapter(context: Context) -> Chapter:
    """Run the tasks, and compare."""
    episodes = context.episodes or (limits.QUICK_EPISODES if context.quick else limits.EPISODES)
    done = tried(context, limits.runs(context.seeds, episodes))
    runs = by_condition(CONDITIONS, len(context.seeds), done)
    if not any(runs.values()):
        raise CannotRun("no run of these is kept; without --kept they are made")
    usual = {condition: done for condition, done in runs.items() if condition.is_usual}
    return Chapter(
        [
            _introduction(episodes),
            _table(usual),
            _curves(usual),
            *_compared(usual),
            *_rule(runs),
            *_loop(runs),
        ]
    )


def _introduction(episodes: int) -> Text:
    return Text(
        "Table B.1 with its 10 N leaves out the hole without chamfer and the square peg (2847); 5.3 speaks of 20 N for "
        "all (1832), and for the square peg 12.92 N are plotted (2173), which a limit of 10 N would hardly have let "
        f"happen. So here are both, {episodes} episodes each, all else as in the experiments of chapter 6; the thesis "
        "shows 600 episodes of the square peg (2155). The guard's hard limit is twice the collision's. Return, force "
        "and success are means of the last quarter."
    )


def _table(runs: Runs) -> Table:
    rows = []
    for condition, done in runs.items():
        label = (condition.task, f"{condition.collision_n:g} N", str(len(done)))
        figures = [figures_of(run.gone) for run in done]
        if not figures:
            rows.append((*label, "not run", *[""] * 6))
            continue
        rows.append(
            (
                *label,
                spread([figure.steady for figure in figures]),
                spread([figure.episode_return for figure in figures]),
                spread([figure.force_n for figure in figures]),
                spread([100 * figure.success for figure in figures]),
                spread([figure.collisions for figure in figures]),
                spread([run.gone.outcomes.count("p") for run in done]),
                spread([figure.longest for figure in figures]),
            )
        )
    head = ("experiment", "collision", "seeds", "steady from", "return", "force [N]", "success [%]", "collisions")
    caption = "At 10 and at 20 N: median and 90 % interval over the seeds."
    return Table("", caption, (*head, "without progress", "longest series"), rows)


def _curves(runs: Runs) -> Figure:
    with drawing(1, len(limits.TASKS)) as (figure, (places,)):
        for axes, task in zip(places, limits.TASKS, strict=True):
            of_task = [(condition, done) for condition, done in runs.items() if condition.task == task]
            for (condition, done), colour in zip(of_task, COLOURS, strict=False):
                if not done or len(done[0].gone.outcomes) < WINDOW:
                    continue
                inserted = np.array([[letter == "i" for letter in run.gone.outcomes] for run in done], dtype=np.float64)
                rates = 100 * moving_average(inserted, WINDOW)[:, ::EVERY]
                span = list(range(WINDOW, WINDOW + EVERY * rates.shape[1], EVERY))
                band(axes, span, rates, colour, f"{condition.collision_n:g} N")
            axes.set_title(task.replace("-q-", "\n"), fontsize=9)
            axes.set_ylim(0, 102)
            axes.set_xlabel("episode")
        places[0].set_ylabel("success [%]")
        legend(places)
        drawn = svg(figure)
    caption = f"Success at both limits: mean of {WINDOW} episodes, median and 90 % band of the seeds."
    return Figure("", caption, drawn)


def _compared(runs: Runs) -> list[Block]:
    reported = {each.name: each for each in REPORTED}
    rows: list[Comparison] = []
    for condition, done in runs.items():
        if done:
            named = dataclasses.replace(reported[condition.task], name=f"{condition.task}, {condition.collision_n:g} N")
            rows += compare(named, [figures_of(run.gone) for run in done])
    rows = [dataclasses.replace(row, why=row.why.replace(HERE, "the report's insertions count")) for row in rows]
    caption = (
        "Beside the thesis's numbers, at both limits; these runs are shorter, and the last quarter is that of these"
    )
    return [Comparisons(rows, caption)] if rows else []


def _rule(runs: Runs) -> list[Block]:
    rows, comparisons = list[tuple[str, ...]](), list[Comparison]()
    for condition in CONDITIONS:
        done = runs[condition]
        if condition.task != CHAMFERLESS or not done:
            continue
        ends = [Counter(run.gone.outcomes) for run in done]
        away = [float(np.median(run.away_mm[-len(run.away_mm) // 4 :])) for run in done]
        farthest = [max(run.away_mm) for run in done]
        rows.append(
            (
                f"{condition.collision_n:g} N",
                "with" if condition.rule else "without",
                str(len(done)),
                *(spread([counts[letter] for counts in ends]) for letter in "icpm"),
                spread(away),
                spread(farthest),
            )
        )
        if not condition.rule:
            inserted = [float(counts["i"]) for counts in ends]
            comparisons.append(
                Comparison(
                    f"Hole without chamfer, no rule, {condition.collision_n:g} N: insertions",
                    "none in 2000 episodes (2249)",
                    inserted,
                    always(0.0),
                    "How large the thesis's part was and which force ended its episodes is not said; here the face "
                    "reaches 45 mm beyond the mouth.",
                )
            )
    if not comparisons:
        return []
    head = ("collision", "rule", "seeds", "inserted", "collided", "no progress", "too many moves")
    return [
        Heading("The hole without chamfer, without the rule"),
        Text(
            "Before it gave -50 for a hundred moves without progress, the thesis had no success at all: every episode "
            "ended by force or by losing the surface, and what was learnt was to slide away from the hole, beyond all "
            "limits (2247, 2249). Here is the same, softmax, with and without; distances are of the tip from the "
            "hole's axis when an episode ended, which only the simulator knows. The start is 2.7 mm away."
        ),
        Table(
            "",
            "Ends of the episodes, and how far from the axis.",
            (*head, "at the end [mm]: median of the last quarter", "farthest [mm]"),
            rows,
        ),
        Comparisons(comparisons, "The negative result"),
    ]


def _loop(runs: Runs) -> list[Block]:
    rows, comparisons = list[tuple[str, ...]](), list[Comparison]()
    for condition in CONDITIONS:
        done = runs[condition]
        if condition.task != SQUARE or not done:
            continue
        stuck = [end for run in done for end in run.stuck]
        loops = Counter(end.loop for end in stuck if end.loop)
        others = ", ".join(f"{pair} {count}" for pair, count in loops.most_common(4) if pair != ENDLESS)
        limit = f"{condition.collision_n:g} N" + ("" if condition.errors else ", no errors of sensor and arm")
        rows.append(
            (
                limit,
                str(len(done)),
                str(len(stuck)),
                str(sum(loops.values())),
                str(loops[ENDLESS]),
                others or "none",
                _turning(stuck),
            )
        )
        comparisons.append(
            Comparison(
                f"Square peg, {limit}: episodes that end in the loop {ENDLESS}",
                "yes, systematically towards the end (2257)",
                f"{loops[ENDLESS]} of {len(stuck)} without progress",
                Verdict.MATCHES if loops[ENDLESS] else Verdict.DIFFERS,
                "The runs are shorter than the thesis's 1800 episodes.",
            )
        )
    if not rows:
        return []
    return [
        Heading("The square peg's endless loop"),
        Text(
            "Towards the end the thesis's square peg turned by +0.1° in one class and by -0.1° in another, for ever, "
            "until the rule ended the episode (2257). An episode counts as such a loop when its last "
            f"{LOOP} decisions alternate between two moves. Errors of sensor and arm might break such a loop, so that "
            "there are runs without them, too."
        ),
        Table(
            "",
            "Episodes of all seeds that ended without progress, and the loops among them.",
            ("collision", "seeds", "without progress", "in a loop of two", ENDLESS, "other loops", "turns about Z"),
            rows,
        ),
        Comparisons(comparisons, "The endless loop"),
    ]


def _turning(stuck: Sequence[Stuck]) -> str:
    """Return how much of the last decisions of such episodes turned about Z."""
    if not stuck:
        return "none"
    return f"{shown(100 * float(np.mean([end.rz_part for end in stuck])))} % of their last 100 decisions"
