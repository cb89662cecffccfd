"""What the controller tells of itself, packet by packet, none left out: the receiving side of RTDE, version 2.

A client that looks at the newest packet only leaves some out whenever it is late, and a mean of so many samples that
follow each other never comes about on a busy machine. Here they wait in the socket until they are taken.

All big-endian: uint16 size of the whole, uint8 type, payload. Source: Universal Robots, "Real-Time Data Exchange (RTDE)
Guide". Types: V protocol version, O what shall be in a packet, S start, U a packet, M a text for people.
"""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Sequence

from services.robot_ur.errors import LostError, StateError

PORT = 30004
Values = dict[str, tuple[float, ...]]
"""By name of the output."""
_FORMATS = {"DOUBLE": "d", "INT32": "i", "UINT32": "I", "VECTOR3D": "3d", "VECTOR6D": "6d"}
_ANSWER_S = 3.0
_LARGEST, _CHUNK = 4096, 65536


class Recipe:
    """How the packets of one connection are made up."""

    def __init__(self, names: Sequence[str], types: Sequence[str]) -> None:
        """``types``: as the controller tells them. Raises StateError for an output that it does not have."""
        missing = [name for name, kind in zip(names, types, strict=False) if kind not in _FORMATS]
        if missing or len(types) != len(names):
            raise StateError(
                f"robot: expected a controller that gives {', '.join(names)}, this one does not know "
                f"{', '.join(missing) or 'all of them'}; ft_raw_wrench is asked for by --wrist raw only, from 5.9 on"
            )
        self._fields = [(name, struct.Struct(">" + _FORMATS[kind])) for name, kind in zip(names, types, strict=True)]
        self._size = 1 + sum(form.size for _, form in self._fields)

    def values(self, body: bytes) -> Values:
        """Return what is in a packet's body. Raises LostError for one of another size."""
        if len(body) != self._size:
            raise LostError(f"robot: expected packets of {self._size} bytes, got one of {len(body)}")
        at, values = 1, {}
        for name, form in self._fields:
            values[name] = form.unpack_from(body, at)
            at += form.size
        return values


class Packets:
    """A stream of packets. Not for several threads."""

    def __init__(self, address: str, rate_hz: float, names: Sequence[str], port: int = PORT) -> None:
        """Connect, and have packets sent; blocks. Raises LostError, and StateError for outputs that there are not."""
        self.connected = True
        self._data = b""
        try:
            self._socket = socket.create_connection((address, port), _ANSWER_S)
        except OSError as error:
            raise LostError(f"robot: expected a controller at {address}, port {port}, got: {error}") from None
        try:
            if self._ask("V", struct.pack(">H", 2)) != b"\x01":
                raise StateError("robot: expected a controller with RTDE of version 2, this one has not")
            answer = self._ask("O", struct.pack(">d", rate_hz) + ",".join(names).encode())
            self._recipe = Recipe(names, [word for word in answer[1:].decode("ascii", "replace").split(",") if word])
            if self._ask("S", b"") != b"\x01":
                raise StateError("robot: expected the controller to send its packets, it refuses")
            self._socket.setblocking(False)
        except (LostError, StateError):
            self._socket.close()
            raise

    def take(self) -> Values | None:
        """Return the next packet that has come, None for none so far. Raises LostError for what is no packet."""
        while True:
            kind, body = self._next()
            if kind == "U":
                return self._recipe.values(body)
            if not kind and not self._read():
                return None

    def close(self) -> None:
        """Let go."""
        self.connected = False
        self._socket.close()

    # -- details -----------------------------------------------------------------------------------------------------

    def _ask(self, kind: str, body: bytes) -> bytes:
        """Say something and return what is answered; blocks. Raises LostError."""
        deadline = time.monotonic() + _ANSWER_S
        try:
            self._socket.sendall(struct.pack(">HB", len(body) + 3, ord(kind)) + body)
        except OSError:
            self.connected = False
        while self.connected and time.monotonic() < deadline:
            got, answer = self._next()
            if got == kind:
                return answer
            if not got:
                self._read()
        raise LostError(f"robot: expected an answer of the controller on port {PORT}, got none")

    def _next(self) -> tuple[str, bytes]:
        """Return type and body of the next packet that is here as a whole; nothing for none. Raises LostError."""
        if len(self._data) < 3:
            return "", b""
        size, kind = struct.unpack_from(">HB", self._data)
        if not 3 <= size <= _LARGEST:
            raise LostError(f"robot: expected packets of 3 to {_LARGEST} bytes, got one of {size}")
        if len(self._data) < size:
            return "", b""
        body, self._data = self._data[3:size], self._data[size:]
        return chr(kind), body

    def _read(self) -> bool:
        """Read what has come; return whether that was anything."""
        try:
            data = self._socket.recv(_CHUNK)
        except (BlockingIOError, TimeoutError):
            return False
        except OSError:
            data = b""
        self.connected = bool(data)
        self._data += data
        return self.connected
