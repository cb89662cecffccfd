"""One insertion task."""

from __future__ import annotations

from collections.abc import Sequence

from services.bus import command
from services.bus.room import Room
from services.rules.command_line import whole
from services.rules.swaps import SPEC, SPEC_HELP, planned
from services.task.service import serve
from services.wire.definition_file import check_run, load
from services.wire.message_base import LONGEST_RUN
from services.wire.randomness import MAX_SEED


def main(words: Sequence[str] | None = None, room: Room | None = None) -> None:
    """Parse the command line, or other words, and serve, in a process of its own or in a ``room``."""
    parser = command.parser("task", __doc__)
    parser.add_argument("--experiment", default="chamfered-q-softmax", help="name or TOML file of the definition")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="override a key of it")
    parser.add_argument("--swap", action="append", default=[], metavar=SPEC, help=SPEC_HELP)
    parser.add_argument("--seed", type=whole(0, MAX_SEED), default=0, help="seed of the run, from 0")
    parser.add_argument("--episodes", type=whole(1, LONGEST_RUN), help="length of the run (default: the definition's)")
    arguments = parser.parse_args(words)
    definition = load(arguments.experiment, arguments.set)
    episodes = definition.episodes if arguments.episodes is None else arguments.episodes
    check_run(arguments.seed, episodes)
    planned("", definition, arguments.swap, episodes)
    serve(command.options(arguments, room), definition, arguments.seed, episodes, arguments.swap)


if __name__ == "__main__":
    command.run("task", main)
