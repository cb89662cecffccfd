"""``treenail record``: the F/T stream of a living cell, sample by sample, into MCAP files of bounded size."""

from __future__ import annotations

import argparse
import signal
import time
from collections import deque
from pathlib import Path

from services.bus.stop_flag import StopFlag
from services.cell import client
from services.rules.command_line import number, whole
from services.wire.keys import FT
from services.wire.messages import FtPacket

MB = 1_000_000
WAITING = 65_536
"""Packets that may wait to be written; when more come, the oldest are lost, and counted."""
LOOK_EVERY_S = 0.05
TELL_EVERY_S = 10.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.epilog = "It only listens; Ctrl-C ends it. docs/export.md has more."
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="where to: ft-000000.mcap and so on")
    parser.add_argument("--most", type=whole(2, 1_000_000), default=500, metavar="MB", help="kept; the oldest go")
    parser.add_argument("--piece", type=whole(1, 10_000), default=20, metavar="MB", help="size of a file")
    parser.add_argument("--seconds", type=number(0.1, 1e7), metavar="S", help="how long (default: until Ctrl-C)")
    client.add_arguments(parser)


def act(arguments: argparse.Namespace) -> None:
    """Record until stopped, and say what came of it."""
    from experiments.export.stream import Pieces  # here: a missing extra is said before anything is asked

    stopped, ended = StopFlag(signal.SIGINT), StopFlag(signal.SIGTERM)
    with client.client_of(arguments) as cell:
        pieces = Pieces(arguments.folder, arguments.piece * MB, arguments.most * MB)
        arrived: deque[FtPacket] = deque(maxlen=WAITING)
        cell.subscribe(FT, FtPacket, arrived.append)
        until = None if arguments.seconds is None else time.monotonic() + arguments.seconds
        next_word = time.monotonic() + TELL_EVERY_S
        try:
            while not (stopped or ended) and (until is None or time.monotonic() < until):
                while arrived:
                    pieces.take(arrived.popleft())
                if time.monotonic() >= next_word:
                    next_word += TELL_EVERY_S
                    print(f"{pieces.samples} samples, {pieces.lost} lost on the way", flush=True)
                time.sleep(LOOK_EVERY_S)
        finally:
            pieces.close()
    print(f"{arguments.folder}: {pieces.samples} samples, {pieces.lost} lost on the way")
