"""A serial line by pyserial URL for the tools: can be waited for with ``select``, and its errors are one line."""

from __future__ import annotations

import argparse
import errno
import os
import select
import socket
import stat
import termios
import threading
from dataclasses import dataclass
from typing import Any

from services.rules.command_line import number
from services.rules.settings import add_settings, setting, settings_of
from services.wire.errors import TreenailError

WRITE_TIMEOUT_S = 5.0
"""How long a peer may refuse to take bytes before the line counts as lost."""
_POLL_S = 0.05
_NO_WRITE_TIMEOUT = "rfc2217:"
"""pyserial refuses a write timeout there."""
_FAILURES = (OSError, ValueError, TypeError, KeyError, NotImplementedError, termios.error)
"""What pyserial raises, wrong URLs included; its own errors are OSErrors."""
_REASONS = {
    errno.EACCES: "not allowed; the user must be in the group that owns the port, often dialout",
    errno.EAGAIN: "in use by another program",
    errno.EBUSY: "in use by another program",
    errno.ENOENT: "no such port",
    errno.ENXIO: "nothing is plugged in there",
    errno.ENODEV: "nothing is plugged in there",
}


class LineError(TreenailError):
    """A line that cannot be opened, or that is gone."""


@dataclass(frozen=True)
class LineSettings:
    """How bytes go over the wire. Ignored by ``socket://``, passed on by ``rfc2217://``."""

    baud: int = setting(9600, "bits per second", within=(1, 10_000_000))
    """Likely for VAL II; so is what follows."""
    bits: int = setting(8, "data bits", within=(5, 8))
    parity: str = setting("N", "none, even, odd, mark or space", choices=tuple("NEOMS"))
    stop: float = setting(1.0, "stop bits", choices=(1.0, 1.5, 2.0), type=number(1.0, 2.0))
    xonxoff: bool = setting(False, "software flow control")
    rtscts: bool = setting(False, "hardware flow control")

    def __str__(self) -> str:
        flow = " XON/XOFF" * self.xonxoff + " RTS/CTS" * self.rtscts
        return f"{self.baud} {self.bits}{self.parity}{self.stop:g}{flow}"


class Line:
    """One line; ``open`` it, also again after a LineError."""

    def __init__(self, url: str, settings: LineSettings) -> None:
        self.url, self.settings = url, settings
        self._port: Any = None
        self._pump: _Pump | None = None

    def open(self) -> None:
        """Open the port for this process alone. Raises LineError."""
        self.close()
        import serial

        try:
            port = serial.serial_for_url(
                self.url,
                do_not_open=True,
                baudrate=self.settings.baud,
                bytesize=self.settings.bits,
                parity=self.settings.parity,
                stopbits=self.settings.stop,
                xonxoff=self.settings.xonxoff,
                rtscts=self.settings.rtscts,
                timeout=_POLL_S,
                write_timeout=None if self.url.lower().startswith(_NO_WRITE_TIMEOUT) else WRITE_TIMEOUT_S,
                exclusive=True,
            )
            port.open()
        except _FAILURES as error:
            raise LineError(f"{self.url}: cannot be opened: {_reason(error)}") from error
        self._port = port
        number = _number_of(port)
        if number is None:
            self._pump = _Pump(port)
            return
        port.timeout = 0
        if stat.S_ISSOCK(os.fstat(number).st_mode):
            with socket.socket(fileno=os.dup(number)) as same:  # small packets must not wait for each other
                same.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def fileno(self) -> int:
        """Return what ``select`` can wait for."""
        if self._pump is not None:
            return self._pump.outlet.fileno()
        return int(self._port.fileno())

    def read(self, timeout_s: float = 0.0) -> bytes:
        """Return what has come, after waiting so long [s] for it; nothing if nothing came. Raises LineError."""
        ready, _, _ = select.select([self], [], [], timeout_s)
        if not ready:
            return b""
        try:
            return self._pump.take() if self._pump is not None else bytes(self._port.read(4096))
        except _FAILURES as error:
            raise LineError(f"{self.url}: lost: {_reason(error)}") from error

    def write(self, data: bytes, drain: bool = False) -> None:
        """Send all bytes; with ``drain`` wait until they have left. Raises LineError."""
        try:
            self._port.write(data)
            if drain:
                self._port.flush()
        except _FAILURES as error:
            raise LineError(f"{self.url}: lost: {_reason(error)}") from error

    def close(self) -> None:
        """Give the port back. Harmless when it is closed."""
        port, self._port = self._port, None
        pump, self._pump = self._pump, None
        if pump is not None:
            pump.end()
        if port is not None:
            try:
                port.close()
            except _FAILURES:  # it is gone; nothing is left to close
                return


class _Pump(threading.Thread):
    """Carries what a port without file number receives (``loop://``, ``rfc2217://``) to a socket that has one."""

    def __init__(self, port: Any) -> None:
        super().__init__(daemon=True, name="serial line")
        self._port, self._failure = port, "closed"
        self._inlet, self.outlet = socket.socketpair()
        self._ended = threading.Event()
        self.start()

    def run(self) -> None:
        """Carry until the end, or until the port fails."""
        try:
            while not self._ended.is_set():
                data = self._port.read(1)
                waiting = self._port.in_waiting if data else 0
                self._inlet.sendall(data + (self._port.read(waiting) if waiting else b""))
        except _FAILURES as error:
            self._failure = _reason(error)
        self._inlet.close()

    def take(self) -> bytes:
        data = self.outlet.recv(4096)
        if not data:
            raise OSError(self._failure)
        return data

    def end(self) -> None:
        self._ended.set()
        self.join()
        self.outlet.close()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the URL and the settings of the line."""
    parser.add_argument("url", metavar="URL", help="pyserial URL: /dev/ttyS0, socket://HOST:PORT, rfc2217://HOST:PORT")
    add_settings(parser, LineSettings)


def line_of(arguments: argparse.Namespace) -> Line:
    """Return the line of parsed arguments, not yet open."""
    return Line(arguments.url, settings_of(LineSettings(), arguments))


def _number_of(port: Any) -> int | None:
    try:
        return int(port.fileno())
    except (AttributeError, OSError):  # io.UnsupportedOperation is an OSError
        return None


def _reason(error: BaseException) -> str:
    """Return why, in one line; pyserial hides the number of some errors in its own."""
    number = getattr(error, "errno", None)
    if number in _REASONS:
        return _REASONS[number]
    return " ".join(str(error).split()) or type(error).__name__
