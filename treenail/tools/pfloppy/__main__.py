"""``treenail pfloppy``: a floppy drive for an old controller; a folder or an image over a serial line.

VAL II's own floppy protocol and directory format are not publicly known. The protocol tu58 is a STAND-IN, see
docs/pfloppy.md. Never yet run on hardware.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import FrameType

from services.robot_link import serial_line
from services.rules import command_line
from services.rules.command_line import Parser
from treenail.tools.pfloppy.disk_errors import DiskError
from treenail.tools.pfloppy.folder import Folder, FolderError
from treenail.tools.pfloppy.image import Image
from treenail.tools.pfloppy.layout import NAME, NAME_RULE
from treenail.tools.pfloppy.protocols import Disk, find, names
from treenail.tools.pfloppy.serving import serve
from treenail.tools.pfloppy.volume import Volume


def main(words: Sequence[str] | None = None) -> int:
    """Serve until told to stop; return the exit status."""
    return command_line.run("treenail pfloppy", lambda: _act(words))


def _act(words: Sequence[str] | None) -> int:
    parser = _parser()
    arguments = parser.parse_args(words)
    if not NAME.fullmatch(arguments.system):
        parser.error(f"--system: expected {NAME_RULE}, got {arguments.system!r}")
    signal.signal(signal.SIGTERM, _stop)
    protocol = find(arguments.protocol)
    volumes = _disks(arguments.folders, arguments.system, arguments.read_only)
    line = serial_line.line_of(arguments)
    line.open()
    _say(f"{arguments.protocol}: {protocol.summary}")
    _say("never yet run on hardware")
    _say(f"{line.url} {line.settings}: {_units(arguments.folders)}; end with Ctrl-C")
    with suppress(KeyboardInterrupt):  # it serves until then
        serve(line, protocol(volumes), _say)
    return 0


def _parser() -> Parser:
    parser = Parser(prog="treenail pfloppy", description=__doc__)
    serial_line.add_arguments(parser)
    parser.add_argument(
        "folders", metavar="DIR|IMAGE", nargs="+", type=Path, help="folder or disk image of a unit: the first is unit 0"
    )
    known = ", ".join(names())
    parser.add_argument("--protocol", default="tu58", help=f"one of {known} (default: tu58, a stand-in)")
    parser.add_argument("--system", default="VAL.SYS", help="file that the boot block names (default: VAL.SYS)")
    parser.add_argument("--read-only", action="store_true", help="the controller may not change anything")
    return parser


def _disks(paths: list[Path], system: str, read_only: bool) -> list[Disk]:
    """Return the units: a plain file is an image, all else a folder. Images may lie in one folder."""
    homes: dict[Path, Folder] = {}
    disks: list[Disk] = []
    try:
        for path in paths:
            if not path.is_file():
                disks.append(Volume(Folder(path), system, read_only, _say))
                continue
            home = path.parent.resolve()
            homes[home] = homes.get(home) or Folder(path.parent)
            disks.append(Image(homes[home], path.name, read_only, _say))
    except DiskError as error:
        raise FolderError(str(error)) from error
    return disks


def _units(folders: list[Path]) -> str:
    return ", ".join(f"unit {number} is {path}" for number, path in enumerate(folders))


def _say(line: str) -> None:
    print(f"pfloppy: {line}", flush=True)


def _stop(number: int, frame: FrameType | None) -> None:
    raise KeyboardInterrupt


if __name__ == "__main__":
    sys.exit(main())
