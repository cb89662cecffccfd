"""The terminal of a VAL II or V+ controller as a machine: text in, events and text out. No port, clock or thread.

Its states and what leads from one to another are a table in ``states``, drawn in docs/state_machines.md.

A command is sent without its end, and sent off only when every character of it has come back right: a line disturbed on
the way there is never carried out. Whatever does not fit ends in ``Trouble``; the machine then has the controller
forget the line and abort, and does nothing more until ``start``.

Text to send is collected in ``outgoing``; whoever owns the line takes it with ``take`` after each call.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from services.robot_link.machine import following
from services.robot_link.val2.dialects import Dialect
from services.robot_link.val2.states import TRANSITIONS, What
from services.robot_link.val2.states import State as State

_BLANK = b"\r\n\x00\x7f"
_LARGEST_LINE, _MOST_LINES = 200, 60
_KNOCK_EVERY_S = 1.0
_NO_COMMAND = "?"


class Greeted(NamedTuple):
    """The controller waits for commands."""

    lines: tuple[str, ...]
    """What it said before, such as its banner."""


class Answer(NamedTuple):
    """A command is done with, as far as the controller's prompt means that."""

    command: str
    lines: tuple[str, ...]
    error: str | None
    """The controller's own line when it refused."""


class Trouble(NamedTuple):
    """The dialogue cannot be trusted any more; an abort has been sent."""

    reason: str


Event = Greeted | Answer | Trouble


@dataclass(frozen=True)
class Timing:
    """How long to wait for what [s]."""

    echo_s: float = 2.0
    """For the echo of a command."""
    reply_s: float = 5.0
    """For the prompt after a command, unless the command has its own."""
    quiet_s: float = 0.1
    """Silence after a lone ``*``, and after the first prompt, that makes it a prompt."""


USUAL = Timing()


class Terminal:
    """One dialogue. Not for several threads."""

    def __init__(self, dialect: Dialect, timing: Timing = USUAL, echo: bool = True) -> None:
        self._dialect, self._timing, self._echo = dialect, timing, echo
        self._prompts = (dialect.idle_prompt, dialect.busy_prompt)
        self.state = State.DOWN
        self.outgoing = bytearray()
        self._give_up_s: float | None = None
        self._quiet_from_s = 0.0
        self._command, self._awaited = "", b""
        self._reply_s = timing.reply_s
        self._lines: list[str] = []
        self._line = bytearray()
        self._fresh = False
        """Whether ``_line`` begins at the start of a line."""

    @property
    def next_deadline_s(self) -> float | None:
        """When ``tick`` has something to do; None when only text can change anything."""
        waiting = self._line and self.state in (State.GREETING, State.REPLY)
        quiet_s = self._quiet_from_s + self._timing.quiet_s if waiting else None
        return min((at for at in (self._give_up_s, quiet_s) if at is not None), default=None)

    def start(self, now_s: float) -> None:
        """Begin afresh: knock until the controller shows a prompt."""
        self._enter(What.STARTED)
        self._fresh = True
        self._knock(now_s)

    def ask(self, command: str, now_s: float, reply_s: float | None = None) -> None:
        """Give a command; its ``Answer`` or ``Trouble`` comes as an event.

        Raises ValueError when not idle, or for a command that is not one line of printable characters.
        """
        if self.state is not State.IDLE:
            raise ValueError(f"terminal: expected to be idle for {command!r}, is {self.state.value}")
        if not (command.isascii() and command.isprintable() and command.strip() == command != ""):
            raise ValueError(f"terminal: expected one line of printable characters, got {command!r}")
        self._command, self._awaited = command, command.encode()
        self._reply_s = self._timing.reply_s if reply_s is None else reply_s
        self._send(command)
        self._enter(What.ASKED)
        self._give_up_s = now_s + self._timing.echo_s
        if not self._echo:
            self._send_off(now_s)

    def receive(self, text: bytes, now_s: float) -> list[Event]:
        """Take what the controller said, in any pieces."""
        events: list[Event] = []
        for value in text:
            if self.state in (State.DOWN, State.FAILED):
                break
            event = self._hear(value, now_s)
            if event is not None:
                events.append(event)
        if text:
            self._quiet_from_s = now_s
            events += self._look_for_prompt(now_s, silent=False)
        return events

    def tick(self, now_s: float) -> list[Event]:
        """Let time pass."""
        events = self._look_for_prompt(now_s, now_s - self._quiet_from_s >= self._timing.quiet_s)
        if not events and self._give_up_s is not None and now_s >= self._give_up_s:
            if self.state is State.GREETING:
                self._knock(now_s)
            else:
                what = "echo" if self.state is State.ECHO else "prompt"
                events.append(self.fail(f"expected the {what} of {self._command!r} in time, got {self._last_text()}"))
        return events

    def take(self) -> bytes:
        """Return the text to send, once."""
        text = bytes(self.outgoing)
        self.outgoing.clear()
        return text

    def fail(self, reason: str) -> Trouble:
        """Give the dialogue up, and tell the controller to forget the line and to abort."""
        self._send(self._dialect.kill_line + self._dialect.abort + self._dialect.end_of_line)
        self._enter(What.FAILED)
        return Trouble(reason)

    # -- what is heard -----------------------------------------------------------------------------------------------

    def _hear(self, value: int, now_s: float) -> Event | None:
        if self.state is State.ECHO:
            return self._hear_echo(value, now_s)
        if value in (0x00, 0x7F):
            return None
        if value in b"\r\n":
            fresh, self._fresh = self._fresh, True
            line, self._line = self._line.decode("ascii", "replace").rstrip(), bytearray()
            return self._end_line(line, fresh) if line else None
        greeting = self.state is State.GREETING
        if not (0x20 <= value < 0x7F or value == 0x09):
            return None if greeting else self.fail(f"expected text after {self._command!r}, got byte {value:02X}")
        if len(self._line) >= _LARGEST_LINE:
            if not greeting:
                return self.fail(f"expected lines of at most {_LARGEST_LINE} characters, got {self._last_text()}")
            self._line.clear()
            self._fresh = False
            return None
        self._line.append(value)
        return None

    def _hear_echo(self, value: int, now_s: float) -> Event | None:
        if value in _BLANK:
            return None
        if value != self._awaited[0]:
            heard = self._command.encode()[: len(self._command) - len(self._awaited)] + bytes([value])
            return self.fail(f"expected the echo of {self._command!r}, got {heard.decode('ascii', 'replace')!r}")
        self._awaited = self._awaited[1:]
        if not self._awaited:
            self._send_off(now_s)
        return None

    def _end_line(self, line: str, fresh: bool) -> Event | None:
        if self.state is State.GREETING:
            self._lines = [*self._lines, line][-_MOST_LINES:]
            return None
        if self.state is State.IDLE:
            if line in self._prompts:  # shown once more
                return None
            return self.fail(f"expected nothing while nothing was asked, got {line!r}")
        if fresh and line.strip() == self._dialect.idle_prompt:  # a line's end came right after it
            return self._answer()
        self._lines.append(line)
        if len(self._lines) > _MOST_LINES:
            return self.fail(f"expected at most {_MOST_LINES} lines after {self._command!r}, got more")
        return None

    def _look_for_prompt(self, now_s: float, silent: bool) -> list[Event]:
        """Look whether what stands at the start of the line now is a prompt, or a question of the start-up."""
        text = self._line.decode("ascii", "replace").strip()
        if not self._fresh or not text or self.state not in (State.GREETING, State.REPLY):
            return []
        greeting = self.state is State.GREETING
        if greeting and self._answer_question(text, now_s):
            return []
        sure = silent or (not greeting and text == self._dialect.idle_prompt)
        if text not in self._prompts or not sure:
            return []
        if not greeting:
            return [self._answer()]
        lines = tuple(self._lines)
        self._enter(What.PROMPTED)
        return [Greeted(lines)]

    def _answer(self) -> Answer:
        lines = tuple(self._lines)
        self._enter(What.PROMPTED)
        error = next((line for line in lines if line.lstrip().startswith(self._dialect.error_begins)), None)
        return Answer(self._command, lines, error)

    def _answer_question(self, text: str, now_s: float) -> bool:
        for begins, answer in self._dialect.questions:
            if text.lower().startswith(begins.lower()) and text.endswith("?"):
                self._line.clear()
                self._send(answer + self._dialect.end_of_line)
                self._give_up_s = now_s + _KNOCK_EVERY_S
                return True
        return False

    # -- what is done ------------------------------------------------------------------------------------------------

    def _knock(self, now_s: float) -> None:
        """Have the controller show its prompt, and not carry out what somebody has typed there without ending it.

        That may be a motion of ours, from before a crash or a pulled plug. A controller that does not know the sign to
        forget the line refuses it for what stands behind it.
        """
        self._send(self._dialect.kill_line + _NO_COMMAND + self._dialect.end_of_line)
        self._give_up_s = now_s + _KNOCK_EVERY_S

    def _send_off(self, now_s: float) -> None:
        self._send(self._dialect.end_of_line)
        self._enter(What.ECHOED)
        self._fresh = not self._echo
        self._give_up_s = now_s + self._reply_s

    def _enter(self, what: What) -> None:
        self.state = following(TRANSITIONS, self.state, what)
        self._give_up_s = None
        self._lines, self._fresh = [], False
        self._line.clear()

    def _send(self, text: str) -> None:
        self.outgoing += text.encode("ascii")

    def _last_text(self) -> str:
        said = [*self._lines, self._line.decode("ascii", "replace")]
        return repr(" / ".join(said)[-80:])
