"""``treenail export``: a run in formats that others read."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from pathlib import Path

from experiments.export.aside import aside
from experiments.export.source import Source, source
from experiments.export.steps import EpisodeRows, Stepper
from experiments.journal import options
from services.cell import client
from services.rules.command_line import whole
from services.wire.randomness import MAX_SEED

FORMATS = {
    "mcap": "a rosbag2 in MCAP, for ROS 2, Foxglove and PlotJuggler: a folder",
    "parquet": "every motion as a row, units in the names of the columns: a file",
    "lerobot": "a LeRobotDataset v3, a frame a decision: a folder",
}
ENDINGS = {"mcap": "-bag", "parquet": ".parquet", "lerobot": "-lerobot"}
RUN_HELP = (
    "the folder of a run, a store's file, or a run in the living cell by its name or how that begins "
    "(default: the one that the cell works on)"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.epilog = "docs/export.md says what is in each."
    parser.add_argument("run", nargs="?", metavar="RUN", help=RUN_HELP)
    parser.add_argument(
        "--to", choices=FORMATS, required=True, help="; ".join(f"{name}: {what}" for name, what in FORMATS.items())
    )
    parser.add_argument(
        "--out", type=Path, metavar="PATH", help="what to write (default: <run> with -bag, .parquet, …)"
    )
    parser.add_argument("--seed", type=whole(0, MAX_SEED), help="which run of a folder with several")
    parser.add_argument("--named", metavar="NAME", help="which run of a store's file, by its name or how that begins")
    parser.add_argument("--force", action="store_true", help="replace what is there")
    client.add_arguments(parser)
    parser.set_defaults(cell=None)  # a file may be of any


def act(arguments: argparse.Namespace) -> None:
    """Export, and say what was written."""
    write = _writer(arguments.to)  # a missing extra is said before anything is asked
    with source(arguments) as run:
        path = arguments.out or Path(f"{run.name}{ENDINGS[arguments.to]}")
        with aside(path, force=arguments.force) as place:
            steps = Stepper(run.definition, run.name, run.seed)
            count = write(place, run, steps.episodes(options.shown(run.episodes, "export", run.length)))
    what = {"mcap": "messages", "parquet": "motions", "lerobot": "frames"}[arguments.to]
    print(f"{path}: {count} {what} of {run.length} episodes of {run.name}")


def _writer(name: str) -> Callable[[Path, Source, Iterable[EpisodeRows]], int]:
    """Return what writes a format; only its own library is loaded."""
    match name:
        case "mcap":
            from experiments.export.mcap import write
        case "parquet":
            from experiments.export.parquet import write
        case _:
            from experiments.export.lerobot import write
    return write
