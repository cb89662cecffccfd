"""The process that holds ur_rtde: one connection to one controller, from its beginning to its end.

When the connection is lost the process is killed, and with it whatever ur_rtde would do about that: nothing is sent to
a controller that nobody has asked for. It ends by itself when nobody is at the other end of its socket any more.

    python -m services.robot_ur.hands FD ADDRESS RATE_HZ RAW WATCHDOG_S ANY_FIRMWARE
"""

from __future__ import annotations

import os
import socket
import sys
import threading
import time
from typing import TypeAlias

import msgspec
from msgspec import Struct

from services.robot_ur.client import RtdeClient
from services.robot_ur.states import State
from services.rules.motions import ArmError
from services.rules.poses import Pose

LARGEST = 1 << 16
_LOOKS = 3
"""Looks for a packet in the time between two."""


class Hello(Struct, frozen=True, tag=True):
    """The connection is made, to this."""

    what: str


class Refused(Struct, frozen=True, tag=True):
    """It is not."""

    why: str


class Seen(Struct, frozen=True, tag=True):
    """A packet of the controller."""

    state: State


class Gone(Struct, frozen=True, tag=True):
    """No packets can come any more."""


class Answer(Struct, frozen=True, tag=True):
    """What came of a call."""

    number: int
    numbers: tuple[float, ...] = ()
    error: str = ""
    """Empty for none."""


class Call(Struct, frozen=True):
    """What to do, with arguments as far as it has any."""

    number: int
    name: str
    goal: Pose | None = None
    numbers: tuple[float, ...] = ()


Said: TypeAlias = Hello | Refused | Seen | Gone | Answer


def main() -> None:
    """Connect, and serve until the other end is closed."""
    words = sys.argv[1:]
    other = socket.socket(fileno=int(words[0]))
    say = Saying(other)
    try:
        client = RtdeClient(
            words[1], float(words[2]), raw=words[3] == "1", watchdog_s=float(words[4]), any_firmware=words[5] == "1"
        )
    except ArmError as error:
        say(Refused(str(error)))
        return
    say(Hello(client.what))
    threading.Thread(target=_serve, args=(client, other, say), daemon=True).start()
    pause_s = 1.0 / (_LOOKS * float(words[2]))
    while True:
        state = client.state()
        if state is not None:
            say(Seen(state))
            continue
        if not client.connected:
            say(Gone())
        time.sleep(pause_s)


class Saying:
    """Says things to the other end, from any thread; ends the process when nobody hears them."""

    def __init__(self, other: socket.socket) -> None:
        self._other, self._lock = other, threading.Lock()

    def __call__(self, what: Said) -> None:
        """Say something."""
        try:
            with self._lock:
                self._other.send(msgspec.msgpack.encode(what))
        except OSError:
            os._exit(0)


def _serve(client: RtdeClient, other: socket.socket, say: Saying) -> None:
    """Do what is asked, one thing after the other."""
    decoder = msgspec.msgpack.Decoder(Call)
    while data := other.recv(LARGEST):
        call = decoder.decode(data)
        try:
            say(Answer(call.number, _do(client, call)))
        except ArmError as error:
            say(Answer(call.number, error=str(error)))
    os._exit(0)


def _do(client: RtdeClient, call: Call) -> tuple[float, ...]:
    numbers = call.numbers
    match call.name:
        case "take_control":
            client.take_control()
        case "check":
            client.check()
        case "move" if call.goal is not None:
            client.move(call.goal, numbers[0], numbers[1])
        case "stop":
            client.stop()
        case "zero":
            client.zero()
        case "tool":
            return tuple(client.tool())
        case "tell":
            client.tell(int(numbers[0]), int(numbers[1]))
        case "unlock":
            client.unlock()
        case "power_up":
            client.power_up(release=bool(numbers[0]))
        case _:
            raise ArmError(f"robot: {call.name}: expected something that can be done")
    return ()


if __name__ == "__main__":
    os.dup2(2, 1)  # ur_rtde tells its troubles on both
    main()
