"""The emulated controller's ports on one address: 29999 dashboard, 30003 script, 30004 RTDE, and a panel of its own.

One thread serves all. Every loop first reads what has come from everybody, then lets the program go on: a register that
one connection has written before another's command is there when the command is carried out.
"""

from __future__ import annotations

import contextlib
import selectors
import socket
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from services.robot_ur.emulator.controller import CYCLE_S, LOG, Controller
from services.robot_ur.emulator.dashboard import BANNER, reply
from services.robot_ur.emulator.panel import press
from services.robot_ur.emulator.program import Program
from services.robot_ur.emulator.rtde import RtdeError, Session

DASHBOARD, SCRIPT, RTDE = 29999, 30003, 30004
_MOST_UNSENT = 1 << 20
_CHUNK = 65536


@dataclass
class Client:
    """One connection."""

    socket: socket.socket
    port: int
    """The controller's, that it came to; 0 for the panel."""
    text: bytes = b""
    unsent: bytes = b""
    session: Session | None = None
    later: list[tuple[float, bytes]] = field(default_factory=list)
    """Answers that are slow."""


class Server:
    """All ports of one controller."""

    def __init__(self, controller: Controller, host: str, panel_port: int = 0) -> None:
        """Raises OSError when a port of that address is taken."""
        self.controller, self._program = controller, Program(controller)
        self._selector = selectors.DefaultSelector()
        self._clients: dict[int, Client] = {}
        self._listeners: list[socket.socket] = []
        self._began_s = time.monotonic()
        for port in (DASHBOARD, SCRIPT, RTDE):
            self._listen(host, port, port)
        self.panel_port = self._listen("127.0.0.1", panel_port, 0)
        """On 127.0.0.1."""

    def step(self) -> None:
        """Serve everybody for one cycle of the controller."""
        events = self._selector.select(CYCLE_S)
        with self.controller.lock:
            self.controller.now_s = self._now_s()
            for key, mask in events:
                if isinstance(key.data, int):
                    self._accept(key.fileobj, key.data)
                elif mask & selectors.EVENT_READ:
                    self._read(key.data)
            self._program.tick()
            for client in list(self._clients.values()):
                self._send(client)

    def close(self) -> None:
        """Give all ports back."""
        for client in list(self._clients.values()):
            self._drop(client)
        for listener in self._listeners:
            listener.close()
        self._selector.close()

    def hang_up(self) -> None:
        """Close every client's connection."""
        for client in list(self._clients.values()):
            if client.port:
                self._drop(client)

    # -- details -----------------------------------------------------------------------------------------------------

    def _now_s(self) -> float:
        """Return the controller's time, which goes on in whole cycles."""
        return int((time.monotonic() - self._began_s) / CYCLE_S) * CYCLE_S

    def _listen(self, host: str, port: int, kind: int) -> int:
        listener = socket.create_server((host, port), backlog=8)
        listener.setblocking(False)
        self._selector.register(listener, selectors.EVENT_READ, kind)
        self._listeners.append(listener)
        return int(listener.getsockname()[1])

    def _accept(self, listener: object, port: int) -> None:
        assert isinstance(listener, socket.socket)
        if port and self.controller.faults.pulled:
            return
        with contextlib.suppress(OSError):
            connection, _ = listener.accept()
            connection.setblocking(False)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            client = Client(connection, port, session=Session(self.controller) if port == RTDE else None)
            if port == DASHBOARD:
                client.unsent = BANNER
            self._clients[connection.fileno()] = client
            self._selector.register(connection, selectors.EVENT_READ, client)

    def _read(self, client: Client) -> None:
        if client.port and self.controller.faults.pulled:
            return
        try:
            data = client.socket.recv(_CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            self._drop(client)
            return
        if client.session is not None:
            try:
                self._say(client, client.session.receive(data))
            except RtdeError as error:
                LOG.warning("RTDE: %s", error)
                self._drop(client)
        elif client.port == SCRIPT:
            self._program.take(data)
        else:
            self._take_lines(client, data, press if client.port == 0 else reply)

    def _take_lines(self, client: Client, data: bytes, answer: Callable[[Controller, str], str]) -> None:
        *lines, client.text = (client.text + data)[-_CHUNK:].split(b"\n")
        for line in lines:
            text = line.decode("utf-8", "replace").strip()
            if client.port == 0 and text == "hangup":
                self.hang_up()
                said = "done"
            else:
                said = answer(self.controller, text)
            self._say(client, said.encode() + b"\n")

    def _say(self, client: Client, data: bytes) -> None:
        slow_s = self.controller.faults.slow_s if client.port else 0.0
        if data:
            client.later.append((time.monotonic() + slow_s, data))

    def _send(self, client: Client) -> None:
        faults, now_s = self.controller.faults, time.monotonic()
        if client.port and faults.pulled:
            return
        while client.later and client.later[0][0] <= now_s:
            client.unsent += client.later.pop(0)[1]
        session = client.session
        due_s = None if session is None else session.due(self.controller.now_s)
        if session is not None and due_s is not None:
            if faults.drop > 0:
                faults.drop -= 1
            else:
                self._say(client, session.outputs(due_s))
        if not client.unsent:
            return
        try:
            sent = client.socket.send(client.unsent)
        except BlockingIOError:
            sent = 0
        except OSError:
            self._drop(client)
            return
        client.unsent = client.unsent[sent:]
        if len(client.unsent) > _MOST_UNSENT:
            self._drop(client)

    def _drop(self, client: Client) -> None:
        if self._clients.pop(client.socket.fileno(), None) is None:
            return
        self._selector.unregister(client.socket)
        client.socket.close()
        if client.session is not None:
            self.controller.release(client.session)
