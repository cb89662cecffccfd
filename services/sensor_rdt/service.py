"""The sensor on the bus: records as packets, troubles as status, a box that went away or began anew taken up again."""

from __future__ import annotations

import time
from itertools import islice

from services.bus.opening import Opening
from services.bus.service import Options, Service
from services.sensor_rdt.box import Box, calibrated
from services.sensor_rdt.calibration import Calibration
from services.sensor_rdt.errors import BoxError, RebootedError, SilentError
from services.sensor_rdt.records import BIAS, CHANGED, FILTER, LOST, NOT_ZEROED, RATE, STOP, STREAM
from services.sensor_rdt.settings import Settings
from services.sensor_rdt.stream import Stream
from services.wire.keys import FT
from services.wire.messages import FtPacket

SILENT_S = 0.1
"""How long no record may come once the stream was asked for."""
RETRY_S = (0.1, 2.0)
"""Shortest and longest pause before a box is tried again; each is twice the one before."""
USUAL_RATE_HZ = 7000.0
_BATCH_S, _MOST_BATCH = 0.002, 64
_TURN = 512
"""Records that are taken before others have their turn."""
_WORK_S = 0.001


def serve(options: Options, settings: Settings) -> None:
    """Run the sensor until it is stopped."""
    with Service("sensor_rdt", options) as service:
        service.claim()
        RdtShell(service, settings).run()


class RdtShell:
    """Keeps a box in use."""

    def __init__(self, service: Service, settings: Settings) -> None:
        self._service, self._settings = service, settings
        self._publish = service.series_publisher(FT, FtPacket)
        self._stream: Stream | None = None
        """None until it is known what a count is worth."""
        self._calibration: Calibration | None = None
        self._counted = (0, 0, 0, 0)
        self._ready = False
        self._retry_s = RETRY_S[0]

    def run(self) -> None:
        """Use the box; from the start again whenever something goes wrong."""
        while not self._service.stopping:
            box: Box | None = None
            try:
                stream = self._made_stream()
                if stream is not None:
                    box = Box(self._settings)
                    self._use(box, stream)
            except BoxError as error:
                self._on_failure(error)
            finally:
                if box is not None:
                    box.close()

    def _made_stream(self) -> Stream | None:
        """Learn what a count is worth, working meanwhile; None when stopped before. Raises CalibrationError.

        It is asked for anew each time: a box that was away may have come back with another sensor.
        """
        opening = Opening(lambda: calibrated(self._settings), lambda _: None)
        self._service.phase = "asking for the calibration"
        if not self._service.work_until(lambda: opening.done, 30.0):
            return None
        made, settings = opening.result(), self._settings
        stream = self._stream
        if stream is None or made != self._calibration:
            rate_hz = settings.rate_hz or made.rate_hz or USUAL_RATE_HZ
            batch = settings.batch or max(1, min(_MOST_BATCH, round(rate_hz * _BATCH_S)))
            before, stream = stream, Stream(made, settings.mount, rate_hz, batch)
            if before is not None:
                stream.sequence, stream.t_ns = before.sequence, before.t_ns
                self._publish((stream.say(CHANGED, time.time_ns()),))
            self._stream, self._calibration = stream, made
            self._service.log.info(
                "sensor %s, %g counts a N, %g counts a N m, %g Hz",
                made.serial or "without serial number",
                made.counts_per_n,
                made.counts_per_nm,
                rate_hz,
            )
        return stream

    def _use(self, box: Box, stream: Stream) -> None:
        """Publish until stopped. Raises BoxError."""
        service, settings = self._service, self._settings
        self._publish((stream.say(NOT_ZEROED, time.time_ns()),))
        box.ask(STOP)
        for command, value in ((FILTER, settings.onrobot_filter), (RATE, settings.onrobot_period_ms)):
            if value is not None:
                box.ask(command, value)
        if settings.zero:
            box.ask(BIAS)
        box.ask(STREAM)
        stream.begin()
        heard, odd = time.monotonic(), 0
        while not service.stopping:
            came = list(islice(iter(box.take, None), _TURN))
            self._publish(packet for record in came for packet in stream.take(*record))
            now = time.monotonic()
            if came:
                heard = now
                self._on_records(stream)
            elif now - heard > SILENT_S:
                raise SilentError(
                    f"sensor: expected records of {settings.box}:{settings.port}, got none for {SILENT_S:g} s; "
                    "is the address right, is the cable in, does another client stream?"
                )
            if box.odd > odd:
                service.refused["OddPackets"] += box.odd - odd
                service.complain(f"sensor: expected packets of 36 bytes, got {box.odd} others", topic="odd")
                odd = box.odd
            service.work(_WORK_S)

    def _on_records(self, stream: Stream) -> None:
        """Count what was lost, came twice or late, and say what the sensor tells."""
        service = self._service
        self._retry_s = RETRY_S[0]
        now = (stream.lost, stream.repeated, stream.late, stream.taken)
        lost, repeated, late, taken = (new - old for new, old in zip(now, self._counted, strict=True))
        self._counted = now if min(lost, repeated, late, taken) >= 0 else (0, 0, 0, 0)
        service.handled += max(0, taken)
        for name, count in (("LostSamples", lost), ("RepeatedSamples", repeated), ("LateSamples", late)):
            if count > 0:
                service.refused[name] += count
                service.complain(f"sensor: {name}: {count} more", topic=name)
        if stream.trouble:
            service.complain(f"sensor: expected one that works, got: {stream.trouble}", topic="status")
        if not self._ready:
            self._ready = True
            service.ready()
        troubled = f"sensor: {stream.trouble}" if stream.trouble else "running"
        service.phase = troubled if not stream.lost or stream.trouble else f"running, {stream.lost} samples lost"

    def _on_failure(self, error: BoxError) -> None:
        """Say what is wrong, to the robot first, and wait before the next attempt."""
        service, stream = self._service, self._stream
        if stream is not None:
            self._publish(stream.flush())
            self._publish((stream.say(CHANGED if isinstance(error, RebootedError) else LOST, time.time_ns()),))
        service.refuse(error)
        service.phase = f"sensor lost, trying again: {error}"[:200]
        service.work_until(lambda: False, self._retry_s)
        self._retry_s = min(RETRY_S[1], 2.0 * self._retry_s)
