"""The loop of pfloppy: a line on one side, a protocol machine on the other. A line that is lost is opened again."""

from __future__ import annotations

import time
from collections.abc import Callable

from services.robot_link.serial_line import Line, LineError
from treenail.tools.pfloppy.protocols import FloppyProtocol

SILENCE_S = 1.0
"""So long without a byte, and a packet that has begun does not go on."""
RETRY_S = 1.0


def serve(line: Line, drive: FloppyProtocol, say: Callable[[str], None]) -> None:
    """Serve for ever, beginning with an open line."""
    while True:
        try:
            _serve(line, drive)
        except LineError as error:
            say(f"{error}; trying again every {RETRY_S:g} s")
        _reopen(line)
        say(f"{line.url}: open again")


def _serve(line: Line, drive: FloppyProtocol) -> None:
    """Serve until LineError."""
    while True:
        while chunk := drive.transmit():
            line.write(chunk, drain=True)  # not more than a packet ahead, so that XOFF and INIT are heard in time
            drive.receive(line.read())
        came = line.read(SILENCE_S)
        if came:
            drive.receive(came)
        else:
            drive.silence()


def _reopen(line: Line) -> None:
    line.close()
    while True:
        time.sleep(RETRY_S)
        try:
            line.open()
        except LineError:
            continue
        return
