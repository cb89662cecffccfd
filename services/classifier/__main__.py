"""One classifier process: F/T vectors to contact states (ART2)."""

from __future__ import annotations

from collections.abc import Sequence

from services.bus import command
from services.bus.room import Room


def main(words: Sequence[str] | None = None, room: Room | None = None) -> None:
    """Parse the command line, or other words, and serve, in a process of its own or in a ``room``."""
    options = command.options(command.parser("classifier", __doc__).parse_args(words), room)
    from services.classifier.service import serve  # here: what is missing, or Ctrl-C meanwhile, is one line

    serve(options)


if __name__ == "__main__":
    command.run("classifier", main)
