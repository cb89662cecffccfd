"""The controller's end of a DDCMP line, written from the protocol by itself: it shares no code with the driver's end.

It speaks as VAL II was seen to: FF FF round every frame, Q and S set on every frame, STRT repeated until it is
answered, one message under way at a time. When the line fails it begins anew, as if the supervisor switch had been
turned off and on. Pure: bytes and time in, bytes out.
"""

from __future__ import annotations

import struct

ACK, NAK, REP, STRT, STACK = 1, 2, 3, 6, 7
DATA_BAD, NOT_COME, TOO_LONG = 2, 3, 16
MOST_IN_A_ROW = 8
MOST_BYTES = 512
GAP_S = 1.0
"""What has begun and gets no byte for so long is forgotten."""
_POLYNOMIAL = 0b1_1000_0000_0000_0101
_FLAGS = 0xC0


def remainder(data: bytes) -> int:
    """Return what is left of ``data``, bits lowest first, divided by the CRC-16 polynomial; 0 if they end with it."""
    left = 0
    for byte in data:
        for place in range(8):
            left = left << 1 ^ (byte >> place & 1) << 16
            if left & 1 << 16:
                left ^= _POLYNOMIAL
    return int(f"{left:016b}"[::-1], 2)


def sealed(data: bytes) -> bytes:
    """Return ``data`` and their CRC."""
    return data + struct.pack("<H", remainder(data))


class ControllerLine:
    """One end; ``messages`` collects what came, ``begun`` counts how often both ends have come together."""

    def __init__(self, timer_s: float = 3.0, fill: bytes = b"\xff\xff") -> None:
        """Take the time [s] after which STRT, STACK or REP is sent, and the bytes round each frame."""
        self.messages: list[bytes] = []
        self.begun = 0
        self.troubles: list[str] = []
        """Why the line had to begin anew, each time."""
        self._timer_s, self._fill = timer_s, fill
        self._forget()

    def _forget(self) -> None:
        self._came, self._came_s = b"", 0.0
        self._phase = "off"
        self._to_send: list[bytes] = []
        self._under_way = False
        self._sent = self._got = 0
        self._patience = 0
        self._due_s: float | None = None

    @property
    def next_deadline_s(self) -> float | None:
        """When ``tick`` must be called at the latest; None if bytes alone matter."""
        return self._due_s

    @property
    def running(self) -> bool:
        """Whether messages can pass."""
        return self._phase == "running"

    def start(self, now_s: float) -> bytes:
        """Forget everything and send STRT."""
        self._forget()
        self._phase = "strt"
        return self._control(STRT, now_s=now_s)

    def put(self, payload: bytes, now_s: float) -> bytes:
        """Queue a message of 1 to 512 bytes; return bytes to send."""
        self._to_send.append(payload)
        return self._next(now_s)

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Take bytes; return bytes to send."""
        if now_s >= self._came_s + GAP_S:
            self._came = b""
        self._came, self._came_s = self._came + data, now_s
        out = b""
        while self._phase != "off" and (length := self._whole()):
            frame, self._came = self._came[:length], self._came[length:]
            out += self._act(frame, now_s)
        return out

    def tick(self, now_s: float) -> bytes:
        """Let time pass; return bytes to send."""
        if self._due_s is None or now_s < self._due_s:
            return b""
        if self._phase != "running":
            return self._control(STRT if self._phase == "strt" else STACK, now_s=now_s)
        self._patience += 1
        if self._patience > MOST_IN_A_ROW:
            return self._again("the host does not answer", now_s)
        return self._control(REP, number=self._sent, now_s=now_s)

    def _whole(self) -> int:
        """Drop what cannot begin a frame; return the length of the frame in front once all of it is there, or 0."""
        while self._came:
            first = self._came[0]
            if first not in (0x81, 0x05):
                self._came = self._came[1:]
            elif len(self._came) < 8:
                return 0
            elif remainder(self._came[:8]):
                self._came = self._came[1:]
            elif first == 0x05:
                return 8
            else:
                count = struct.unpack_from("<H", self._came, 1)[0] % 0x4000
                return 10 + count if len(self._came) >= 10 + count else 0
        return 0

    def _act(self, frame: bytes, now_s: float) -> bytes:
        kind, subtype, response, number = frame[1:5]
        if self._phase != "running":
            return self._come_together(frame, now_s)
        if frame[0] == 0x81:
            return self._on_acknowledgement(response, now_s) + self._message(number, frame[8:], now_s)
        if kind == STACK:
            return self._control(ACK, response=self._got)
        if kind == REP:
            is_newest = number == self._got
            return self._control(ACK if is_newest else NAK, 0 if is_newest else NOT_COME, response=self._got)
        if kind == ACK:
            return self._on_acknowledgement(response, now_s)
        if kind == NAK:
            out = self._on_acknowledgement(response, now_s)
            self._patience += self._under_way
            if self._patience > MOST_IN_A_ROW:
                return self._again(f"the host refuses (NAK, reason {subtype & 0x3F})", now_s)
            return out or (self._data(now_s) if self._under_way else b"")
        return self._again("the host began anew", now_s) if kind == STRT else b""

    def _come_together(self, frame: bytes, now_s: float) -> bytes:
        kind, is_data = frame[1], frame[0] == 0x81
        if kind == STRT and not is_data:
            self._phase = "stack"
            return self._control(STACK, now_s=now_s)
        answered = self._phase == "stack" and frame[3] == 0 and (is_data or kind == ACK)
        if not answered and (is_data or kind != STACK):
            return b""
        self._phase, self._due_s = "running", None
        self.begun += 1
        out = self._act(frame, now_s) if is_data else b"" if answered else self._control(ACK, response=0)
        return out + self._next(now_s)

    def _message(self, number: int, body: bytes, now_s: float) -> bytes:
        if number != (self._got + 1) % 256:
            old = (self._got - number) % 256 < 128
            return self._control(ACK, response=self._got) if old else b""
        if len(body) > MOST_BYTES + 2:
            return self._control(NAK, TOO_LONG, response=self._got)
        if remainder(body):
            return self._control(NAK, DATA_BAD, response=self._got)
        self._got = number
        self.messages.append(body[:-2])
        return self._control(ACK, response=self._got)

    def _on_acknowledgement(self, response: int, now_s: float) -> bytes:
        if not self._under_way or response != self._sent:
            return b""
        self._under_way, self._due_s, self._patience = False, None, 0
        del self._to_send[0]
        return self._next(now_s)

    def _next(self, now_s: float) -> bytes:
        if not self.running or self._under_way or not self._to_send:
            return b""
        self._under_way, self._sent = True, (self._sent + 1) % 256
        return self._data(now_s)

    def _data(self, now_s: float) -> bytes:
        self._due_s = now_s + self._timer_s
        payload = self._to_send[0]
        count = len(payload) | _FLAGS << 8
        header = struct.pack("<BHBBB", 0x81, count, self._got, self._sent, 1)
        return self._fill + sealed(header) + sealed(payload) + self._fill

    def _control(
        self, kind: int, subtype: int = 0, *, response: int = 0, number: int = 0, now_s: float | None = None
    ) -> bytes:
        """Return a control frame; with the time, one to be sent again when it is not answered."""
        if now_s is not None:
            self._due_s = now_s + self._timer_s
        frame = bytes((0x05, kind, subtype | _FLAGS, response, number, 1))
        return self._fill + sealed(frame) + self._fill

    def _again(self, trouble: str, now_s: float) -> bytes:
        self.troubles.append(trouble)
        return self.start(now_s)
