"""``treenail video``: one insertion of a run as a film, with the force and its curve."""

from __future__ import annotations

import argparse
from pathlib import Path

from services.cell import client
from services.rules.command_line import whole
from services.wire.errors import TreenailError
from services.wire.message_base import LONGEST_RUN
from services.wire.randomness import MAX_SEED
from treenail.commands.export import RUN_HELP

ENDINGS = (".mp4", ".gif")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.epilog = "The episode is simulated anew from what its journal has decided, and must feel the same."
    parser.add_argument("run", metavar="RUN", help=RUN_HELP.partition(" (default")[0])
    parser.add_argument("out", type=Path, metavar="OUT", help="the film: a name that ends in .mp4 or .gif")
    parser.add_argument("--episode", type=whole(0, LONGEST_RUN - 1), metavar="N", help="which (default: the last one)")
    parser.add_argument("--seed", type=whole(0, MAX_SEED), help="which run of a folder with several")
    parser.add_argument("--named", metavar="NAME", help="which run of a store's file, by its name or how that begins")
    parser.add_argument("--per-second", type=whole(1, 50), default=10, metavar="K", help="motions in a second of film")
    parser.add_argument("--force", action="store_true", help="replace what is there")
    client.add_arguments(parser)
    parser.set_defaults(cell=None)  # a file may be of any


def act(arguments: argparse.Namespace) -> None:
    """Make the film, and say what it shows."""
    out: Path = arguments.out
    if out.suffix not in ENDINGS:
        raise TreenailError(f"{out}: expected a name that ends in {' or '.join(ENDINGS)}")
    # Here, after the cheap complaints: physics and pictures take a second to load.
    from experiments.export.aside import aside
    from experiments.export.source import source
    from experiments.journal.options import shown
    from experiments.picture import film

    if out.suffix == ".mp4":
        import av  # noqa: F401  # what is missing is said before anything is computed

    with source(arguments) as run, aside(out, force=arguments.force) as place:
        episode = run.length - 1 if arguments.episode is None else arguments.episode
        entry = film.entry_of(run, max(episode, 0))
        summary = entry.summary
        assert summary is not None
        pictures = shown(film.pictures(run, entry), "video", summary.moves + 1)
        count = film.write(place, out.suffix, pictures, arguments.per_second)
    told = f"episode {summary.episode} of {run.name}, {summary.outcome}, {summary.peak_force_n:.1f} N at most"
    print(f"{out}: {count} pictures of {told}")
