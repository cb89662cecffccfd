"""The F/T stream of a cell as MCAP files of bounded size, one after the other; the oldest go when there are too many.

A file has its name when it is whole, with an index, so that any moment of it is at hand. Samples have the times that
their sensor gave them.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import IO

from mcap.writer import Writer

from experiments.export.aside import ExportError
from services.ros2.messages import WRENCH, Messages, Wrench
from services.wire.messages import FtPacket

TOPIC = "/treenail/ft"
FRAME = "tool"


class Pieces:
    """Files ``ft-000000.mcap``, ``ft-000001.mcap`` and so on in a folder."""

    def __init__(self, folder: Path, piece_bytes: int, most_bytes: int) -> None:
        """Begin after the pieces that are there. Raises ExportError when the folder cannot be written to."""
        self._folder, self._piece_bytes, self._most_bytes = folder, piece_bytes, most_bytes
        self._messages = Messages()
        self._file: IO[bytes] | None = None
        self._last: int | None = None
        self.samples = 0
        self.lost = 0
        """Samples of a stream that were sent and did not come, by their numbers."""
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ExportError(f"{folder}: expected a folder to record to, got: {error.strerror}") from error
        self._number = max((int(path.stem.removeprefix("ft-")) + 1 for path in self.whole()), default=0)

    def whole(self) -> list[Path]:
        """Return the pieces that are whole, oldest first."""
        return sorted(path for path in self._folder.glob("ft-*.mcap") if path.stem.removeprefix("ft-").isdigit())

    def take(self, packet: FtPacket) -> None:
        """Record the samples of a packet. Raises ExportError when they cannot be written; what is whole stays."""
        count = len(packet.force_n)
        # Only a stream has numbers without gaps: the simulator's samples are numbered by episode and motion.
        if packet.period_ns and self._last is not None and packet.sequence > self._last:
            self.lost += max(0, packet.sequence - self._last - count)
        self._last = packet.sequence
        try:
            writer, file = self._open()
            for place, (force_n, torque_nm) in enumerate(zip(packet.force_n, packet.torque_nm, strict=False)):
                back = count - 1 - place
                t_ns = max(0, packet.t_ns - back * packet.period_ns)
                sequence = (packet.sequence - back) % 2**32
                data = self._messages.wrench(Wrench(t_ns, FRAME, force_n, torque_nm))
                writer.add_message(self._channel, log_time=t_ns, publish_time=t_ns, sequence=sequence, data=data)
                self.samples += 1
            if file.tell() >= self._piece_bytes:
                self.close()
        except OSError as error:
            self._give_up()
            raise ExportError(f"{self._folder}: cannot record, what is there stays: {error.strerror}") from error

    def close(self) -> None:
        """Give the piece under way its name, and remove the oldest beyond what is kept. Raises OSError."""
        if self._file is None:
            return
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()
        self._file = None
        self._aside().replace(self._folder / f"ft-{self._number:06d}.mcap")
        self._number += 1
        there = self.whole()
        sizes = [path.stat().st_size for path in there]
        while len(there) > 1 and sum(sizes) > self._most_bytes:
            there.pop(0).unlink()
            sizes.pop(0)

    def _open(self) -> tuple[Writer, IO[bytes]]:
        if self._file is None:
            self._file = self._aside().open("wb")
            self._writer = Writer(self._file, chunk_size=1 << 18)
            self._writer.start(profile="ros2", library="treenail")
            definition = self._messages.definition(WRENCH)
            schema = self._writer.register_schema(WRENCH, "ros2msg", definition.encode())
            self._channel = self._writer.register_channel(TOPIC, "cdr", schema)
        return self._writer, self._file

    def _give_up(self) -> None:
        if self._file is not None:
            with suppress(OSError):  # what waits to be written cannot be either
                self._file.close()
            self._file = None
            self._aside().unlink(missing_ok=True)

    def _aside(self) -> Path:
        return self._folder / f".ft-{self._number:06d}.{os.getpid()}"
