"""Listening to all that a cell publishes, without a way to slow it down."""

from __future__ import annotations

import time

import zenoh

from services.bus.stop_flag import StopFlag
from services.cell.client import Client
from services.cell.traffic import Published, Traffic

RING = 16384
"""Messages that may wait to be read; a cell at full speed publishes some thousand a second."""
READ_EVERY_S = 0.1


class Watch:
    """Listens to all that a cell publishes: what is not read in time is lost, and said so in ``traffic.complete``."""

    def __init__(self, cell: Client, marks: int) -> None:
        """Rates are measured from the oldest of the last ``marks`` calls of ``traffic.mark``."""
        self.cell = cell
        self.traffic = Traffic(time.monotonic(), marks)
        self._prefix = cell.keys.of("")
        self._subscriber = cell.session.declare_subscriber(cell.keys.of("**"), zenoh.handlers.RingChannel(RING))

    def read_for(self, seconds: float, stop: StopFlag | None = None) -> None:
        """Count what arrives in so many seconds, or until ``stop`` is set."""
        deadline = time.monotonic() + seconds
        while (left := deadline - time.monotonic()) > 0 and not stop:
            time.sleep(min(READ_EVERY_S, left))
            self._read()

    def _read(self) -> None:
        for _ in range(RING):
            sample = self._subscriber.try_recv()
            if sample is None:
                return
            self.traffic.take(_published(sample, self._prefix), time.monotonic())
        self.traffic.complete = False  # as much as fits was waiting, so something may have been pushed out


def _published(sample: zenoh.Sample, prefix: str) -> Published:
    stamp = sample.timestamp
    return Published(
        str(sample.key_expr).removeprefix(prefix),
        sample.payload.to_bytes(),
        str(sample.encoding),
        None if stamp is None else stamp.get_time_as_ntp64().as_nanos(),
    )
