"""The robot link's dialogue with the emulated controller, in memory and calculated time, over either kind of line."""

from __future__ import annotations

from collections.abc import Generator
from typing import Literal, Protocol, TypeVar

from services.robot_link.channel import Channel, RawChannel
from services.robot_link.ddcmp.supervisory import SupervisoryChannel
from services.robot_link.emulator.arm import IdealArm
from services.robot_link.emulator.controller import Behaviour, Controller
from services.robot_link.emulator.poses import frame
from services.robot_link.emulator.supervisory import SupervisoryController
from services.robot_link.settings import ArmSettings
from services.robot_link.val2.dialects import DIALECTS
from services.robot_link.val2.motion import Arm, Command, Pause
from services.robot_link.val2.terminal import Event, Greeted, Terminal, Trouble
from services.wire.actions import Increment
from services.wire.errors import TreenailError
from services.wire.messages import Home

Mode = Literal["terminal", "supervisory"]
MODES: tuple[Mode, ...] = ("terminal", "supervisory")
_PLACE = (400.0, 0.0, 300.0, 0.0, 180.0, 0.0)
_HOME = Home(run="bench", episode=0, x_mm=0.0, y_mm=0.0, z_mm=-20.0, rx_deg=0.0, ry_deg=0.0, rz_deg=0.0)
_MOST_STEPS = 10_000
"""Of calculated time within one command; an answer takes far fewer."""
T = TypeVar("T")


class _Far(Protocol):
    """The controller's side of a line."""

    @property
    def next_deadline_s(self) -> float | None: ...

    def receive(self, data: bytes, now_s: float, /) -> bytes: ...

    def tick(self, now_s: float) -> bytes: ...


class Dialogue:
    """One arm behind one line that takes no time and does no damage. Not for several threads."""

    def __init__(self, mode: Mode) -> None:
        """Switch both sides on and home the arm. Raises TreenailError."""
        settings = ArmSettings(convention="zyz", confirmed=True, withdraw_mm=0.0, echo=mode == "terminal")
        place = frame(_PLACE, "zyz")
        locations = {settings.start_location: place}
        self.controller = Controller(IdealArm(place), Behaviour(echo=settings.echo), locations)
        self._arm = Arm(settings)
        self._terminal = Terminal(DIALECTS[settings.dialect], echo=settings.echo)
        self._now_s = 0.0
        self._to_far = self._to_near = b""
        self._channel: Channel = RawChannel()
        self._far: _Far = self.controller
        if mode == "supervisory":
            self._channel = SupervisoryChannel()
            self._far = far = SupervisoryController(self.controller)
            self._to_near = far.start(self._now_s)
        self._begin()

    def move(self, increment: Increment, step: int) -> Increment:
        """Make one increment [mm, deg]; return what was applied. Raises TreenailError."""
        return self._carry_out(self._arm.move(increment, 0, step))

    def _begin(self) -> None:
        self._to_far += self._channel.start(self._now_s)
        for _ in range(_MOST_STEPS):
            if self._channel.up:
                break
            self._pass_on()
        self._terminal.start(self._now_s)
        event = self._event()
        if not isinstance(event, Greeted):
            raise TreenailError(f"dialogue: expected a greeting, got {event}")
        self._carry_out(self._arm.get_ready())
        self._carry_out(self._arm.home(_HOME))

    def _carry_out(self, script: Generator[Command | Pause, tuple[str, ...], T]) -> T:
        try:
            step = next(script)
            while True:
                if isinstance(step, Pause):
                    self._now_s += step.seconds
                    step = script.send(())
                    continue
                self._terminal.ask(step.text, self._now_s, step.reply_s)
                event = self._event()
                if isinstance(event, Greeted | Trouble) or (event.error is not None and not step.may_fail):
                    raise TreenailError(f"dialogue: expected an answer to {step.text!r}, got {event}")
                step = script.send(event.lines)
        except StopIteration as end:
            done: T = end.value
            return done

    def _event(self) -> Event:
        """Let bytes and time pass until the terminal has something to say."""
        for _ in range(_MOST_STEPS):
            events = self._pass_on()
            if events:
                return events[0]
            if self._channel.failure is not None:
                raise TreenailError(f"dialogue: {self._channel.failure}")
        raise TreenailError("dialogue: expected an answer of the terminal, got none")

    def _pass_on(self) -> list[Event]:
        """Carry all bytes over once, or, when there are none, let time pass until something is due."""
        text = self._terminal.take()
        if text:
            self._to_far += self._channel.send(text, self._now_s)
        if not (self._to_far or self._to_near):
            self._wait()
        to_far, self._to_far = self._to_far, b""
        if to_far:
            self._to_near += self._far.receive(to_far, self._now_s)
        self._to_near += self._far.tick(self._now_s)
        to_near, self._to_near = self._to_near, b""
        received = self._channel.receive(to_near, self._now_s)
        self._to_far += received.reply + self._channel.tick(self._now_s)
        return self._terminal.receive(received.text, self._now_s) + self._terminal.tick(self._now_s)

    def _wait(self) -> None:
        ends = (self._terminal, self._channel, self._far)
        due_s = [end.next_deadline_s for end in ends if end.next_deadline_s is not None]
        if due_s:
            self._now_s = max(self._now_s, min(due_s))
