"""Run experiments in this machine's processes, without a bus: many seeds at once, figures and tables at the end."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from services.rules import command_line, plugins, swaps
from services.rules.command_line import Parser, whole
from services.rules.shipped_skill import BUILTIN, for_task, named_or_file
from services.wire import definition_file, definition_page
from services.wire.errors import TreenailError
from services.wire.randomness import MAX_SEED

if TYPE_CHECKING:
    from experiments.lab.pool import PieceError
    from experiments.lab.run import TimedRun
    from services.rules.results import Wanted
    from services.wire.definition import Definition
    from services.wire.messages import Swap

PROGRAM = "treenail experiment"
LOG = "error.log"
_OUT = "runs/experiments/<name>-<first 8 digits of the definition's hash>"

_RUN_TEXT = (
    "Writes summary.json, episodes.csv, definition.toml, four figures and what each seed has learnt, seed<N>.skill. A "
    "seed that fails ends all, status 2; after Ctrl-C what there is by then is written, status 130."
)


def main(words: Sequence[str] | None = None) -> int:
    """Do what the command line (or ``words`` in its place) says and return the exit status."""
    interrupted = "interrupted, no results written"
    return command_line.run(PROGRAM, lambda: _act(_parser().parse_args(words)), interrupted=interrupted)


def _act(arguments: argparse.Namespace) -> int:
    status: int = arguments.command(arguments)
    return status


def _run(arguments: argparse.Namespace) -> int:
    # Whatever could be missing is loaded before the runs, not after an hour of them.
    from experiments.lab import plots, pool, progress, result_files, run  # noqa: F401

    definition = definition_file.load(arguments.experiment, arguments.set)
    plugins.check(definition)
    sha256 = definition_file.definition_sha256(definition)
    skill, from_skill = None, ""
    if arguments.skill is not None:
        skill = for_task(named_or_file(arguments.skill), definition)
        from_skill = f"-k{skill.sha256[:8]}"
    episodes = arguments.episodes or definition.episodes
    planned = swaps.planned("", definition, arguments.swap, episodes)
    from_swaps = f"-w{swaps.digest(planned)[:8]}" if planned else ""
    folder = arguments.out or Path("runs", "experiments", f"{definition.name}-{sha256[:8]}{from_skill}{from_swaps}")
    seeds = arguments.seed_list or list(range(arguments.seeds))
    result_files.prepare(folder, sha256, arguments.force)
    jobs = arguments.jobs or pool.usable_cores()
    try:
        with progress.of_runs(len(seeds), episodes) as listener:
            timed = run.run_seeds(definition, seeds, episodes, jobs, listener, skill, planned)
    except run.Interrupted as stopped:
        if not stopped.runs:
            raise
        if (folder / result_files.SUMMARY).exists():  # what a whole run gave is not given up for a part of another
            folder = folder.with_name(f"{folder.name}-interrupted")
            result_files.prepare(folder, sha256, force=True)
        _tell(folder, definition, sha256, stopped.runs, planned, {"seeds": seeds, "episodes": episodes})
        kept = ", ".join(f"{len(seed_run.result.episodes)} of seed {seed_run.result.seed}" for seed_run in stopped.runs)
        print(f"{PROGRAM}: interrupted; of {episodes} episodes kept {kept}, in {folder}", file=sys.stderr)
        return command_line.EXIT_INTERRUPTED
    except pool.PieceError as error:
        raise _logged(error, folder, arguments.debug) from error
    _tell(folder, definition, sha256, timed, planned)
    print(f"results in {folder}")
    return 0


def _tell(
    folder: Path,
    definition: Definition,
    sha256: str,
    timed: Sequence[TimedRun],
    planned: Sequence[Swap],
    wanted: Wanted | None = None,
) -> None:
    """Write the results and print their table; ``wanted`` is what should have been run, when not all was."""
    from experiments.lab import plots, progress, result_files
    from services.cell.terminal import console
    from services.rules import results

    runs = [run.result for run in timed]
    summary = results.summary(definition, sha256, runs, planned)
    if wanted is not None:
        summary["interrupted"] = wanted
    figures = plots.figures(definition.name, result_files.in_step({run.seed: run.episodes for run in runs}))
    skills = {run.result.seed: run.skill for run in timed}
    result_files.write(folder, definition, summary, runs, figures, skills)
    title = f"{definition.name}, {max(len(run.episodes) for run in runs)} episodes"
    console().print(progress.table(title, summary["runs"], [run.moves_per_s for run in timed]))


def _logged(error: PieceError, folder: Path, debug: bool) -> TreenailError:
    """Return the error of a seed that failed, after its traceback is in a file and, if asked for, printed."""
    if not error.trace:
        return error
    log = folder / LOG
    try:
        log.write_text(error.trace, encoding="utf-8")
    except OSError as full:
        return TreenailError(f"{error}; {log} cannot be written: {full.strerror}")
    if debug:
        print(error.trace, end="", file=sys.stderr)
    return TreenailError(f"{error}; traceback in {log}")


def _list(arguments: argparse.Namespace) -> int:
    names = definition_file.shipped()
    width = max(map(len, names))
    for name in names:
        print(f"{name:{width}}  {definition_file.load(name).title}")
    return 0


def _show(arguments: argparse.Namespace) -> int:
    from experiments.lab.result_files import definition_toml

    definition = definition_file.load(arguments.experiment, arguments.set)
    print(f"# definition_sha256: {definition_file.definition_sha256(definition)}")
    print(definition_toml(definition), end="")
    return 0


def _new(arguments: argparse.Namespace) -> int:
    path: Path = arguments.file
    try:
        with path.open("x", encoding="utf-8") as file:
            try:
                file.write(definition_page.template(path.stem))
                file.flush()
            except OSError:  # half a file would be in the way of the next try
                path.unlink()
                raise
    except FileExistsError:
        raise TreenailError(f"{path}: expected no such file yet") from None
    except OSError as error:
        raise TreenailError(f"{path}: cannot be written: {error.strerror}") from error
    print(f"{path}: edit it, then: {PROGRAM} run {path}")
    return 0


def _plot(arguments: argparse.Namespace) -> int:
    from experiments.lab import plots, result_files

    table = result_files.read_episodes(arguments.folder / result_files.EPISODES)
    episodes = result_files.in_step(table.episodes)
    result_files.write_figures(arguments.folder, plots.figures(table.experiment, episodes))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog=PROGRAM, description=__doc__)
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    _add_run(commands.add_parser("run", help="run an experiment over several seeds", description=_RUN_TEXT))
    add = commands.add_parser("list", help="list the experiments that come with Treenail")
    add.set_defaults(command=_list)
    add = commands.add_parser("show", help="print a definition with all its defaults, as TOML, and its hash")
    _add_definition(add)
    add.set_defaults(command=_show)
    add = commands.add_parser("new", help="write a definition with all its keys, what they mean and their defaults")
    add.add_argument("file", type=Path, metavar="FILE", help="a TOML file that is not there yet, such as my.toml")
    add.set_defaults(command=_new)
    add = commands.add_parser("plot", help="draw the figures of a folder of results again from its episodes.csv")
    add.add_argument("folder", type=Path, metavar="DIR")
    add.set_defaults(command=_plot)
    return parser


def _add_run(run: argparse.ArgumentParser) -> None:
    _add_definition(run)
    run.add_argument("--episodes", type=whole(), metavar="N", help="length of each run (default: the definition's)")
    which = run.add_mutually_exclusive_group()
    which.add_argument("--seeds", type=whole(), default=1, metavar="K", help="run seeds 0 to K-1 (default: 1)")
    which.add_argument("--seed-list", type=_seed_list, metavar="A,B,...", help="run these seeds")
    run.add_argument(
        "--skill",
        metavar="FILE",
        help=f"begin with a skill, of another run or exported, or with {BUILTIN}, the one that comes with Treenail",
    )
    run.add_argument("--swap", action="append", default=[], metavar=swaps.SPEC, help=swaps.SPEC_HELP)
    run.add_argument("--out", type=Path, metavar="DIR", help=f"where results go (default: {_OUT})")
    run.add_argument("--jobs", type=whole(), metavar="J", help="seeds run at a time (default: one per core)")
    run.add_argument("--force", action="store_true", help="replace results of another definition")
    run.add_argument("--debug", action="store_true", help="print the traceback of a seed that fails")
    run.set_defaults(command=_run)


def _add_definition(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("experiment", metavar="NAME_OR_FILE", help="a name that `list` shows, or a TOML file")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change a setting, such as start.x_mm=2.0; may be repeated",
    )


def _seed_list(text: str) -> list[int]:
    seeds = [whole(0, MAX_SEED)(part) for part in text.split(",")]
    if len(set(seeds)) != len(seeds):
        raise argparse.ArgumentTypeError(f"expected every seed once, got {text!r}")
    return seeds


if __name__ == "__main__":
    sys.exit(main())
