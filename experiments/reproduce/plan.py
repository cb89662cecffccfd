"""The plan of 5.2.2 as it stands there: all learners and policies under the same conditions, and what these change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from experiments.reproduce import plan_runs as plan
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
    in_all_seeds,
    spread,
)
from experiments.reproduce.context import Context
from experiments.reproduce.figures import COLOURS, band, drawing, legend, moving_average, svg
from experiments.reproduce.insertion_compare import RETURN_TOLERANCE, figures_of
from experiments.reproduce.plan_runs import CONDITIONS, LEARNERS, POLICIES, Condition
from experiments.reproduce.stages import stages
from experiments.reproduce.variants import Tried, by_condition, tried
from experiments.reproduce.verdicts import near

WINDOW = 10
EVERY = 10
"""Episodes from point to point of a curve, which keeps the drawing small."""
ENOUGH = 3
"""Seeds below which a comparison says nothing, but in a quick report, which only shows that it can be made."""
EARLY = 100
"""Episodes over which learning is compared early on."""
RETURN = -15.0
"""To which all come in the thesis (1957, 2294)."""
HEAD = ("steady from", "return", "force [N]", "success [%]", "collisions")
Runs = Mapping[Condition, Sequence[Tried]]


def chapter(context: Context) -> Chapter:
    """Run the plan, and the conference paper's two schedules on its own task."""
    episodes = context.episodes or (plan.QUICK_EPISODES if context.quick else plan.EPISODES)
    count = len(context.seeds)
    runs = by_condition(CONDITIONS, count, tried(context, plan.of_plan(context.seeds, episodes)))
    names = list(plan.SCHEDULES)
    random = by_condition(names, count, tried(context, plan.of_schedules(context.seeds, episodes)))
    if not any(runs.values()):
        raise CannotRun("no run of the plan is kept; without --kept they are made")
    return Chapter(
        [
            _introduction(episodes, count),
            _table(runs),
            *_curves(runs),
            *_compared(runs, 1 if context.quick else ENOUGH),
            *_schedules(random, episodes),
        ]
    )


def _introduction(episodes: int, seeds: int) -> Text:
    return Text(
        "The thesis plans to compare Q-learning and SARSA, each with epsilon-greedy and Gibbs' policy, on the round "
        "peg and the chamfered hole, under exactly the same conditions (1788, 1790); chapter 6 then shows three of "
        f"these, each once. Here is all of it: the task {plan.TASK} with one learning rate of {plan.ALPHA:g}, one "
        f"discount factor of {plan.GAMMA:g} and one vigilance of {plan.RHO:g} for all, {episodes} episodes, up to "
        f"{seeds} seeds. Softmax is beta = 4 + 0.3 an episode; the two schedules are epsilon = 1 / (mu n + 1) with "
        "mu = 0.1 (I) and mu = 0.01 (II, which explores longer), in place of the conference paper's two, whose curves "
        "are lost. "
        "Each is done with collisions from 10 N (Table B.1, 2849) and from 20 N (1832), and with rotations about the "
        "peg's tip and about the gripper's interface (2959), 130 mm behind it. Return, force and success are means of "
        "the last quarter; steady is as in chapter 6: of a hundred episodes 98 succeed."
    )


def _cells(runs: Sequence[Tried]) -> tuple[str, ...]:
    if not runs:
        return ("not run",) + ("",) * (len(HEAD) - 1)
    figures = [figures_of(run.gone) for run in runs]
    return (
        spread([figure.steady for figure in figures]),
        spread([figure.episode_return for figure in figures]),
        spread([figure.force_n for figure in figures]),
        spread([100 * figure.success for figure in figures]),
        spread([figure.collisions for figure in figures]),
    )


def _table(runs: Runs) -> Table:
    rows = [
        (c.turns_about, f"{c.collision_n:g} N", c.learner, c.policy, str(len(done)), *_cells(done))
        for c, done in runs.items()
    ]
    head = ("turns about", "collision", "learner", "policy", "seeds", *HEAD)
    return Table("", "The whole plan: median and 90 % interval over the seeds.", head, rows)


def _curves(runs: Runs) -> list[Block]:
    with drawing(1, len(LEARNERS)) as (figure, (places,)):
        lowest = 0.0
        for axes, learner in zip(places, LEARNERS, strict=True):
            for policy, colour in zip(POLICIES, COLOURS, strict=False):
                done = runs[Condition(learner, policy, plan.COLLISIONS_N[0], plan.CENTRES_MM[0])]
                if not done or len(done[0].gone.returns) < WINDOW:
                    continue
                values = moving_average(np.array([run.gone.returns for run in done]), WINDOW)[:, ::EVERY]
                band(axes, list(range(WINDOW, WINDOW + EVERY * values.shape[1], EVERY)), values, colour, policy)
                lowest = min(lowest, float(np.median(values, axis=0).min()))
            axes.set_title(learner)
            axes.set_xlabel("episode")
        for axes in places:
            axes.set_ylim(1.1 * lowest - 1.0, 0)
        places[0].set_ylabel("return of the episode")
        legend(places)
        drawn = svg(figure)
    caption = (
        f"All learners and policies, about the tip, 10 N: mean of {WINDOW} episodes, median and 90 % band of the "
        "seeds. The thesis shows the left panel's softmax and ε = 0.1, one run of each, smoothed."
    )
    return [Figure("6.7", caption, drawn)]


def _compared(runs: Runs, enough: int) -> list[Block]:
    softmax, greedy, sarsa = (
        runs[Condition(learner, policy, plan.COLLISIONS_N[0], plan.CENTRES_MM[0])]
        for learner, policy in (("Q-learning", "softmax"), ("Q-learning", "ε = 0.1"), ("SARSA", "softmax"))
    )
    if min(len(softmax), len(greedy), len(sarsa)) < enough:
        return [
            Text(f"Nothing is compared with the thesis yet: fewer than {enough} seeds of its three runs are there.")
        ]
    of_67, of_sarsa = list(zip(softmax, greedy, strict=False)), list(zip(softmax, sarsa, strict=False))
    why = "One run of each, as the thesis has, could have shown either: compare the intervals above."
    rows: list[Comparison] = []
    if of_67:
        rows += [
            in_all_seeds(
                f"Fig. 6.7: softmax has the better mean return over the first {EARLY} episodes",
                "it rises and settles quickly, ε-greedy more steadily (1973)",
                [_early(one) > _early(other) for one, other in of_67],
                why,
            ),
            Comparison(
                "Q-learning: return of the last quarter, ε = 0.1 less softmax",
                "0: both come to -15 (1957)",
                [_late(other) - _late(one) for one, other in of_67],
                near(0.0, RETURN_TOLERANCE * -RETURN),
                "With ε = 0.1 every tenth move is random for ever, and some of these collide at -100.",
                note="Matches within a quarter of 15.",
            ),
        ]
    if of_sarsa:
        rows += [
            in_all_seeds(
                "SARSA is steady later than Q-learning, both with softmax",
                "200 episodes against 40 (2294)",
                [figures_of(other.gone).steady > figures_of(one.gone).steady for one, other in of_sarsa],
                why,
                note="Where neither ever is, it is not later.",
            ),
            Comparison(
                "Return of the last quarter, SARSA less Q-learning, both with softmax",
                "0: both come to -15 (2294)",
                [_late(other) - _late(one) for one, other in of_sarsa],
                near(0.0, RETURN_TOLERANCE * -RETURN),
                why,
                note="Matches within a quarter of 15.",
            ),
        ]
    blocks: list[Block] = [Comparisons(rows, "What the plan says about Fig. 6.7 and about SARSA")] if rows else []
    staged = {"Q-learning, softmax": softmax, "Q-learning, ε = 0.1": greedy, "SARSA, softmax": sarsa}
    all_stages = [row for name, done in staged.items() if done for row in stages(name, done)]
    if all_stages:
        blocks += [
            Heading("Three stages of learning, and one tenth of the force"),
            Text(
                "The thesis sees three stages in all its experiments: in the first 10 to 20 episodes four of five "
                "fail; by 70 at the latest the learner has settled; then only single insertions fail (2211 to 2213). "
                "And it says that force falls to one tenth (2298)."
            ),
            Comparisons(all_stages, "Stages and forces of the plan's runs, about the tip, 10 N"),
        ]
    return blocks


def _early(run: Tried) -> float:
    return float(np.mean(run.gone.returns[:EARLY]))


def _late(run: Tried) -> float:
    return figures_of(run.gone).episode_return


def _schedules(runs: Mapping[str, Sequence[Tried]], episodes: int) -> list[Block]:
    rows = [
        (name, f"{plan.SCHEDULES[name].mu:g}", str(len(done)), f"{episodes}", *_cells(done))
        for name, done in runs.items()
    ]
    blocks: list[Block] = [
        Heading("The conference paper's two schedules, on its own task"),
        Text(
            f"The task {plan.RANDOM_STARTS}: random starts, reward by the change of force. The paper lets both "
            "schedules learn 2000 episodes and sees Policy I do better (3299)."
        ),
        Table("", "Both schedules from random starts.", ("policy", "mu", "seeds", "episodes", *HEAD), rows),
    ]
    pairs = list(zip(*runs.values(), strict=False))
    if pairs:
        better = in_all_seeds(
            "Policy I has the better mean return",
            "yes (3299)",
            [float(np.mean(one.gone.returns)) > float(np.mean(two.gone.returns)) for one, two in pairs],
            "The schedules are ours, as the paper's are lost.",
        )
        blocks.append(Comparisons([better], "Policy I and Policy II"))
    return blocks
