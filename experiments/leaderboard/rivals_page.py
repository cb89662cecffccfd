"""The rivals' board as one page of Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from experiments.leaderboard.board import Board, Row
from experiments.leaderboard.figures import FIRST, Figures
from experiments.leaderboard.methods import TREENAIL
from experiments.leaderboard.page import methods, spread, success, table

ALIKE = 0.05
"""Forces closer than this part are told as alike."""
TITLE = "The controllers of chapter 2, beside the learner"
COMMAND = "treenail leaderboard --rivals"
HOW = f"""The thesis's chapter 2 tells of earlier controllers that insert by feel. Here they are behind the same task:
the same moves, starts, sensor and errors, rewards and seeds; what each was told beside that stands in the first table.
They are written after the thesis's account of them, a few lines each, not after their authors' code, and tuned on seeds
5001 and 5002, which nothing here reports. They insert round and square pegs with a chamfer; nothing here says how
they do on narrower or chamferless holes.

`{COMMAND}` makes this page. It runs what is not done yet and writes `rivals.md` and `rivals.json`; `--episodes`,
`--seeds`, `--tasks` and `--methods` change what is run."""
TABLES = f"""*From nothing*: each seed's episodes begin somewhere else each time; who is taught was taught before, who
does not learn is as it is. *Failures in the first {FIRST}*: median (most) over the seeds. *Steady*: the episode from
which on a hundred go by with 98 insertions and a return within a quarter of that at the end, each seed's; who
does not learn has none. *Success* is of the last third of the episodes, of who does not learn of all, with its 95 %
interval (Wilson) and, in square brackets, the worst seed's. *Force* is the mean over all moves, free ones included; in
brackets the least and the most of the seeds' means.

*Better* and *worse* below a table: inserts more often than the intervals can explain, or as often with a force that
differs by more than {100 * ALIKE:.0f} %.

*At unseen starts*: learnt, or taught, at the thesis's one start only, then frozen and tried at random starts, seeds
1000 higher. Rules and the spring learn nothing, so that this is for them the same with other starts."""
HEAD = (
    "method",
    f"failures in the first {FIRST}",
    "steady",
    "success",
    "force [N]",
    "moves",
    "unseen starts: success",
    "force [N]",
)


def page(facts: Mapping[str, str], random: Board, unseen: Board) -> str:
    """Return the page of what was learnt at random starts, and of what was frozen and tried at unseen ones."""
    parts = [f"# {TITLE}", HOW, "\n".join(f"- {label}: {text}" for label, text in facts.items())]
    parts += ["## What each was told", methods(random.methods, published=True), "## What it came to", TABLES]
    learn = {method.name for method in random.methods if method.kind == "learn"}
    for task in random.tasks:
        rows = [row for row in random.rows if row["task"] == task]
        cells = [_cells(row, row["method"] in learn, _there(unseen, row)) for row in rows if row["figures"]]
        parts += [f"### {task}", table(HEAD, cells) if cells else ""]
        parts += [
            _against(rows, "From nothing"),
            _against([row for row in unseen.rows if row["task"] == task], "Unseen"),
        ]
        parts += ["\n".join(f"- `{row['method']}`: {'; '.join(row['missing'])}" for row in rows if row["missing"])]
    return "\n\n".join(part for part in parts if part) + "\n"


def _there(unseen: Board, row: Row) -> Figures | None:
    other = unseen.row(row["task"], row["method"])
    return None if other is None else other["figures"]


def _cells(row: Row, learns: bool, there: Figures | None) -> list[str]:
    figures = row["figures"]
    assert figures is not None
    return [
        f"`{row['method']}`",
        f"{figures['first_failures_median']:g} ({figures['first_failures_most']})",
        ", ".join("never" if since is None else f"{since}" for since in figures["steady_from"]) if learns else "",
        success(figures),
        spread(figures["force_n"], 2),
        "none" if figures["moves"] is None else f"{figures['moves']['mean']:.0f}",
        "" if there is None else success(there),
        "" if there is None else spread(there["force_n"], 2),
    ]


def _against(rows: Sequence[Row], where: str) -> str:
    """Return in words who is better than the learner on a task, and who is not."""
    made = {row["method"]: figures for row in rows if (figures := row["figures"]) is not None}
    ours = made.pop(TREENAIL, None)
    if ours is None or not made:
        return ""
    better, alike, worse = list[str](), list[str](), list[str]()
    for name, theirs in made.items():
        ratio = theirs["force_n"]["mean"] / ours["force_n"]["mean"]
        if theirs["success_high"] < ours["success_low"] or (
            theirs["success"] <= ours["success"] and ratio > 1.0 + ALIKE
        ):
            worse.append(f"`{name}`")
        elif theirs["success_low"] > ours["success_high"] or (
            theirs["success"] >= ours["success"] and ratio < 1.0 - ALIKE
        ):
            better.append(f"`{name}`")
        else:
            alike.append(f"`{name}`")
    told = [
        f"{what} {', '.join(names)}"
        for what, names in (
            (f"better than `{TREENAIL}`:", better),
            ("neither better nor worse:", alike),
            ("worse:", worse),
        )
        if names
    ]
    return f"{where}, {'; '.join(told)}."
