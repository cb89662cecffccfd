"""The board as one page of Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from experiments.leaderboard.board import Board, Row
from experiments.leaderboard.figures import FIRST, Figures, Spread
from experiments.leaderboard.jobs import LEARNER
from experiments.leaderboard.methods import TREENAIL, Method
from experiments.leaderboard.plan import Length
from experiments.leaderboard.told import told
from experiments.reproduce.code import origin

HEAD = (
    "method",
    f"failures in the first {FIRST}: median (most)",
    "success at the end",
    "force [N]",
    "of the rule's",
    "peak [N]",
    "moves",
    "of the rule's",
)
LEARNING = f"""Each method learns from nothing, with the errors of sensor and arm on, each episode from somewhere
else; who does not learn meets the same starts and the same noise. *Success at the end* is of the last hundred episodes
of a run of three hundred (the last third of a shorter one), all seeds pooled, with its 95 % interval (Wilson) and, in
square brackets, the worst seed's; of who does not learn, of all. Forces are means over all moves of an episode, free
ones included; in brackets the least and the most of the seeds' means. *Moves* are of insertions that succeeded. The
oracle knows the pose and plans without noise from the first start of each seed: what could be had, no more. A failure
among the first {FIRST} is a scratched part. What each method was told stands at the end."""
TOLD_HEAD = """Beside what it feels. *Supervision*: who says which move is right, or how good one was. *Geometry*: what
is told of shape and sensor; *where the sensor sits* is the lever that the task's definition refers torques by, and
where a sensor stands anyhow (`suite-turned*`), who learns is told nothing of it. *Pose*: what is told of where peg and
hole are."""


def facts(length: Length, code: Sequence[str] = LEARNER) -> dict[str, str]:
    """Return what was run and where, by label."""
    return {
        **origin(code),
        "seeds": f"{len(length.seeds)}: {', '.join(map(str, length.seeds))}",
        "episodes": f"{length.episodes} of who learns, {length.baseline_episodes} of who does not",
    }


def page(title: str, how: str, facts: Mapping[str, str], board: Board, pictures: Sequence[str]) -> str:
    """Return the page; ``how`` says what was done, ``pictures`` are names of files beside it."""
    verdicts = [row for row in board.rows if row["verdict"] and row["method"] == TREENAIL]
    parts = [f"# {title}", how, "\n".join(f"- {label}: {text}" for label, text in facts.items())]
    if verdicts:
        met = sum(not row["verdict"].startswith("missed") for row in verdicts)
        why = "" if met == len(verdicts) else " Why the others are missed stands in Treenail's `docs/learning.md`."
        told_of = f"`{TREENAIL}` meets {met} of {len(verdicts)} targets.{why}"
        parts += [f"## What was aimed at\n\n{told_of}", _targets(verdicts)]
    parts += [f"![{name.removesuffix('.png').replace('-', ', ')}]({name})" for name in pictures]
    parts += ["## The tasks", *(_task(task, board) for task in board.tasks)]
    parts += ["## The methods, and what each was told", TOLD_HEAD, methods(board.methods)]
    return "\n\n".join(parts) + "\n"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown, its first column to the left."""
    lines = [head, ["---", *["---:"] * (len(head) - 1)], *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def methods(some: Sequence[Method], *, published: bool = False) -> str:
    """Return the table of methods, what each is and was told; with ``published`` also how it differs from that."""
    head = ("method", "what it is", "supervision", "geometry", "pose", "otherwise than published")
    columns = len(head) if published else len(head) - 1
    rows = [(f"`{method.name}`", method.about, *told(method))[:columns] for method in some]
    return table(head[:columns], rows).replace("---:", "---")


def success(figures: Figures) -> str:
    """Return a rate with its interval and the worst seed."""
    interval = f"{percent(figures['success_low'])} to {percent(figures['success_high'])}"
    worst = f" [{percent(figures['success_worst_seed'])}]" if len(figures["seeds"]) > 1 else ""
    return f"{percent(figures['success'])} % ({interval}){worst}"


def percent(part: float) -> str:
    """Return a part of 1 in percent; what is not all is never rounded to all."""
    text = f"{100 * part:.1f}"
    return "100" if part == 1.0 else "99.9" if text == "100.0" else text


def spread(values: Spread, digits: int) -> str:
    """Return a mean with the least and the most of the seeds'."""
    return f"{values['mean']:.{digits}f} ({values['least']:.{digits}f} to {values['most']:.{digits}f})"


def _task(task: str, board: Board) -> str:
    rows = [row for row in board.rows if row["task"] == task]
    some = [_cells(row) for row in rows if row["figures"] is not None]
    notes = [f"- `{row['method']}`: {'; '.join(row['missing'])}" for row in rows if row["missing"]]
    return "\n\n".join([f"### {task}", *([table(HEAD, some)] if some else []), *(["\n".join(notes)] if notes else [])])


def _cells(row: Row) -> list[str]:
    figures = row["figures"]
    assert figures is not None
    learns_or_plays = figures["episodes"] > 1
    first = f"{figures['first_failures_median']:g} ({figures['first_failures_most']})" if learns_or_plays else ""
    force_of, moves_of = row["force_of_rule"], row["moves_of_rule"]
    return [
        f"`{row['method']}`",
        first,
        success(figures) if learns_or_plays else "",
        spread(figures["force_n"], 2),
        "" if force_of is None else f"{force_of:.2f}",
        f"{figures['peak_n']['mean']:.1f}",
        "none" if figures["moves"] is None else spread(figures["moves"], 0),
        "" if moves_of is None else f"{moves_of:.2f}",
    ]


def _targets(rows: Sequence[Row]) -> str:
    return table(("task", "verdict"), [(row["task"], row["verdict"]) for row in rows]).replace(
        "| --- | ---: |", "| --- | --- |"
    )
