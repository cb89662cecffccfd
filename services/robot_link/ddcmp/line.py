"""DDCMP, one end of a point-to-point line: bytes and time in, bytes and events out. No port, clock or thread. Pure.

Its states and what leads from one to another are a table in ``events``, drawn in docs/state_machines.md. In STARTING it
sends STRT, in ANSWERED STACK. Any failure leads back to HALTED and says why. Times are seconds of any clock that does
not go back. What is said here of timers and limits is V+'s; VAL II's own are not known.
"""

from __future__ import annotations

from collections import deque

from services.robot_link.ddcmp.events import TRANSITIONS, Counts, Event, Halted, Outcome, Refused, Started, State, What
from services.robot_link.ddcmp.frames import (
    QUICK_SYNC_AND_SELECT,
    Ack,
    Data,
    Decoder,
    Fault,
    Maintenance,
    Nak,
    Reason,
    Received,
    Rep,
    Sendable,
    Stack,
    Strt,
    encode,
)
from services.robot_link.ddcmp.settings import MODULUS, DdcmpError, DdcmpSettings
from services.robot_link.machine import following

_HALF = MODULUS // 2


class Ddcmp:
    """One end of a line. Not for several threads."""

    def __init__(self, settings: DdcmpSettings | None = None) -> None:
        """Take the settings, the usual ones if none are given; the end is halted until ``start``."""
        self._settings = settings or DdcmpSettings()
        self._flags = QUICK_SYNC_AND_SELECT if self._settings.flags_on_all else 0
        self._reset(0.0)

    def _reset(self, now_s: float) -> None:
        self.state = State.HALTED
        self.failure: str | None = None
        """Why the line is halted, in one line; None before the first failure."""
        self.counts = Counts()
        self._decoder = Decoder(self._settings.max_message)
        self._inbox: deque[bytes] = deque()
        self._waiting: deque[bytes] = deque()
        self._unacknowledged: deque[bytes] = deque()
        self._acknowledged = self._received = 0
        self._passed = self._tried = 0  # of what is not acknowledged: sent in this go, and sent at all
        self._timeouts = self._naks = 0
        self._ack_due = False
        self._naked: int | None = None
        self._naked_s = self._byte_came_s = self._line_free_s = now_s
        self._timer_s: float | None = None
        self._out = bytearray()
        self._events: list[Event] = []

    @property
    def outstanding(self) -> int:
        """Number of messages that the peer has not acknowledged yet, those not yet sent included."""
        return len(self._unacknowledged) + len(self._waiting)

    @property
    def next_deadline_s(self) -> float | None:
        """When ``tick`` must be called at the latest; None when only bytes can change anything."""
        if self.state is State.HALTED:
            return None
        gap_s = self._byte_came_s + self._settings.gap_s if self._decoder.busy else None
        free_s = self._line_free_s if self._passed < len(self._unacknowledged) else None
        return min((time_s for time_s in (self._timer_s, gap_s, free_s) if time_s is not None), default=None)

    def start(self, now_s: float) -> bytes:
        """Begin afresh, forgetting all messages; return bytes to send."""
        self._reset(now_s)
        if self._settings.listen_s:
            self._enter(What.STARTED_LISTENING)
            self._timer_s = now_s + self._settings.listen_s
        else:
            self._begin(What.STARTED, now_s)
        return self._flush()

    def send(self, payload: bytes, now_s: float) -> bytes:
        """Take a message of 1 to ``max_message`` bytes; return bytes to send. Raises DdcmpError, also when not running.

        It is kept and sent again as often as needed until the peer has it. With ``byte_s`` it leaves when those before
        it have left, so that a NAK can still change what goes next.
        """
        if self.state is not State.RUNNING:
            raise DdcmpError(f"DDCMP: send: expected a running line, got one that is {self.state.value}")
        if not 1 <= len(payload) <= self._settings.max_message:
            raise DdcmpError(f"DDCMP: send: expected 1 to {self._settings.max_message} bytes, got {len(payload)}")
        self._waiting.append(payload)
        self._send_data(now_s)
        return self._flush()

    def receive(self, data: bytes, now_s: float) -> Outcome:
        """Take bytes from the line, in any pieces; messages in them wait for ``read``."""
        if self.state is State.HALTED:
            return Outcome()
        self._give_up_stale(now_s)
        self._byte_came_s = now_s
        self._take(self._decoder.feed(data), now_s)
        return self._outcome()

    def read(self) -> bytes | None:
        """Return the next message, or None; each comes once and in the order in which they were sent."""
        return self._inbox.popleft() if self._inbox else None

    def tick(self, now_s: float) -> Outcome:
        """Let time pass."""
        if self.state is State.HALTED:
            return Outcome()
        self._give_up_stale(now_s)
        self._send_data(now_s)
        if self._timer_s is not None and now_s >= self._timer_s:
            self._time_out(now_s)
        return self._outcome()

    # --- time

    def _give_up_stale(self, now_s: float) -> None:
        if self._decoder.busy and now_s >= self._byte_came_s + self._settings.gap_s:
            self._take(self._decoder.give_up(), now_s)

    def _time_out(self, now_s: float) -> None:
        if self.state in (State.LISTENING, State.STARTING):
            self._begin(What.TIMED_OUT, now_s)
        elif self.state is State.ANSWERED:
            self._answer(What.TIMED_OUT, now_s)
        elif self._line_free_s > now_s:  # what we wait for an answer to has not left yet
            self._timer_s = self._line_free_s + self._settings.reply_timer_s
        else:
            self._timeouts += 1
            self.counts.timeouts += 1
            if self._timeouts > self._settings.most_timeouts:
                self._halt(f"{self._timeouts} time-outs in a row, the peer does not answer")
                return
            self._put(Rep((self._acknowledged + self._tried) % MODULUS), now_s)
            self._set_timer(self._settings.reply_timer_s)

    def _enter(self, what: What) -> None:
        self.state = following(TRANSITIONS, self.state, what)

    def _begin(self, what: What, now_s: float) -> None:
        self._enter(what)
        self._put(Strt(), now_s)
        self._set_timer(self._settings.start_timer_s)

    def _answer(self, what: What, now_s: float) -> None:
        self._enter(what)
        self._put(Stack(), now_s)
        self._set_timer(self._settings.start_timer_s)

    def _set_timer(self, seconds: float) -> None:
        self._timer_s = self._line_free_s + seconds

    # --- what comes

    def _take(self, received: list[Received], now_s: float) -> None:
        for frame in received:
            if isinstance(frame, Fault):
                self.counts.faults += 1
            if isinstance(frame, Maintenance):
                self._events.append(Refused("DDCMP: expected data or control frames, got a maintenance frame"))
            elif self.state is State.RUNNING:
                self._running(frame, now_s)
            elif self.state is not State.HALTED:
                self._starting(frame, now_s)
        self._send_data(now_s)
        if self._ack_due:
            self._put(Ack(self._received), now_s)

    def _starting(self, frame: Received, now_s: float) -> None:
        if isinstance(frame, Strt):
            self._answer(What.STRT, now_s)
        elif isinstance(frame, Stack) and self.state is not State.LISTENING:
            self._run(What.STACK)
            self._ack_due = True
        elif isinstance(frame, Ack | Data) and self.state is State.ANSWERED and frame.response == 0:
            self._run(What.AT_ZERO)
            self._running(frame, now_s)

    def _run(self, what: What) -> None:
        self._enter(what)
        self._timer_s = None
        self._events.append(Started())

    def _running(self, frame: Received, now_s: float) -> None:
        if isinstance(frame, Data):
            self._acknowledge(frame.response, now_s)
            self._data(frame, now_s)
        elif isinstance(frame, Ack):
            self._acknowledge(frame.response, now_s)
        elif isinstance(frame, Nak):
            self._nak_came(frame, now_s)
        elif isinstance(frame, Rep):
            if frame.number == self._received:
                self._ack_due = True
            else:
                self._refuse(Reason.REPLY, now_s)
        elif isinstance(frame, Stack):  # our ACK of it was lost
            self._ack_due = True
        elif isinstance(frame, Strt):
            self._halt("the peer began anew (STRT while running)", restarted=True)
        elif isinstance(frame, Fault):
            if frame.response is not None:
                self._acknowledge(frame.response, now_s)
            self._refuse(frame.reason, now_s)

    def _data(self, frame: Data, now_s: float) -> None:
        ahead = (frame.number - self._received) % MODULUS
        if ahead == 1 and len(self._inbox) < self._settings.buffers:
            self._received = frame.number
            self._naked = None
            self._ack_due = True
            self.counts.received += 1
            self._inbox.append(frame.payload)
        elif ahead == 1:
            self._refuse(Reason.NO_BUFFER, now_s)
        elif ahead == 0 or ahead > _HALF:
            self._ack_due = True
            self.counts.duplicates += 1
        else:
            self.counts.out_of_sequence += 1

    def _acknowledge(self, response: int, now_s: float) -> bool:
        """Take what the peer says it has; return whether it can be true. An old frame says what cannot."""
        count = (response - self._acknowledged) % MODULUS
        if count > self._tried:
            return False
        for _ in range(count):
            self._unacknowledged.popleft()
        self._acknowledged = response
        self._passed, self._tried = max(0, self._passed - count), self._tried - count
        if count:
            self._timeouts = self._naks = 0
            self._timer_s = None
            if self._tried:
                self._line_free_s = max(self._line_free_s, now_s)
                self._set_timer(self._settings.reply_timer_s)
        return True

    def _nak_came(self, nak: Nak, now_s: float) -> None:
        self.counts.naks_received += 1
        if not self._acknowledge(nak.response, now_s) or not self._tried:
            return
        self._timeouts = 0
        self._naks += 1
        if self._naks > self._settings.most_naks:
            self._halt(f"{self._naks} NAKs in a row, the last with reason {_words(nak.reason)}")
        elif nak.reason != Reason.NO_BUFFER:  # that peer needs time; the reply timer gives it
            self._passed = 0
            self._timer_s = None

    # --- what goes

    def _send_data(self, now_s: float) -> None:
        """Send, as far as window and line have room, what has not been sent, or must be sent again."""
        if self.state is not State.RUNNING:
            return
        while self._waiting and len(self._unacknowledged) < self._settings.window:
            self._unacknowledged.append(self._waiting.popleft())
        while self._passed < len(self._unacknowledged) and self._line_free_s <= now_s:
            payload = self._unacknowledged[self._passed]
            self._passed += 1
            self._put(Data((self._acknowledged + self._passed) % MODULUS, self._received, payload), now_s)
            again = self._passed <= self._tried
            self.counts.sent_again += again
            self.counts.sent += not again
            self._tried = max(self._tried, self._passed)
            if self._timer_s is None:
                self._set_timer(self._settings.reply_timer_s)

    def _refuse(self, reason: Reason, now_s: float) -> None:
        """Send a NAK, unless one for the same message is under way; a REP is answered always."""
        under_way = self._naked == self._received and now_s < self._naked_s + self._settings.nak_pause_s
        if under_way and reason is not Reason.REPLY:
            return
        self._naked, self._naked_s = self._received, now_s
        self.counts.naks_sent += 1
        self._put(Nak(reason, self._received), now_s)

    def _put(self, frame: Sendable, now_s: float) -> None:
        fill = self._settings.fill
        data = fill + encode(frame, self._flags) + fill
        self._out += data
        self._line_free_s = max(self._line_free_s, now_s) + len(data) * self._settings.byte_s
        if isinstance(frame, Data | Ack | Nak):
            self._ack_due = False

    def _halt(self, why: str, *, restarted: bool = False) -> None:
        lost = f"; {self.outstanding} messages may be lost" if self.outstanding else ""
        self._enter(What.FAILED)
        self._timer_s = None
        self._ack_due = False
        self.failure = f"DDCMP: {why}{lost}"
        self._events.append(Halted(self.failure, restarted))

    def _flush(self) -> bytes:
        data = bytes(self._out)
        self._out.clear()
        return data

    def _outcome(self) -> Outcome:
        events = tuple(self._events)
        self._events.clear()
        return Outcome(self._flush(), events)


def _words(reason: int) -> str:
    named = reason in Reason.__members__.values()
    return f"{reason} ({Reason(reason).name.lower().replace('_', ' ')})" if named else str(reason)
