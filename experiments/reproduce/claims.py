"""What the thesis claims and does not try: sensor and hole turned, other starts, a skill for another shape."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from experiments.evaluate.controllers import RULES
from experiments.reproduce import claims_runs as runs
from experiments.reproduce.chapter import (
    Block,
    CannotRun,
    Chapter,
    Comparisons,
    Figure,
    Heading,
    Table,
    Text,
    in_all_seeds,
    spread,
)
from experiments.reproduce.claims_runs import AXES, FELT, HOLES, LEARNERS, SHAPES, TABLE, WHO, Went
from experiments.reproduce.context import Context
from experiments.reproduce.figures import COLOURS, band, drawing, legend, moving_average, svg

FIRST, LAST = 20, 50
"""Episodes at a run's beginning and end that are told."""
SLACK = 0.06
"""How much less may succeed, of the last episodes, where a thing should not matter: three of fifty."""
WINDOW, EVERY = 10, 6
"""Episodes of a moving average, and from point to point of a curve, which keeps the drawing small."""
NAMES = {TABLE: "table (the thesis's)", FELT: "felt (Treenail's)"}
HEAD = (f"failed of the first {FIRST}", "success at the end [%]", "force at the end [N]")
GOOD = 0.9
"""Part of the last episodes that has to succeed where nothing is changed: who fails there shows nothing elsewhere."""
Of = Mapping[str, Sequence[Went]]


class Asked(NamedTuple):
    """A claim of the thesis, and for which seeds it holds; of the thesis's learner it is compared."""

    who: str
    what: str
    thesis: str
    held: list[bool]
    why: str


def _answers(asked: Sequence[Asked]) -> list[Block]:
    """Return the thesis's learner compared, and beside it what the same comes to with Treenail's."""
    compared = [in_all_seeds(one.what, one.thesis, one.held, one.why) for one in asked if one.who == TABLE]
    others = [(one.what, f"{sum(one.held)} of {len(one.held)} seeds") for one in asked if one.who == FELT]
    blocks: list[Block] = [Comparisons(compared, "Claim and outcome, the thesis's learner")] if compared else []
    return [*blocks, Table("", "The same with Treenail's learner.", ("", "holds for"), others)] if others else blocks


def chapter(context: Context) -> Chapter:
    """Run the claims, and compare."""
    episodes = context.episodes or (runs.QUICK_EPISODES if context.quick else runs.EPISODES)
    played = runs.QUICK_PLAYED if context.quick else runs.PLAYED
    keys = runs.plays(context.seeds, episodes, played)
    went = context.pieces_kept("claims", keys, runs.play, Went)
    by_place: dict[tuple[str, str], list[Went]] = {}
    for key, one in zip(keys, went, strict=True):
        if one is not None:
            by_place.setdefault((key.where, key.who), []).append(one)
    starts, shapes = (_chains(context, what, episodes, played) for what in ("starts", "shapes"))
    if not by_place and not any(starts.values()) and not any(shapes.values()):
        raise CannotRun("no run of the claims is kept; without --kept they are made")
    return Chapter(
        [
            _introduction(episodes, played, len(context.seeds)),
            *_turned("axes", "Any orientation of the sensor's axes", AXES_TEXT, list(AXES), by_place),
            *_turned("hole", "A tilted hole", HOLE_TEXT, list(HOLES), by_place),
            *_starts(starts),
            *_shapes(shapes),
        ]
    )


AXES_TEXT = """"The orientation of the force and torque sensor axes is irrelevant", "the direction of X, Y and Z can be
random" (1858); the same paragraph asks for axes parallel to TOOL. Two rows are parallel and exchanged, the last is
neither. The felt learner has the settings of suite-turned, which take torques as they are read. A rule is told nothing
either, and has the axes in its text."""
HOLE_TEXT = """"The agent can learn the insertion even if the hole's central axis is not vertically aligned", and that
"should not affect the performance" (1858). Where the arm's TOOL is turned with the hole that is no claim; here the hole
leans and neither arm nor task knows: moves and guard are those of an upright one."""


FROZEN_TOO = "a strategy is to serve from any start (1856), if that means the one that was learnt"


def _chains(context: Context, what: str, episodes: int, played: int) -> dict[str, dict[str, list[Went]]]:
    """Return what there is of the chains: by learner and by run."""
    keys = runs.chains(what, context.seeds, episodes, played)
    done = context.pieces_kept(f"claims, {what}", keys, runs.chain, dict[str, Went])
    told: dict[str, dict[str, list[Went]]] = {who: {} for who in LEARNERS}
    for key, one in zip(keys, done, strict=True):
        for name, went in (one or {}).items():
            told[key.who].setdefault(name, []).append(went)
    return told


def _introduction(episodes: int, played: int, seeds: int) -> Text:
    return Text(
        "Chapter 5 says of the controller what chapter 6 does not try: sensor and hole may stand anyhow, what is "
        "learnt from one start serves from any, and what is learnt with a round peg serves with a square one (4.2.2). "
        f"Here is each as an experiment: {episodes} episodes of who learns, {played} of who does not, up to {seeds} "
        f"seeds from {runs.FIRST_SEED} on. Both learners begin with nothing learnt unless it is said. The "
        "table is the experiment of chapter 6 as it is here; the felt learner is that of the suite's tasks, whose "
        "reward prices force. Beside them are two hand-written rules (docs/evaluate.md), same starts and noise. "
        f"The end is the last {LAST} episodes of who learns, and all of who does not."
    )


def _cells(went: Sequence[Went], learns: bool) -> tuple[str, ...]:
    if not went:
        return ("not run", "", "")
    failed = spread([_failed(one) for one in went]) if learns else ""
    return failed, spread([100 * _success(one, learns) for one in went]), spread([_force(one, learns) for one in went])


def _failed(one: Went) -> int:
    return sum(letter != "i" for letter in one.outcomes[:FIRST])


def _success(one: Went, learns: bool = True) -> float:
    counted = one.outcomes[-LAST:] if learns else one.outcomes
    return counted.count("i") / len(counted)


def _force(one: Went, learns: bool = True) -> float:
    return float(np.mean(one.force_n[-LAST:] if learns else one.force_n))


def _turned(
    claim: str, title: str, text: str, conditions: Sequence[str], done: Mapping[tuple[str, str], Sequence[Went]]
) -> list[Block]:
    rows, asked = list[tuple[str, ...]](), list[Asked]()
    for who in WHO:
        base = done.get((f"{claim}: {conditions[0]}", who), ())
        for condition in conditions:
            went = done.get((f"{claim}: {condition}", who), ())
            rows.append((NAMES.get(who, who), condition, str(len(went)), *_cells(went, who in LEARNERS)))
            if who in LEARNERS and condition != conditions[0] and went and base:
                asked.append(
                    Asked(
                        who,
                        f"{condition}: as many succeed at the end as with {conditions[0]}",
                        "it is irrelevant (1858)" if claim == "axes" else "it should not matter (1858)",
                        [_as_good(one, other) for other, one in zip(base, went, strict=False)],
                        f"Within {100 * SLACK:g} of 100, and {100 * GOOD:g} of 100 where nothing is turned; see above.",
                    )
                )
    head = ("who", "axes" if claim == "axes" else "hole", "seeds", *HEAD)
    table = Table("", f"{title}: median and 90 % interval over the seeds.", head, rows)
    return [Heading(title), Text(text), table, *_answers(asked)]


def _as_good(one: Went, base: Went, learns: bool = True) -> bool:
    """Return whether as many succeed as where nothing is changed, which has to be learnt itself."""
    usual = _success(base, learns)
    return usual >= GOOD and _success(one, learns) >= usual - SLACK


def _starts(done: Mapping[str, Of]) -> list[Block]:
    rows, asked = list[tuple[str, ...]](), list[Asked]()
    for who, of in done.items():
        for name, went in of.items():
            rule = name.split()[0] in RULES
            if not rule or who == FELT:
                learns = name.startswith("learning") or "learning on" in name
                rows.append(("" if rule else NAMES[who], name, str(len(went)), *_cells(went, learns)))
        if not of:
            continue
        asked += [
            Asked(
                who,
                f"{what}: as many succeed as {than}",
                claimed,
                [_as_good(one, base, learns) for base, one in zip(of[than], of[what], strict=True)],
                f"Within {100 * SLACK:g} of 100, and {100 * GOOD:g} of 100 from one start; see above.",
            )
            for what, than, learns, claimed in (
                (
                    "learning at random starts",
                    "learning at one start",
                    True,
                    "what is learnt from one start can be from any (1856)",
                ),
                ("learnt at one, frozen at random", "learnt at one, frozen there", False, FROZEN_TOO),
            )
        ]
    if not rows:
        return []
    return [
        Heading("Learnt at one start, tried at random ones"),
        Text(
            "Every insertion of the thesis begins at one place; it says that whoever can learn from there can learn "
            "from any (1856). Here the one start is the thesis's, 2.7 mm from the axis and tilted by 1.8 degrees; "
            "random ones are within 2 mm and 1.5 degrees of the axis, along each. Frozen, nothing is learnt any more "
            "and the best known move is made, with other seeds."
        ),
        Table("", "One start and random ones: median and 90 % interval.", ("who", "what", "seeds", *HEAD), rows),
        *_answers(asked),
    ]


def _shapes(done: Mapping[str, Of]) -> list[Block]:
    rows, asked = list[tuple[str, ...]](), list[Asked]()
    for who, of in done.items():
        for name, went in of.items():
            what, how = name.split(", ")
            learns = how not in RULES and not how.startswith("frozen")
            returned = spread([float(np.mean(one.returns[:FIRST])) for one in went]) if learns else ""
            rows.append((NAMES[who], what, how, str(len(went)), *_cells(went, learns), returned))
        for before, shape in pairwise(SHAPES):
            if went_on := of.get(f"{shape}, from {before}"):
                asked += _of_shape(who, before, shape, went_on, of[f"{shape}, from nothing"])
    if not rows:
        return []
    head = ("who", "peg", "how", "seeds", *HEAD, f"return of the first {FIRST}")
    return [
        Heading("From round to square to triangle"),
        Text(
            "States are orientations of surfaces, so that a change from a round to a square peg should not affect the "
            "controller in the early stages of insertion (1180). The square task has two moves more, turns about the "
            "peg, and steps of half the size. `treenail checkpoint map` makes of a skill one for these moves: moves "
            "of one name and direction keep table, model and visits to the last bit, ±RZ begin unknown. All contact "
            "states are kept. With it a run on the square peg begins, with what that learns one on the triangular peg. "
            "Frozen, ±RZ is never made on the square peg. Each table run begins at the thesis's start of its peg, each "
            "felt one anywhere within the suite's."
        ),
        Table("", "With and without what another shape taught: median and 90 % interval.", head, rows),
        *_curves(done),
        *_answers(asked),
    ]


def _of_shape(who: str, before: str, shape: str, with_it: Sequence[Went], without: Sequence[Went]) -> list[Asked]:
    return [
        Asked(
            who,
            f"{shape} after {before}: at most one of the first {FIRST} fails",
            "not affected in the early stages (1180)",
            [_failed(one) <= 1 for one in with_it],
            "Corners are surfaces that a round hole has not, and the moves against them are unknown.",
        ),
        Asked(
            who,
            f"{shape}: the first {FIRST} return more with what {before} taught than from nothing",
            "a set of surfaces is learnt separately (1180)",
            [
                float(np.mean(one.returns[:FIRST])) > float(np.mean(other.returns[:FIRST]))
                for one, other in zip(with_it, without, strict=True)
            ],
            "What was learnt is of other step sizes, and states with it may be more of a burden than none.",
        ),
    ]


def _curves(done: Mapping[str, Of]) -> list[Block]:
    some = [who for who in LEARNERS if done[who] and len(next(iter(done[who].values()))[0].returns) >= 2 * WINDOW]
    if not some:
        return []
    with drawing(len(some), 2) as (figure, places):
        for row, who in zip(places, some, strict=True):
            for axes, before, shape in zip(row, SHAPES, SHAPES[1:], strict=False):
                for how, colour in ((f"from {before}", COLOURS[1]), ("from nothing", COLOURS[0])):
                    returns = np.array([one.returns for one in done[who][f"{shape}, {how}"]])
                    values = moving_average(returns, WINDOW)[:, ::EVERY]
                    span = list(range(WINDOW, WINDOW + EVERY * values.shape[1], EVERY))
                    band(axes, span, values, colour, "with a skill" if how != "from nothing" else how)
                axes.set_title(f"{who}: {shape}", fontsize=9)
                axes.set_xlabel("episode")
            row[0].set_ylabel("return of the episode")
        legend(places[0])
        drawn = svg(figure)
    caption = (
        f"A skill of another shape, and none: mean return of {WINDOW} episodes, median and 90 % band of the seeds. "
        "The returns of the two learners are of different rewards."
    )
    return [Figure("", caption, drawn)]
