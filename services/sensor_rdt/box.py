"""The way to a box: records by UDP, read on a thread so that none is lost meanwhile; its page by HTTP."""

from __future__ import annotations

import contextlib
import http.client
import socket
import threading
import time
from collections import deque

from services.sensor_rdt import calibration, records
from services.sensor_rdt.calibration import LARGEST_PAGE, Calibration
from services.sensor_rdt.errors import BoxError, CalibrationError
from services.sensor_rdt.records import Record
from services.sensor_rdt.settings import Settings

PAGE = "/netftapi2.xml"
_PAGE_S = 3.0
_KEPT = 1 << 16
_BUFFER = 1 << 22
_WAIT_S = 0.2


def calibrated(settings: Settings) -> Calibration:
    """Return what a count is worth, as said or as the box's page tells; blocks. Raises CalibrationError."""
    if settings.counts_per_force is not None and settings.counts_per_torque is not None:
        units = settings.force_unit, settings.torque_unit
        return calibration.said(settings.counts_per_force, settings.counts_per_torque, *units)
    connection = http.client.HTTPConnection(settings.box, settings.page_port, timeout=_PAGE_S)
    where = f"http://{settings.box}:{settings.page_port}{PAGE}"
    try:
        connection.request("GET", PAGE)
        answer = connection.getresponse()
        page = answer.read(LARGEST_PAGE + 1)
    except (OSError, http.client.HTTPException) as error:
        raise CalibrationError(
            f"calibration: expected the box's page at {where}, got {error}; or say --counts-per-force and "
            "--counts-per-torque, as its sheet has them"
        ) from None
    finally:
        connection.close()
    if answer.status != 200:
        raise CalibrationError(f"calibration: expected the box's page at {where}, got HTTP {answer.status}")
    return calibration.from_page(page)


class Box:
    """A stream of records."""

    def __init__(self, settings: Settings) -> None:
        """Ask for nothing yet. Raises BoxError when there is no way to that address."""
        self.odd = 0
        """Packets that are no record."""
        self._came: deque[tuple[Record, int]] = deque(maxlen=_KEPT)
        self._open = True
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        self._socket.settimeout(_WAIT_S)
        try:
            self._socket.connect((settings.box, settings.port))  # so that nobody else's packets are heard
        except OSError as error:
            self._socket.close()
            raise BoxError(f"sensor: {settings.box}:{settings.port} cannot be reached: {error}") from None
        self._ahead_ns = time.time_ns() - time.monotonic_ns()
        self._thread = threading.Thread(target=self._read, name="rdt", daemon=True)
        self._thread.start()

    def ask(self, command: int, count: int = 0) -> None:
        """Send a request; no box answers that. Raises BoxError."""
        try:
            self._socket.send(records.request(command, count))
        except OSError as error:
            raise BoxError(
                f"sensor: expected a box that listens, got {error}; is the address right, is it on?"
            ) from None

    def take(self) -> tuple[Record, int] | None:
        """Return the next record, and when it came [ns, time of day without jumps]."""
        return self._came.popleft() if self._came else None

    def close(self) -> None:
        """End the stream."""
        self._open = False
        with contextlib.suppress(OSError):  # it may be gone
            self._socket.send(records.request(records.STOP))
        self._thread.join()
        self._socket.close()

    def _read(self) -> None:
        while self._open:
            try:
                data = self._socket.recv(256)
            except TimeoutError:
                continue
            except OSError:
                time.sleep(_WAIT_S)  # nobody listens there yet
                continue
            record = records.record(data)
            if record is None:
                self.odd += 1
            else:
                self._came.append((record, time.monotonic_ns() + self._ahead_ns))
