"""``treenail diff``: say where two runs part, and how they went on from there."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace
from rich.table import Table

from experiments.journal import options as journal_options
from experiments.journal.diff import Comparison
from experiments.journal.replay import Replay
from services.cell.stored import Stored, StoredRun, chosen, runs
from services.cell.terminal import console
from services.rules.command_line import Parser
from services.rules.results import episodes_digest
from services.rules.skill import NamedSkill
from services.rules.swaps import words
from services.wire.errors import CellError
from services.wire.messages import RunRecord, Swap

PROGRAM = "treenail diff"


class Side(NamedTuple):
    """One of the two runs."""

    stored: StoredRun
    record: RunRecord
    began_with: NamedSkill | None
    episodes: int
    """How many there are."""
    swaps: tuple[Swap, ...]


class Digest(NamedTuple):
    """What both runs had learnt, or logged, after the episodes that both have; SHA-256 in hex."""

    part: str
    a: str
    b: str
    same: bool
    """For the episode log: but for the run's name, which is in it."""


class Found(NamedTuple):
    """All that is told."""

    sides: tuple[Side, Side]
    comparison: Comparison
    replays: tuple[Replay, Replay]
    digests: list[Digest]

    @property
    def same(self) -> bool:
        """Whether the runs are the same in everything."""
        a, b = self.sides
        alike = not self.comparison.settings and self.comparison.parting is None and a.episodes == b.episodes
        return alike and all(digest.same for digest in self.digests)


def main(words: Sequence[str] | None = None) -> int:
    """Do what the command line (or ``words`` in its place) says and return the exit status."""
    return journal_options.status(PROGRAM, lambda: _act(_parser().parse_args(words)))


def _act(arguments: argparse.Namespace) -> bool:
    """Compare, print, and return whether the runs are the same."""
    with ExitStack() as stack:
        places_a = stack.enter_context(journal_options.places(arguments, arguments.store))
        places_b = places_a
        if arguments.store_b is not None:
            places_b = stack.enter_context(journal_options.places(arguments, arguments.store_b))
        elif arguments.run_b is None:
            raise _second_missing(places_a)
        found = _compare(_side(chosen(places_a, arguments.run_a)), _side(chosen(places_b, arguments.run_b)))
    if arguments.json:
        print(json.dumps(_as_json(found)))
    else:
        _print(found)
    return found.same


def _second_missing(places: Sequence[Stored]) -> CellError:
    there = ", ".join(run.name for stored in places for run in runs(stored)) or "none"
    return CellError(f"RUN_B: expected a second run, or --store-b with one, got neither; the store's runs: {there}")


def _side(stored: StoredRun) -> Side:
    record = stored.record()
    return Side(stored, record, stored.skill(record.skill_sha256), stored.length(), stored.swaps())


def _compare(a: Side, b: Side) -> Found:
    """Compare all episodes that both runs have, and fold them as the workers would."""
    common = min(a.episodes, b.episodes)
    first_versions = tuple(0 if side.began_with is None else side.began_with.version for side in (a, b))
    comparison = Comparison(a.record, b.record, (first_versions[0], first_versions[1]), (a.swaps, b.swaps))
    replays = Replay(a.record, a.began_with, a.swaps), Replay(b.record, b.began_with, b.swaps)
    pairs = zip(a.stored.episodes(common), b.stored.episodes(common), strict=True)
    for in_a, in_b in journal_options.shown(pairs, "diff", common):
        comparison.add(in_a, in_b)
        replays[0].fold(in_a)
        replays[1].fold(in_b)
    return Found((a, b), comparison, replays, _digests(*replays))


def _digests(a: Replay, b: Replay) -> list[Digest]:
    in_a, in_b = a.digests(), b.digests()
    renamed = episodes_digest([replace(summary, run=a.record.run) for summary in b.summaries])
    return [
        Digest("q_table", in_a["q_table"], in_b["q_table"], in_a["q_table"] == in_b["q_table"]),
        Digest("art2", in_a["art2"], in_b["art2"], in_a["art2"] == in_b["art2"]),
        Digest("episodes", in_a["episodes"], in_b["episodes"], in_a["episodes"] == renamed),
    ]


def _as_json(found: Found) -> dict[str, object]:
    comparison = found.comparison
    courses = comparison.courses()
    return {
        **{name: _side_as_json(side) for name, side in zip("ab", found.sides, strict=True)},
        "settings": [one._asdict() for one in comparison.settings],
        "episodes_compared": comparison.episodes,
        "parting": None if comparison.parting is None else comparison.parting._asdict(),
        "outcomes": comparison.outcomes()._asdict(),
        "returns": comparison.returns()._asdict(),
        "from_parting": None if courses is None else {"a": courses[0]._asdict(), "b": courses[1]._asdict()},
        "digests": [one._asdict() for one in found.digests],
        "mismatches": {name: dict(one.mismatches) for name, one in zip("ab", found.replays, strict=True)},
        "same": found.same,
    }


def _side_as_json(side: Side) -> dict[str, object]:
    record = side.record
    return {
        "run": record.run,
        "store": side.stored.stored.where,
        "experiment": record.definition.name,
        "definition": record.definition_sha256,
        "seed": record.seed,
        "began_with": record.skill_sha256,
        "swaps": [words(swap) for swap in side.swaps],
        "episodes": side.episodes,
    }


def _print(found: Found) -> None:
    comparison, shown = found.comparison, console()
    for name, side in zip("AB", found.sides, strict=True):
        record = side.record
        print(
            f"{name}: run {record.run}, {record.definition.name}, {side.episodes} episodes; {side.stored.stored.where}"
        )
    if comparison.settings:
        print("not the same by definition, beginning or swap:")
        made = Table()
        for heading in ("setting", "A", "B"):
            made.add_column(heading, overflow="fold")
        for field, a, b in comparison.settings:
            made.add_row(field, _text(a), _text(b))
        shown.print(made)
    else:
        print("definition, seed, beginning and swaps are the same")
    _print_parting(comparison)
    print(f"after the {comparison.episodes} episodes that both have:")
    made = Table()
    for heading in ("", "A", "B", ""):
        made.add_column(heading)
    for part, a, b, same in found.digests:
        named = same and a != b
        verdict = "the same but for the run's name" if named else "the same" if same else "different"
        made.add_row(part, a[:12], b[:12], verdict)
    shown.print(made)
    for name, replay in zip("AB", found.replays, strict=True):
        if replay.first_mismatch is not None:
            print(f"journal of {name} contradicts itself (treenail replay): {replay.first_mismatch}")
    print("the same" if found.same else "different")


def _print_parting(comparison: Comparison) -> None:
    if comparison.parting is None:
        print(f"no parting: all steps of the {comparison.episodes} episodes that both have are the same")
        return
    print(f"parting: {comparison.parting}")
    outcomes, returns, courses = comparison.outcomes(), comparison.returns(), comparison.courses()
    print(
        f"from there on: outcome the same in {outcomes.same} episodes and different in {outcomes.different}, "
        f"return the same in {returns.same} and different in {returns.different}"
    )
    for name, course in zip("AB", courses or (), strict=False):
        numbers = f"return {course.episode_return:.1f}, force {course.force_n:.2f} N, success {course.success:.1%}"
        print(f"{name}: {numbers} (means of these {course.episodes})")


def _text(value: object) -> str:
    return "-" if value is None else str(value)


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog=PROGRAM, description=__doc__)
    parser.add_argument("run_a", nargs="?", metavar="RUN_A", help="a run's name or how it begins")
    parser.add_argument(
        "run_b", nargs="?", metavar="RUN_B", help="the other; neither is needed when it is the only one"
    )
    parser.add_argument("--store-b", type=Path, metavar="FILE", help="where RUN_B is (default: where RUN_A is)")
    journal_options.add_arguments(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
