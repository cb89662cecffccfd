"""Driver and emulated controller joined without a line: for tests of the dialogue."""

from __future__ import annotations

from collections.abc import Callable, Generator

from services.robot_link.emulator.controller import Controller
from services.robot_link.errors import ControllerError, LinkError
from services.robot_link.val2.motion import Command, Pause
from services.robot_link.val2.terminal import Answer, Event, State, Terminal, Trouble
from services.wire.actions import Increment

Steps = Generator[Command | Pause, tuple[str, ...], Increment | None]
_PASSES_S = 0.02


class Joined:
    """A terminal and a controller that hear each other at once; ``now_s`` goes on by itself. Deterministic."""

    def __init__(self, controller: Controller, terminal: Terminal, noise: Callable[[bytes], bytes] = bytes) -> None:
        """``noise`` changes what comes from the controller on its way."""
        self.controller, self.terminal, self._noise = controller, terminal, noise
        self.now_s = 0.0

    def greet(self) -> None:
        """Begin the dialogue. Raises LinkError."""
        self.terminal.start(self.now_s)
        self._until_event()

    def run(self, script: Steps) -> Increment | None:
        """Carry a script out and return its result. Raises LinkError, its own or for a trouble of the dialogue."""
        try:
            step = next(script)
            while True:
                step = script.send(self._do(step))
        except StopIteration as end:
            result: Increment | None = end.value
            return result

    def _do(self, step: Command | Pause) -> tuple[str, ...]:
        if isinstance(step, Pause):
            self.now_s += step.seconds
            self._exchange()
            return ()
        self.terminal.ask(step.text, self.now_s, step.reply_s)
        answer = self._until_event()
        if not isinstance(answer, Answer):
            raise LinkError(f"expected an answer to {step.text!r}, got {answer}")
        if answer.error is not None and not step.may_fail:
            raise ControllerError(answer.error)
        return answer.lines

    def _until_event(self) -> Event:
        while True:
            events = self._exchange() or self.terminal.tick(self.now_s)
            for event in events:
                if isinstance(event, Trouble):
                    self._exchange()  # the abort
                    raise LinkError(event.reason)
                return event
            self.now_s += _PASSES_S

    def _exchange(self) -> list[Event]:
        """Carry text to and fro until nobody has anything to say."""
        events: list[Event] = []
        while True:
            said = self.terminal.take()
            shown = self.controller.receive(said, self.now_s) + self.controller.tick(self.now_s)
            if not (said or shown):
                return events
            if self.terminal.state is not State.DOWN:
                events += self.terminal.receive(self._noise(shown), self.now_s)
