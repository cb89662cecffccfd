"""The supervisor line: the dialogue's text over DDCMP, in place of a plain serial line. Pure.

The controller reads its terminal's logical unit; each text that the dialogue sends answers one such read, and waits
for it if need be. What the controller writes to that unit is the text that comes back. See ``logical_units`` for how
little of this is known. Nothing here has ever run on hardware.
"""

from __future__ import annotations

import argparse
from collections import deque
from dataclasses import dataclass, field

from services.robot_link.channel import Received
from services.robot_link.ddcmp.events import State
from services.robot_link.ddcmp.line import Ddcmp
from services.robot_link.ddcmp.logical_units import Kind, LogicalUnits, prefix_of
from services.robot_link.ddcmp.settings import DdcmpError, DdcmpSettings
from services.rules.settings import add_settings
from services.rules.settings import settings_of as from_options

HOST = DdcmpSettings(listen_s=7.0, window=8, buffers=255)
"""The host listens for two of the controller's STRTs before it sends its own, to which VAL II's reaction is unknown. It
keeps fewer messages under way than V+ has buffers, and itself has buffers for all that the controller may send."""


@dataclass(frozen=True)
class SupervisorySettings:
    """How the line behaves and which prefixes its messages have."""

    line: DdcmpSettings = HOST
    units: LogicalUnits = field(default_factory=LogicalUnits)


class SupervisoryChannel:
    """A ``Channel`` over DDCMP. Not for several threads."""

    def __init__(self, settings: SupervisorySettings | None = None) -> None:
        """Take the settings, the usual ones if none are given."""
        settings = settings or SupervisorySettings()
        self._units = settings.units
        self._line = Ddcmp(settings.line)
        self._longest = settings.line.max_message - len(self._units.answer)
        self._forget()

    def _forget(self) -> None:
        self._texts: deque[bytes] = deque()
        self._reads = 0
        self._was_asked = False
        self._misunderstood: str | None = None

    @property
    def up(self) -> bool:
        """Whether the link runs and the controller has asked for text, so that its supervisor switch is on."""
        return self._line.state is State.RUNNING and self._was_asked and self.failure is None

    @property
    def failure(self) -> str | None:
        """Why nothing can pass any more until ``start``; None as long as all is well."""
        return self._misunderstood or self._line.failure

    @property
    def next_deadline_s(self) -> float | None:
        """When ``tick`` must be called at the latest."""
        return None if self._misunderstood else self._line.next_deadline_s

    def start(self, now_s: float) -> bytes:
        """Begin afresh, with no text waiting; return bytes to send, often none before the controller has begun."""
        self._forget()
        return self._line.start(now_s)

    def send(self, text: bytes, now_s: float) -> bytes:
        """Take text, the answer to one read; return bytes to send now. Raises DdcmpError when it fits no message."""
        if not 1 <= len(text) <= self._longest:
            raise DdcmpError(f"supervisor line: expected text of 1 to {self._longest} bytes, got {len(text)}")
        self._texts.append(text)
        return self._answer(now_s)

    def receive(self, data: bytes, now_s: float) -> Received:
        """Take bytes; return the controller's text in them, and bytes to send."""
        if self.failure is not None:
            return Received()
        reply = self._line.receive(data, now_s).reply
        said = b""
        while (message := self._line.read()) is not None:
            try:
                kind, text = self._units.parse(message)
            except DdcmpError as error:
                self._misunderstood = str(error)
                break
            said += text
            if kind is Kind.READ:
                self._reads += 1
                self._was_asked = True
        return Received(said, reply + self._answer(now_s))

    def tick(self, now_s: float) -> bytes:
        """Let time pass; return bytes to send."""
        return b"" if self._misunderstood else self._line.tick(now_s).reply

    def _answer(self, now_s: float) -> bytes:
        """Answer the reads there are with the texts there are."""
        sent = b""
        while self._reads and self._texts and self._line.state is State.RUNNING and self.failure is None:
            self._reads -= 1
            sent += self._line.send(self._units.message_of(self._texts.popleft()), now_s)
        return sent


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of the supervisor line; ``settings_of`` reads them."""
    group = parser.add_argument_group("supervisor line", "V+'s values where VAL II's own are not known")
    units = LogicalUnits()
    for name, prefix, text in (
        ("read", units.read, "message in which the controller asks for text"),
        ("answer", units.answer, "bytes before our text"),
        ("write", units.write, "bytes before the controller's text"),
    ):
        shown = prefix.hex(" ")
        group.add_argument(f"--lun-{name}", default=shown, metavar="HEX", help=f"{text} (default: {shown})")
    add_settings(group, HOST)


def settings_of(arguments: argparse.Namespace, baud: int | None = None) -> SupervisorySettings:
    """Return the settings in parsed options; timers allow for ``baud`` (bits per second, ten a byte) if it is given.

    Raises DdcmpError for values out of range.
    """
    byte_s = 10 / baud if baud else 0.0
    line = from_options(HOST, arguments, start_timer_s=arguments.reply_timer_s, byte_s=byte_s)
    prefixes = (prefix_of(text) for text in (arguments.lun_read, arguments.lun_answer, arguments.lun_write))
    return SupervisorySettings(line, LogicalUnits(*prefixes))
