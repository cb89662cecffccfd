"""The emulated controller on a TCP port or a pseudo terminal: one line, and a panel to disturb it."""

from __future__ import annotations

import contextlib
import os
import select
import socket
import time
import tty
from collections import deque
from typing import Any, Protocol

from services.robot_link.emulator.controller import Controller

_NUMBERS = ("garbage", "nonsense", "misheard", "half_way")
_SWITCHES = ("silence", "power")


class Text(Protocol):
    """What sits at the line: the controller's terminal itself, or its supervisor line."""

    @property
    def next_deadline_s(self) -> float | None:
        """When ``tick`` has something to do."""
        ...

    def start(self, now_s: float) -> bytes:
        """Be connected to; return bytes to send."""
        ...

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Take bytes; return bytes to send."""
        ...

    def tick(self, now_s: float) -> bytes:
        """Let time pass; return bytes to send."""
        ...


class Pace:
    """Bytes that take their time on the line; none for an ideal one. Pure."""

    def __init__(self, baud: int | None) -> None:
        """``baud`` bits per second, ten a byte; None for an ideal line."""
        self._byte_s = 10.0 / baud if baud else 0.0
        self._bytes: deque[tuple[float, int]] = deque()

    @property
    def next_s(self) -> float | None:
        """When the next byte is through."""
        return self._bytes[0][0] if self._bytes else None

    def put(self, data: bytes, now_s: float) -> None:
        """Take bytes at one end."""
        at_s = max(now_s, self._bytes[-1][0] if self._bytes else 0.0)
        for value in data:
            at_s += self._byte_s
            self._bytes.append((at_s, value))

    def take(self, now_s: float) -> bytes:
        """Return the bytes that are through."""
        through = bytearray()
        while self._bytes and self._bytes[0][0] <= now_s:
            through.append(self._bytes.popleft()[1])
        return bytes(through)

    def clear(self) -> None:
        """Forget what is under way."""
        self._bytes.clear()


class Server:
    """Serves one line at a time; ``step`` does what is to be done."""

    def __init__(
        self, controller: Controller, text: Text, host: str, port: int, *, baud: int | None = None, pty: bool = False
    ) -> None:
        """``text`` is what speaks at the line for the controller."""
        self.controller, self._text = controller, text
        self._in, self._out = Pace(baud), Pace(baud)
        self._slow_s = 0.0
        self._line: int | None = None
        self._socket: socket.socket | None = None
        self._listener, self._panel = _listen(host, port), _listen(host, 0)
        self._panels: dict[socket.socket, bytes] = {}
        self.pty = ""
        """Name of the pseudo terminal; empty without one."""
        if pty:
            self._line, self._slave = os.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self._line, False)
            self.pty = os.ttyname(self._slave)
            self._say(text.start(time.monotonic()))

    @property
    def port(self) -> int:
        """Where the line is."""
        return int(self._listener.getsockname()[1])

    @property
    def panel_port(self) -> int:
        """Where faults are set: lines such as ``garbage 1``, ``power 0``, ``hangup``; each is answered ``ok``."""
        return int(self._panel.getsockname()[1])

    def step(self, timeout_s: float) -> None:
        """Wait for something to happen, at most so long [s], and do it."""
        now = time.monotonic()
        waits = [at - now for at in (self._in.next_s, self._out.next_s, self._text.next_deadline_s) if at is not None]
        timeout_s = max(0.0, min([timeout_s, *waits]))
        line = [] if self._line is None else [self._line]
        sources: list[Any] = [self._listener, self._panel, *self._panels, *line]
        ready, _, _ = select.select(sources, [], [], timeout_s)
        for source in ready:
            if source is self._listener:
                self._accept()
            elif source is self._panel:
                self._panels[self._panel.accept()[0]] = b""
            elif isinstance(source, socket.socket):
                self._press(source)
            else:
                self._read()
        now = time.monotonic()
        came = self._in.take(now)
        if came:
            self._say(self._text.receive(came, now))
            self._flush()
        self._say(self._text.tick(time.monotonic()))
        self._flush()

    def close(self) -> None:
        """Give all ports back."""
        self._hang_up()
        for opened in (self._listener, self._panel, *self._panels):
            opened.close()

    def _accept(self) -> None:
        if not self.pty:
            self._hang_up()
            self._socket = self._listener.accept()[0]
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._line = self._socket.fileno()
            self._say(self._text.start(time.monotonic()))
        else:
            self._listener.accept()[0].close()

    def _hang_up(self) -> None:
        self._in.clear()
        self._out.clear()
        if self._socket is not None:
            self._socket.close()
            self._socket = self._line = None

    def _read(self) -> None:
        if self._line is None:
            return
        try:
            data = os.read(self._line, 4096)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if data:
            self._in.put(data, time.monotonic())
        elif not self.pty:
            self._hang_up()

    def _say(self, data: bytes) -> None:
        if data:
            self._out.put(data, time.monotonic() + self._slow_s)

    def _flush(self) -> None:
        data = self._out.take(time.monotonic())
        while data and self._line is not None:
            try:
                data = data[os.write(self._line, data) :]
            except BlockingIOError:
                return  # nobody reads the pseudo terminal: a real line loses it too
            except OSError:
                self._hang_up()

    def _press(self, panel: socket.socket) -> None:
        data = panel.recv(1024)
        if not data:
            panel.close()
            del self._panels[panel]
            return
        *lines, self._panels[panel] = (self._panels[panel] + data).split(b"\n")
        for line in lines:
            answer = self._change_setting(line.decode("ascii", "replace").split())
            with contextlib.suppress(OSError):
                panel.sendall(answer.encode() + b"\n")

    def _change_setting(self, words: list[str]) -> str:
        name, number = (words[0], words[1]) if len(words) == 2 else (words[0] if words else "", "")
        faults = self.controller.faults
        if name == "hangup":
            self._hang_up()
        elif name == "motions":
            return str(self.controller.motions)
        elif name == "say" and number:
            self._say(number.encode() + b"\r\n")
        elif name in _NUMBERS and number.isdigit():
            setattr(faults, name, int(number))
        elif name in _SWITCHES and number in ("0", "1"):
            setattr(faults, name, number == "1")
        elif name == "slow" and number.isdigit():
            self._slow_s = int(number) / 1000.0
        else:
            names = ", ".join((*_NUMBERS, *_SWITCHES))
            return (
                f"expected hangup, motions, say WORD, slow MS or one of {names} with a number, got {' '.join(words)!r}"
            )
        return "ok"


def _listen(host: str, port: int) -> socket.socket:
    return socket.create_server((host, port))


def press(host: str, port: int, line: str) -> str:
    """Set a fault of an emulator by its panel; return what it answers."""
    with socket.create_connection((host, port), timeout=10.0) as panel:
        panel.sendall(line.encode() + b"\n")
        return panel.makefile().readline().strip()
