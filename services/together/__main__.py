"""Several services of a cell in one process, for a cell on one machine that shall be fast.

Each is written as its own program is called, without ``python -m services.``, with a ``+`` between two:

    python -m services.together --connect ENDPOINT task --connect ENDPOINT --episodes 20 + classifier ... + agent ...

When one of them ends, all end: to whoever started them they are one program.
"""

from __future__ import annotations

import argparse
import sys
import threading
from collections.abc import Callable, Sequence
from typing import TypeAlias

from services.agent.__main__ import main as agent
from services.bus import command
from services.bus.room import Room
from services.classifier.__main__ import main as classifier
from services.rules.command_line import Parser
from services.sim.__main__ import main as sim
from services.task.__main__ import main as task
from services.wire.errors import CellError

Main: TypeAlias = Callable[[Sequence[str] | None, Room | None], None]
PARTS: dict[str, Main] = {"task": task, "classifier": classifier, "agent": agent, "sim": sim}
"""What can stand in one process: not the store, whose writing to the disk holds up nobody elsewhere."""


HAND_OVER_S = 1e-4
"""After so long the interpreter goes to a thread that waits for it: a question need not wait for a whole motion."""


class Part(threading.Thread):
    """One service, on a thread of its own."""

    def __init__(self, words: Sequence[str], room: Room) -> None:
        """``words`` are its name and its options. Raises CellError for a name that is none."""
        name, *self._words = words or [""]
        if name not in PARTS:
            raise CellError(f"service: expected one of {', '.join(PARTS)}, got {name!r}")
        super().__init__(name=name, daemon=True)
        self._main, self._room = PARTS[name], room
        self.error: BaseException | None = None

    def run(self) -> None:
        """Serve until stopped, and then stop all others."""
        try:
            self._main(self._words, self._room)
        except BaseException as error:  # raised again where the process ends
            self.error = error
        finally:
            self._room.stop()


def main() -> None:
    """Start all services and wait for their end. Raises what the first of them that failed has raised."""
    parser = Parser(prog="treenail together", description=__doc__)
    command.add_arguments(parser)
    parser.add_argument("services", nargs=argparse.REMAINDER, metavar="SERVICE OPTIONS + SERVICE ...")
    arguments = parser.parse_args()
    options = command.options(arguments)
    if options.certs is not None:
        raise CellError("--certs: expected none: a certificate is for one service, and here is one connection for all")
    sys.setswitchinterval(HAND_OVER_S)
    with Room(options.connect, options.connect_timeout_s) as room:
        parts = [Part(words, room) for words in split(arguments.services)]
        for part in parts:
            part.start()
        for part in parts:
            part.join()
    for part in parts:
        if part.error is not None and not (isinstance(part.error, SystemExit) and part.error.code == 0):
            raise part.error


def split(words: Sequence[str]) -> list[list[str]]:
    """Return words by service: those between one ``+`` and the next."""
    groups: list[list[str]] = [[]]
    for word in words:
        groups.append([]) if word == "+" else groups[-1].append(word)
    return groups


if __name__ == "__main__":
    command.run("together", main)
