"""The other end of ``services.robot_ur.hands``: a connection that can be let go of at any time."""

from __future__ import annotations

import itertools
import socket
import subprocess
import threading
import time
from collections import deque

import msgspec

from services.robot_ur.errors import LostError
from services.robot_ur.hands import LARGEST, Answer, Call, Gone, Hello, Refused, Said, Seen
from services.robot_ur.settings import Settings
from services.robot_ur.states import State
from services.rules.command_line import module_command
from services.rules.motions import ArmError
from services.rules.poses import Pose

CONNECT_S = 15.0
"""How long a connection may take."""
_CALL_S = 10.0
_KEPT = 256
"""Packets that may wait to be taken."""


class DistantClient:
    """See services.robot_ur.client.Client."""

    def __init__(self, settings: Settings) -> None:
        """Connect; blocks. Raises ArmError."""
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._socket = ours
        words = [
            str(theirs.fileno()),
            settings.robot,
            str(settings.rate_hz),
            str(int(settings.wrist == "raw")),
            str(settings.watchdog_s),
            str(int(settings.any_firmware)),
        ]
        command = module_command("services.robot_ur.hands", *words)
        with theirs:
            self._process = subprocess.Popen(command, stdin=subprocess.DEVNULL, pass_fds=(theirs.fileno(),))
        self._states: deque[State] = deque(maxlen=_KEPT)
        self._answers: dict[int, Answer] = {}
        self._numbers = itertools.count()
        self._came = threading.Condition()
        self._hello: Hello | Refused | None = None
        self._gone = False
        threading.Thread(target=self._hear, name="hands", daemon=True).start()
        with self._came:
            self._came.wait_for(lambda: self._hello is not None or self._gone, CONNECT_S)
            hello = self._hello
        if isinstance(hello, Hello):
            self.what = hello.what
            return
        self.close()
        if hello is not None:
            raise ArmError(hello.why)
        raise LostError(
            f"robot: expected a connection to {settings.robot} within {CONNECT_S:g} s, got none; see the log"
        )

    @property
    def connected(self) -> bool:
        """See Client."""
        return not self._gone

    def state(self) -> State | None:
        """See Client."""
        return self._states.popleft() if self._states else None

    def take_control(self) -> None:
        """See Client."""
        self._call("take_control")

    def check(self) -> None:
        """See Client."""
        self._call("check")

    def move(self, goal: Pose, speed_mm_s: float, acceleration_mm_s2: float) -> None:
        """See Client."""
        self._call("move", speed_mm_s, acceleration_mm_s2, goal=goal)

    def stop(self) -> None:
        """See Client."""
        self._call("stop")

    def zero(self) -> None:
        """See Client."""
        self._call("zero")

    def tool(self) -> list[float]:
        """See Client."""
        return list(self._call("tool"))

    def tell(self, episode: int, step: int) -> None:
        """See Client."""
        self._call("tell", episode, step)

    def unlock(self) -> None:
        """See Client."""
        self._call("unlock")

    def power_up(self, release: bool) -> None:
        """See Client."""
        self._call("power_up", release)

    def close(self) -> None:
        """End the connection, whatever it is doing. Does not block for long."""
        self._process.kill()
        self._process.wait()
        self._socket.close()

    # -- details -----------------------------------------------------------------------------------------------------

    def _call(self, name: str, *numbers: float, goal: Pose | None = None) -> tuple[float, ...]:
        """Have something done and return what it gives; blocks. Raises ArmError."""
        number = next(self._numbers)
        try:
            self._socket.send(msgspec.msgpack.encode(Call(number, name, goal, tuple(map(float, numbers)))))
        except OSError:
            raise LostError(f"robot: {name}: the connection has ended") from None
        deadline = time.monotonic() + _CALL_S
        with self._came:
            self._came.wait_for(lambda: number in self._answers or self._gone, deadline - time.monotonic())
            answer = self._answers.pop(number, None)
        if answer is None:
            raise LostError(f"robot: {name}: expected an answer of the controller, got none")
        if answer.error:
            raise ArmError(answer.error)
        return answer.numbers

    def _hear(self) -> None:
        """Take what is said, on a thread."""
        decoder: msgspec.msgpack.Decoder[Said] = msgspec.msgpack.Decoder(Said)
        while True:
            try:
                data = self._socket.recv(LARGEST)
            except OSError:
                data = b""
            said = decoder.decode(data) if data else Gone()
            with self._came:
                match said:
                    case Seen(state):
                        self._states.append(state)
                        continue
                    case Answer():
                        self._answers[said.number] = said
                    case Hello() | Refused():
                        self._hello = said
                    case Gone():
                        self._gone = True
                self._came.notify_all()
            if not data:
                return
