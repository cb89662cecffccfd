"""The study as one page of Markdown. What people conclude from it is their own section, which is kept as it is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from experiments.deep.folding import WINDOW, Row
from experiments.deep.jobs import FROZEN
from experiments.deep.methods import CHOSEN, Method
from experiments.deep.plan import TUNING_EPISODES, TUNING_SEEDS
from experiments.evaluate.controllers import RULES
from experiments.leaderboard.figures import FIRST
from experiments.leaderboard.page import percent, spread, success, table
from experiments.leaderboard.suite import moves_expected
from services.wire.definition import Definition

NAME = "deep"
TITLE = "# Deep learners on the same task"
FINDINGS = "## What it says"
SUCCESS = (
    "method",
    f"failures in the first {FIRST}: median (most)",
    "success at the end",
    "force [N]",
    "of the rule's",
    "peak [N]",
    "moves",
    "of the rule's",
)
PRICE = (
    "method",
    "inserts like the rule after",
    "and as gently after",
    "frozen: success [%]",
    "frozen: force [N]",
    "decisions a seed",
    "CPU [s] a seed",
)
HOW = f"""DQN, PPO and SAC of stable-baselines3 and RecurrentPPO of sb3-contrib learn to insert through Treenail's own
[Gymnasium environment](python.md#an-agent-of-your-own): the same simulator, noise, starts, limits and reward as
everybody else on [the leaderboard](leaderboard/leaderboard.md), seed by seed and episode by episode. They are no part
of Treenail: who wants to run this installs `experiments/deep/requirements.txt`.

- **Reward**: the definition's, which Treenail's own learner has too: a price a move, a collision, a price a newton,
  and force as a potential (`shaping`).
- **Observed**: force and torque on the peg in the tool frame as read, six numbers, after each move in contact.
  Treenail's learner has the same six. Neither knows a pose. The *tuned* ones have observation and reward scaled by
  their running spread, and what is listed below.
- **Action**: one of the definition's moves; SAC, which needs continuous ones, any increment within them
  (`continuous=True`).
- **As they come**: every setting as the library has it. DQN's random moves fade over a tenth of the moves that so
  many good insertions take.
- Success, force, peak and moves are of the last third of the run, at most a hundred episodes, exploration on, as on
  the leaderboard; of the rules, which do not learn, of all. *Inserts like the rule, after*: how many episodes a seed
  had before the first {WINDOW} in a row in which it inserts as often as the better of the two rules does on average;
  *and as gently*: with no more mean force than the rule's as well. *Frozen*: {FROZEN} further episodes by what is
  thought best, nothing learnt."""
SAME = """One thread, torch's deterministic algorithms: the same job gives the same bits again on the same machine with
the same libraries; another CPU or another torch may round otherwise. Starts and noise depend on none of that."""


class Tried(NamedTuple):
    """What came of a setting on the tuning seeds."""

    method: Method
    failures: float
    """Part of the last third of the episodes that failed."""
    force_n: float
    """Mean force there."""


class Page(NamedTuple):
    """What stands on the page."""

    command: str
    """That makes it."""
    facts: Mapping[str, str]
    rows: Sequence[Row]
    tasks: Sequence[Definition]
    methods: Sequence[Method]
    tried: Sequence[Tried]
    longer: Sequence[Row]

    def written(self, findings: str) -> str:
        """Return the page; ``findings`` is the section of conclusions, see ``findings_of``."""
        parts = [TITLE, HOW, "\n".join(f"- {label}: {text}" for label, text in self.facts.items())]
        parts += [f"    {self.command}", findings.strip() or FINDINGS, f"![failures and force by episode]({NAME}.png)"]
        for task in self.tasks:
            some = [row for row in self.rows if row["task"] == task.name]
            good = f"An insertion that goes well takes about {moves_expected(task):.0f} moves."
            parts += [f"## {task.name}", good, *_tables(some)]
        parts += ["## The methods", "\n".join(f"- `{method.name}`: {method.about}" for method in self.methods)]
        for row in self.longer:
            of = row["figures"]
            head = f"## `{row['method']}` for longer"
            parts += [head, f"{row['task']}, seed {of['seeds'][0]}, {of['episodes']} episodes:"]
            parts += [*_tables([row]), _points(row)]
        if self.tried:
            parts += ["## What was tried", _how_tried(), _tried(self.tried)]
        return "\n\n".join([*parts, "## The same again?", SAME]) + "\n"


def findings_of(old: str) -> str:
    """Return the section of conclusions of a page that is made anew, with its heading; empty where there is none."""
    _, heading, rest = old.partition(FINDINGS + "\n")
    kept = []
    for line in rest.splitlines():
        if line.startswith(("## ", "![")):
            break
        kept.append(line)
    return heading + "\n".join(kept)


def after(counts: Sequence[int | None]) -> str:
    """Return after how many episodes, seed by seed."""
    return ", ".join("never" if count is None else str(count) for count in counts)


def _success(row: Row) -> list[str]:
    of, force_of, moves_of = row["figures"], row["force_of_rule"], row["moves_of_rule"]
    return [
        f"`{row['method']}`",
        f"{of['first_failures_median']:g} ({of['first_failures_most']})",
        success(of),
        spread(of["force_n"], 2),
        "" if force_of is None else f"{force_of:.2f}",
        f"{of['peak_n']['mean']:.1f}",
        "none" if of["moves"] is None else spread(of["moves"], 0),
        "" if moves_of is None else f"{moves_of:.2f}",
    ]


def _price(row: Row) -> list[str]:
    of, frozen, decisions = row["figures"], row["frozen"], row["decisions"]
    return [
        f"`{row['method']}`",
        after(row["as_sure_after"]),
        after(row["as_good_after"]),
        "" if frozen is None else percent(frozen["successes"] / frozen["trials"]),
        "" if frozen is None else f"{frozen['force_n']:.2f}",
        "" if not decisions else f"{sum(decisions) / len(decisions):.0f}",
        f"{of['cpu_s'] / len(of['seeds']):.0f}",
    ]


def _tables(rows: Sequence[Row]) -> list[str]:
    """Return how well all do, and what it took those that learn."""
    learners = [_price(row) for row in rows if row["method"] not in RULES]
    return [table(SUCCESS, [_success(row) for row in rows]), table(PRICE, learners)]


def _points(row: Row) -> str:
    """Return failures and force of ten blocks of a run."""
    points = row["curves"][0]
    count = len(points["failures"])
    size = max(1, count // 10)
    made = []
    for begin in range(0, count, size):
        failures, force_n = points["failures"][begin : begin + size], points["force_n"][begin : begin + size]
        last = min(10 * (begin + len(failures)), row["figures"]["episodes"])
        mean_failures, mean_n = sum(failures) / len(failures), sum(force_n) / len(force_n)
        made.append((f"{10 * begin} to {last - 1}", percent(mean_failures), f"{mean_n:.2f}"))
    return table(("episodes", "failures [%]", "force [N]"), made)


def _how_tried() -> str:
    seeds = " and ".join(map(str, TUNING_SEEDS))
    return f"""`treenail deep --tune`: seeds {seeds}, {TUNING_EPISODES} episodes, on the first task only. Of each
algorithm the settings that fail least in the last third were taken, of equals the gentler. That is all the tuning
there was; a longer search may find better."""


def _tried(tried: Sequence[Tried]) -> str:
    chosen = {which: name for name, which in CHOSEN.items()}
    rows = [
        (
            f"`{one.method.name}`",
            one.method.about,
            percent(one.failures),
            f"{one.force_n:.2f}",
            chosen.get(one.method.name, ""),
        )
        for one in tried
    ]
    return table(("settings", "what they are", "failures [%]", "force [N]", "taken as"), rows)
