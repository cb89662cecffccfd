"""The controller's side of a floppy drive as a process: ``python -m treenail.tools.pfloppy.try_it URL COMMAND``.

    BOOT              start up from the disk and print the system file's banner
    DIR               list the files
    IMAGE FILE        copy the whole disk, block by block, into FILE
    LOAD NAME [FILE]  read a file from the disk, to FILE or to the screen
    STORE NAME FILE   write a file to the disk
    DELETE NAME       take a file off the disk
    COPY OLD NEW      copy a file on the disk
    RENAME OLD NEW    give a file another name

The commands' names are those of the thesis and of early drafts of VAL; how VAL II spells them is not known.
"""

from __future__ import annotations

import sys
from pathlib import Path

from services.robot_link import serial_line
from services.robot_link.emulator.floppy import Directory, FloppyClient, Talk, talk
from services.rules import command_line
from services.rules.command_line import Parser, RawHelp, number, whole
from services.wire.errors import TreenailError

WORDS = {
    "BOOT": (0, 0),
    "DIR": (0, 0),
    "IMAGE": (1, 1),
    "LOAD": (1, 2),
    "STORE": (2, 2),
    "DELETE": (1, 1),
    "COPY": (2, 2),
    "RENAME": (2, 2),
}
"""Fewest and most words of each command."""


def main() -> int:
    """Do one command; return the exit status."""
    return command_line.run("floppy", _act)


def _act() -> None:
    parser = Parser(prog="floppy", description=__doc__, formatter_class=RawHelp, allow_abbrev=False)
    serial_line.add_arguments(parser)
    parser.add_argument("command", metavar="COMMAND", type=str.upper, choices=tuple(WORDS), help="see above")
    parser.add_argument("words", metavar="WORD", nargs="*", help="names and files")
    parser.add_argument("--unit", type=whole(0, 255), default=0, metavar="N", help="unit, 0 to 255")
    parser.add_argument("--mrsp", action="store_true", help="ask for every byte by itself")
    parser.add_argument("--patience", type=number(0.01, 1e6), default=10.0, metavar="S", help="wait so long")
    arguments = parser.parse_args()
    fewest, most = WORDS[arguments.command]
    if not fewest <= len(arguments.words) <= most:
        parser.error(f"{arguments.command}: expected {fewest} to {most} words, got {len(arguments.words)}")
    line = serial_line.line_of(arguments)
    try:
        line.open()
        client = FloppyClient(arguments.unit, arguments.mrsp)
        printed = talk(_operation(arguments.command, arguments.words, client), line, arguments.patience)
        if arguments.command == "IMAGE" or (len(arguments.words) > 1 and arguments.command == "LOAD"):
            Path(arguments.words[-1]).write_bytes(printed)
        else:
            sys.stdout.buffer.write(printed)
    except OSError as error:
        raise TreenailError(str(error)) from error
    finally:
        line.close()


def _operation(command: str, words: list[str], client: FloppyClient) -> Talk[bytes]:
    """Do one command; the value is what to print."""
    names = [word.upper() for word in words]
    if command == "BOOT":
        banner = yield from client.boot()
        return f"{banner}\n".encode()
    yield from client.wake()
    if command == "DIR":
        directory = yield from client.directory()
        return _table(directory).encode()
    if command == "IMAGE":
        image = yield from client.image(_read_so_far)
        return image
    if command == "LOAD":
        content = yield from client.load(names[0])
        return content
    if command == "STORE":
        yield from client.store(names[0], Path(words[1]).read_bytes())
    elif command == "DELETE":
        yield from client.delete(names[0])
    elif command == "COPY":
        yield from client.copy(*names)
    else:
        yield from client.rename(*names)
    return b""


def _read_so_far(blocks: int) -> None:
    """Say now and then how far the copy is; how long the disk is shows only at its end."""
    if blocks % 64 == 0:
        print(f"floppy: {blocks} blocks", file=sys.stderr, flush=True)


def _table(directory: Directory) -> str:
    lines = [f"{file.name:<10} {file.length:>6} bytes" for file in directory.files]
    free = len(directory.data) - sum(file.blocks for file in directory.files)
    return "\n".join([*lines, f"{len(directory.files)} files, {free} blocks free"]) + "\n"


if __name__ == "__main__":
    sys.exit(main())
