"""Disturb a cell while it learns, by a seeded plan, and compare what it learnt with a run that nobody disturbed.

Processes are killed, frozen, cut off; messages get lost, late, twice and out of order; the disk is full and clocks
jump. Every run has to end in the same bytes as the same run in one process, without a step lost: status 0, else 1.
"""

from __future__ import annotations

import argparse
import json
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from experiments.chaos import plan as plans
from experiments.chaos.campaign import RunReport, Settings, carry_out
from experiments.chaos.clocks import Clocks, NoClocksError
from experiments.chaos.reference import Reference, undisturbed
from experiments.chaos.report import as_json, lines, table, well
from experiments.lab.progress import reporter
from services.cell.terminal import console
from services.rules import command_line
from services.rules.command_line import EXIT_DIFFERS, EXIT_ERROR, Parser, RawHelp, whole
from services.rules.swaps import SPEC, SPEC_HELP
from services.rules.swaps import planned as swaps_of
from services.wire.definition import Definition
from services.wire.definition_file import check_run, load
from services.wire.errors import TreenailError
from services.wire.message_base import LONGEST_RUN
from services.wire.messages import Swap
from services.wire.randomness import MAX_SEED

PROGRAM = "treenail chaos"
OTHERS_PER_KILLS = 50
TABLE_WIDTH = 118


def main(words: Sequence[str] | None = None) -> int:
    """Do what the command line (or ``words`` in its place) says and return the exit status."""
    return command_line.run(PROGRAM, lambda: _act(words), unread=EXIT_ERROR)


def _act(words: Sequence[str] | None) -> int:
    arguments = _parser().parse_args(words)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C: nothing is left running
    return _run(arguments)


def _run(arguments: argparse.Namespace) -> int:
    definition = load(arguments.experiment, arguments.set)
    check_run(arguments.seed, arguments.episodes)
    swaps = swaps_of("", definition, arguments.swap, arguments.episodes)
    others = max(1, arguments.kills // OTHERS_PER_KILLS) if arguments.others is None else arguments.others

    def make_plan(kinds: Sequence[str]) -> plans.Plan:
        return plans.make(arguments.seed, arguments.kills, others, kinds, arguments.services)

    make_plan(arguments.kinds)  # what is wrong is said before anything starts
    with _folder(arguments.out) as folder:
        clocks, skipped = _clocks(folder, arguments.kinds)
        kinds = [kind for kind in arguments.kinds if kind not in skipped]
        if not kinds:
            why = "; ".join(set(skipped.values()))
            raise TreenailError(f"--kinds: expected some that can be done here, got none: {why}")
        plan = make_plan(kinds)
        runs = _carry_out(arguments, definition, swaps, plan, clocks, folder)
        return _tell(arguments, plan, runs, skipped, folder)


def _clocks(folder: Path, kinds: Sequence[str]) -> tuple[Clocks | None, dict[str, str]]:
    """Return the clocks if any kind needs them, and which kinds have to be skipped, with the reason."""
    wanted = [kind for kind in kinds if kind in plans.CLOCK]
    if not wanted:
        return None, {}
    (folder / "clocks").mkdir()
    try:
        return Clocks(folder / "clocks"), {}
    except NoClocksError as error:
        return None, dict.fromkeys(wanted, str(error))


def _carry_out(
    arguments: argparse.Namespace,
    definition: Definition,
    swaps: Sequence[Swap],
    plan: plans.Plan,
    clocks: Clocks | None,
    folder: Path,
) -> list[RunReport]:
    settings = Settings(
        experiment=arguments.experiment,
        overrides=tuple(arguments.set),
        swaps=tuple(arguments.swap),
        definition=definition,
        episodes=arguments.episodes,
        first_seed=arguments.seed,
        viewer="viewer" in arguments.services,
        out=folder,
    )

    def reference(what: Definition, seed: int, episodes: int) -> Reference:
        return undisturbed(what, seed + 1 if arguments.control else seed, episodes, swaps)

    with reporter() as shown:
        return carry_out(settings, plan, clocks, shown, reference)


def _tell(
    arguments: argparse.Namespace,
    plan: plans.Plan,
    runs: Sequence[RunReport],
    skipped: Mapping[str, str],
    folder: Path,
) -> int:
    """Print the report and return the exit status; a temporary folder stays only when something is wrong."""
    good, text = well(plan, runs), json.dumps(as_json(plan, runs, skipped), indent=2)
    if arguments.json:
        print(text, flush=True)
    else:
        console(least_width=TABLE_WIDTH).print(table(runs))
        print("\n".join(lines(plan, runs, skipped)), flush=True)
    if arguments.out is None and good:
        shutil.rmtree(folder)
    else:
        (folder / "chaos.json").write_text(text + "\n")
        print(f"report in {folder}", file=sys.stderr)
    return 0 if good else EXIT_DIFFERS


@contextmanager
def _folder(out: Path | None) -> Iterator[Path]:
    """A folder for the campaign: ``out``, which has to be empty, or a temporary one that does not outlive an error."""
    if out is None:
        folder = Path(tempfile.mkdtemp(prefix="treenail-chaos-"))
        try:
            yield folder
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise
        return
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TreenailError(f"--out {out}: cannot hold a campaign: {error.strerror}") from error
    if any(out.iterdir()):
        raise TreenailError(f"--out {out}: expected an empty or new folder, got one with something in it")
    yield out.resolve()


def _parser() -> argparse.ArgumentParser:
    kinds = "\n".join(f"  {name:<11}{says}" for name, says in plans.KINDS.items())
    parser = Parser(prog=PROGRAM, description=__doc__, formatter_class=RawHelp)
    run = parser.add_subparsers(metavar="COMMAND", required=True).add_parser(
        "run",
        help="carry out a campaign",
        description=__doc__,
        epilog=f"kinds of disturbances:\n{kinds}",
        formatter_class=RawHelp,
    )
    run.add_argument("--experiment", default="chamfered-q-softmax", help="name or TOML file of the definition")
    run.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="override a key of it")
    run.add_argument("--swap", action="append", default=[], metavar=SPEC, help=SPEC_HELP)
    run.add_argument("--seed", type=whole(0, MAX_SEED), default=0, help="seed of the plan and of the first run")
    run.add_argument("--episodes", type=whole(1, LONGEST_RUN), default=40, help="length of each run")
    run.add_argument("--kills", type=whole(0), default=20, metavar="N", help="processes to kill")
    run.add_argument(
        "--others", type=whole(0), metavar="N", help="how often each other kind (default: one for 50 kills)"
    )
    for option, names, what in (
        ("--kinds", tuple(plans.KINDS), "disturb"),
        ("--services", plans.SERVICES, "kill and freeze"),
    ):
        run.add_argument(
            option,
            type=lambda text: text.split(","),
            default=names,
            metavar="A,B,...",
            help=f"what to {what} only (default: {','.join(names)})",
        )
    run.add_argument(
        "--control", action="store_true", help="compare with the next seed's run, to see that a difference is found"
    )
    run.add_argument("--out", type=Path, metavar="DIR", help="keep report and logs here (default: only of a failure)")
    run.add_argument("--json", action="store_true", help="the report as JSON")
    return parser


if __name__ == "__main__":
    sys.exit(main())
