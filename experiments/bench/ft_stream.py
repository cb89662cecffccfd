"""A fast F/T sensor and somebody who counts what arrives of it, as processes of their own.

``python -m experiments.bench.ft_stream send|receive``: the sender has the role ``sensor_jr3`` of a cell and publishes
8000 simulated samples a second in packets, the receiver has the role ``task``, which a robot's cell needs the samples
for.
Each stops at SIGTERM, the receiver only once nothing comes any more, and prints its figures as one line of JSON.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Sequence

import numpy as np

from services.bus import command
from services.bus.service import Service
from services.rules.command_line import Parser, whole
from services.wire.errors import TreenailError
from services.wire.keys import FT
from services.wire.messages import Force, FtPacket, Torque

SAMPLES_PER_S = 8000
PERIOD_NS = 1_000_000_000 // SAMPLES_PER_S
MOST_IN_A_PACKET = 64
SENDER, RECEIVER = "sensor_jr3", "task"
QUIET_S = 0.5
"""A receiver that is asked to stop does so when nothing has come for so long."""
_BIN_NS = 10_000
_BINS = 100_000


class Delays:
    """Delays as a histogram of constant size: 10 us apart up to 1 s, what is above counts as the greatest."""

    def __init__(self) -> None:
        self._bins = np.zeros(_BINS, dtype=np.int64)
        self._greatest_ns = 0

    def add(self, delay_ns: int) -> None:
        """Count one delay; one below 0 counts as 0."""
        self._bins[min(max(delay_ns, 0) // _BIN_NS, _BINS - 1)] += 1
        self._greatest_ns = max(self._greatest_ns, delay_ns)

    def percentile_ms(self, percent: float) -> float:
        """Return the delay [ms], rounded up to 10 us, that so many percent do not exceed; 0 of none."""
        passed = np.cumsum(self._bins)
        if passed[-1] == 0:
            return 0.0
        place = int(np.searchsorted(passed, max(1, math.ceil(passed[-1] * percent / 100))))
        return self.max_ms if place == _BINS - 1 else min((place + 1) * _BIN_NS / 1e6, self.max_ms)

    @property
    def max_ms(self) -> float:
        """Return the greatest delay [ms]."""
        return self._greatest_ns / 1e6

    def figures(self) -> dict[str, float]:
        """Return median, 99th percentile and maximum."""
        return {"median_ms": self.percentile_ms(50), "p99_ms": self.percentile_ms(99), "max_ms": self.max_ms}


class Received:
    """Counts samples by their numbers: what came, what is missing between, what came again or too late."""

    def __init__(self) -> None:
        self.samples = 0
        self.lost = 0
        self.gaps = 0
        self.out_of_order = 0
        self.delays = Delays()
        self._next = 0

    def take(self, packet: FtPacket, arrived_ns: int) -> None:
        """Count a packet that arrived at a time of the sender's clock. The first sample has number 0."""
        first = packet.sequence - len(packet.force_n) + 1
        if first < self._next:
            self.out_of_order += 1
            return
        if first > self._next:
            self.gaps += 1
            self.lost += first - self._next
        self._next = packet.sequence + 1
        self.samples += len(packet.force_n)
        self.delays.add(arrived_ns - packet.t_ns)

    def figures(self) -> dict[str, float]:
        """Return all that was counted."""
        counts = {"samples": self.samples, "lost": self.lost, "gaps": self.gaps, "out_of_order": self.out_of_order}
        return {**counts, **self.delays.figures()}


def samples() -> tuple[tuple[Force, ...], tuple[Torque, ...]]:
    """Return one second of simulated samples [N, N m]: pressing, with the vibration and noise of a wrist."""
    seconds = np.arange(SAMPLES_PER_S) / SAMPLES_PER_S
    noise = np.random.Generator(np.random.Philox(key=0)).normal(scale=0.02, size=(SAMPLES_PER_S, 6))
    hertz = np.array([35.0, 35.0, 50.0, 80.0, 80.0, 120.0])
    level = np.array([0.3, -0.2, -2.0, 0.01, -0.02, 0.0])
    all_six = (level * (1 + 0.1 * np.sin(2 * np.pi * np.outer(seconds, hertz))) + noise).tolist()
    return tuple((x, y, z) for x, y, z, *_ in all_six), tuple((x, y, z) for *_, x, y, z in all_six)


def send(service: Service, in_packet: int) -> dict[str, float]:
    """Publish until stopped. ``late`` is how long after it was due a packet was made, which catches up afterwards."""
    publish = service.publisher(FT, FtPacket)
    force_n, torque_nm = samples()
    sent, late = 0, Delays()
    began = time.monotonic_ns()
    while not service.stopping:
        due = began + (sent + in_packet - 1) * PERIOD_NS
        if (left := due - time.monotonic_ns()) > 0:
            service.work(left / 1e9)
            continue
        service.work(0.0)
        at = sent % SAMPLES_PER_S
        now = time.monotonic_ns()
        late.add(now - due)
        sent += in_packet
        publish(
            FtPacket(
                sequence=sent - 1,
                t_ns=now,
                period_ns=PERIOD_NS,
                force_n=force_n[at : at + in_packet],
                torque_nm=torque_nm[at : at + in_packet],
            )
        )
    seconds = (time.monotonic_ns() - began) / 1e9
    return {"samples": sent, "seconds": seconds, **{f"late_{name}": value for name, value in late.figures().items()}}


def receive(service: Service) -> dict[str, float]:
    """Count until stopped and nothing comes any more."""
    received = Received()
    service.subscribe(FT, FtPacket, lambda packet: received.take(packet, time.monotonic_ns()), SENDER)
    service.ready()
    service.loop()
    quiet_since = time.monotonic()
    while time.monotonic() < quiet_since + QUIET_S:
        if service.work(QUIET_S):
            quiet_since = time.monotonic()
    return {**received.figures(), "refused": sum(service.refused.values())}


def main(words: Sequence[str] | None = None) -> None:
    """Play one of the two parts until stopped."""
    parser = Parser(prog="ft_stream", description=__doc__)
    parser.add_argument("part", choices=("send", "receive"))
    parser.add_argument("--in-packet", type=whole(1, MOST_IN_A_PACKET), default=8, help="samples in a packet")
    command.add_arguments(parser)
    arguments = parser.parse_args(words)
    if SAMPLES_PER_S % arguments.in_packet:
        raise TreenailError(f"--in-packet: expected 1 to 64 and a divisor of 8000, got {arguments.in_packet}")
    name = SENDER if arguments.part == "send" else RECEIVER
    with Service(name, command.options(arguments)) as service:
        service.claim()
        if name == SENDER:
            here: set[str] = set()
            service.watch(lambda other, alive: here.add(other) if alive else here.discard(other))
            if not service.work_until(lambda: RECEIVER in here, 60.0):
                raise TreenailError("ft_stream: expected a receiver within 60 s, got none")
            service.ready()
            figures = send(service, arguments.in_packet)
        else:
            figures = receive(service)
        print(json.dumps(figures), flush=True)


if __name__ == "__main__":
    command.run("ft_stream", main)
