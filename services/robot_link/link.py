"""The line in use: carries scripts out over port, channel and terminal, and brings a lost line back. Nothing blocks.

A line that says nothing when something is due is given up and opened again: a connection whose other end is gone
without a word swallows everything that is said to it, for ever. Opening takes place on a thread of its own.

Whoever owns a ``Link`` calls ``pump`` again and again. After a fault everything begins afresh: port, channel, greeting,
the script that gets the arm ready. What was under way then has failed, and where the arm is nobody knows.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Generator
from typing import Protocol

from services.bus.opening import Opening
from services.robot_link.channel import Channel
from services.robot_link.errors import ControllerError, LinkError
from services.robot_link.serial_line import LineError
from services.robot_link.val2.motion import Command, Pause, Script
from services.robot_link.val2.terminal import Answer, Event, Greeted, State, Terminal, Trouble
from services.rules.motions import ArmError, BusyError
from services.wire.actions import Increment

RETRY_S = (0.05, 2.0)
"""Shortest and longest pause before a line is opened again; each is twice the one before."""
SILENT_S = 10.0
"""How long a controller that is spoken to may say nothing before its line is opened again."""
_AnyScript = Generator[Command | Pause, tuple[str, ...], Increment | None]


class Port(Protocol):
    """A line of bytes; ``services.robot_link.serial_line.Line`` is one. All raise LineError."""

    def open(self) -> None:
        """Open it, also again; called on a thread of its own, while nothing else is."""

    def read(self, timeout_s: float = 0.0) -> bytes:
        """Return what has come, after waiting so long for it."""

    def write(self, data: bytes) -> None:
        """Send all bytes."""

    def close(self) -> None:
        """Give it back."""


class Link:
    """One controller, one motion at a time."""

    def __init__(
        self,
        port: Port,
        channel: Channel,
        terminal: Terminal,
        get_ready: Callable[[], Generator[Command | Pause, tuple[str, ...], None]],
        lost: Callable[[ArmError], None],
    ) -> None:
        """``get_ready`` makes the script that must succeed before anything else; ``lost`` hears of each fault."""
        self._port, self._channel, self._terminal = port, channel, terminal
        self._get_ready, self._lost = get_ready, lost
        self._open = self._greeting = False
        self._opening: Opening[None] | None = None
        self._heard_s = 0.0
        self._retry_at_s, self._retry_s = 0.0, RETRY_S[0]
        self._script: _AnyScript | None = None
        self._then: Callable[[Increment | ArmError], None] | None = None
        self._command: Command | None = None
        self._resume_s: float | None = None
        self._ready = False
        self.trouble = "robot_link: not connected yet"
        """Why it is not ready, or what went wrong last."""

    @property
    def ready(self) -> bool:
        """Whether a script can be run, now or after the one under way."""
        return self._ready

    @property
    def busy(self) -> bool:
        """Whether a script is under way."""
        return self._script is not None

    def run(self, script: Script, then: Callable[[Increment | ArmError], None]) -> None:
        """Carry a script out and call ``then`` with its result, later, once.

        Raises LinkError when there is no link, and BusyError while another script is under way.
        """
        if not self._ready:
            raise LinkError(self.trouble)
        if self.busy:
            raise BusyError("robot: expected to be asked for one motion at a time, another one is under way")
        self._begin(script, then)

    def give_up(self, error: ArmError) -> None:
        """Have the controller stop, and end the script under way with an error."""
        if self.busy:
            self._end(error)

    def pump(self, timeout_s: float) -> None:
        """Do what is to be done, waiting at most so long [s] for the controller to say something."""
        now = time.monotonic()
        try:
            if not self._open:
                if now < self._retry_at_s:
                    time.sleep(min(timeout_s, self._retry_at_s - now))
                    return
                if not self._open_port():
                    time.sleep(timeout_s)
                    return
                self._connect(now)
            self._listen(timeout_s)
        except LineError as error:
            self._open = False  # it is closed where it is opened again: that may take long, too
            self._retry_at_s = time.monotonic() + self._retry_s
            self._retry_s = min(RETRY_S[1], 2.0 * self._retry_s)
            self._fault(LinkError(f"robot: {error}"))

    def close(self) -> None:
        """Have the controller stop what may be moving, and give the line back."""
        if self._open and self.busy:
            self._terminal.fail("stopping")
            with contextlib.suppress(LineError):  # then it cannot be told any more
                self._flush(time.monotonic())
        self._open = False
        if self._opening is not None:
            self._opening.abandon()
        else:
            self._port.close()

    # -- details -----------------------------------------------------------------------------------------------------

    def _open_port(self) -> bool:
        """Return whether the port is open now, asking for it first. Raises LineError."""
        if self._opening is None:
            self._opening = Opening(self._port.open, lambda _: self._port.close())
        if not self._opening.done:
            return False
        opening, self._opening = self._opening, None
        opening.result()
        return True

    def _connect(self, now: float) -> None:
        self._open = True
        self._heard_s = now
        self._greeting = False
        self._port.write(self._channel.start(now))

    def _listen(self, timeout_s: float) -> None:
        self._flush(time.monotonic())
        data = self._port.read(timeout_s)
        now = time.monotonic()
        if data:
            self._heard_s = now
        elif not self._ready and now - self._heard_s > SILENT_S:
            raise LineError(f"line: expected the controller to say something within {SILENT_S:g} s, got nothing")
        heard = self._channel.receive(data, now) if data else None
        if heard is not None and heard.reply:
            self._port.write(heard.reply)
        more = self._channel.tick(now)
        if more:
            self._port.write(more)
        if self._channel.failure is not None:
            raise LineError(self._channel.failure)
        events = self._terminal.receive(heard.text, now) if heard is not None and self._greeting else []
        events += self._terminal.tick(now)
        self._take_in(events, now)
        if self._resume_s is not None and now >= self._resume_s:
            self._resume_s = None
            self._go_on(())
        self._flush(now)
        anew = not self._greeting or (self._terminal.state is State.FAILED and now >= self._retry_at_s)
        if anew and self._channel.up:  # before, what is said would come in one heap later
            self._greeting = True
            self._terminal.start(now)
            self._flush(now)

    def _take_in(self, events: list[Event], now: float) -> None:
        # A trouble first: an answer that more came behind in one piece is not to be trusted, and nothing can follow it.
        for event in sorted(events, key=lambda event: not isinstance(event, Trouble)):
            if isinstance(event, Trouble):
                self._flush(now)
                self._fault(LinkError(f"robot: {event.reason}; told to abort"))
                return
            if isinstance(event, Greeted):
                self._begin(self._get_ready(), self._got_ready)
            else:
                self._on_answer(event)

    def _flush(self, now: float) -> None:
        text = self._terminal.take()
        if text:
            self._port.write(self._channel.send(text, now))

    def _begin(self, script: _AnyScript, then: Callable[[Increment | ArmError], None]) -> None:
        self._script, self._then = script, then
        self._go_on(None)

    def _on_answer(self, answer: Answer) -> None:
        command, self._command = self._command, None
        if self._script is None or command is None:
            return
        if answer.error is not None and not command.may_fail:
            self._end(ControllerError(f"robot: {answer.command}: refused by the controller: {answer.error[:100]}"))
            return
        self._go_on(answer.lines)

    def _go_on(self, lines: tuple[str, ...] | None) -> None:
        if self._script is None:
            return
        now = time.monotonic()
        try:
            step = next(self._script) if lines is None else self._script.send(lines)
        except StopIteration as end:
            self._end(end.value)
            return
        except LinkError as error:
            self._end(error)
            return
        if isinstance(step, Pause):
            self._resume_s = now + step.seconds
            return
        self._command = step
        self._terminal.ask(step.text, now, step.reply_s)

    def _end(self, result: Increment | ArmError | None) -> None:
        then, self._then = self._then, None
        self._script, self._command, self._resume_s = None, None, None
        if isinstance(result, ArmError):
            # The arm may be moving, or be somewhere on its way.
            if self._terminal.state is not State.FAILED:
                self._terminal.fail("motion given up")
            self._fault(result)
        if then is not None and result is not None:
            then(result)
        elif then is not None:
            then(Increment())

    def _fault(self, error: ArmError) -> None:
        """Note that nothing is sure any more; what was under way has failed."""
        self.trouble = str(error)
        self._ready = False
        if self._terminal.state is State.FAILED:
            self._retry_at_s = time.monotonic() + self._retry_s
            self._retry_s = min(RETRY_S[1], 2.0 * self._retry_s)
        then, self._then = self._then, None
        self._script, self._command, self._resume_s = None, None, None
        self._lost(error)
        if then is not None:
            then(error)

    def _got_ready(self, result: Increment | ArmError) -> None:
        self._ready = not isinstance(result, ArmError)
        if self._ready:
            self.trouble, self._retry_s = "", RETRY_S[0]
