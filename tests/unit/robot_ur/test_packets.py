"""Packets of the controller, by the byte and from a socket: in order, none left out, whatever pieces they come in."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable, Iterator

import pytest

from services.robot_ur.errors import LostError, StateError
from services.robot_ur.packets import Packets, Recipe

NAMES = ("timestamp", "robot_mode", "payload_cog")
RECIPE = b"\x01DOUBLE,INT32,VECTOR3D"


def framed(kind: bytes, body: bytes) -> bytes:
    return (len(body) + 3).to_bytes(2, "big") + kind + body


def shown(number: int) -> bytes:
    return framed(b"U", b"\x01" + struct.pack(">di3d", 0.002 * number, 7, 0.001, -0.002, float(number)))


def test_a_recipe_says_what_is_where() -> None:
    recipe = Recipe(NAMES, ("DOUBLE", "INT32", "VECTOR3D"))
    body = bytes.fromhex("01" + "3ff8000000000000" + "ffffffff" + "3ff0000000000000" + "0" * 16 + "c000000000000000")
    assert recipe.values(body) == {"timestamp": (1.5,), "robot_mode": (-1,), "payload_cog": (1.0, 0.0, -2.0)}
    with pytest.raises(LostError, match="expected packets of 37 bytes, got one of 36"):
        recipe.values(body[:-1])


@pytest.mark.parametrize("types", [("DOUBLE", "NOT_FOUND", "VECTOR3D"), ("DOUBLE", "STRING", "VECTOR3D")])
def test_an_output_that_there_is_not_is_named(types: tuple[str, ...]) -> None:
    with pytest.raises(StateError, match="this one does not know robot_mode; "):
        Recipe(NAMES, types)


class Controller:
    """The other end, which answers what it is told to and then sends."""

    def __init__(self, answers: tuple[bytes, ...], pieces: tuple[bytes, ...]) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.heard = b""
        self.send = threading.Event()
        self._answers, self._pieces = answers, pieces
        self.thread = threading.Thread(target=self._serve)
        self.thread.start()

    def _serve(self) -> None:
        with self._listener, self._listener.accept()[0] as peer:
            for answer in self._answers:
                self.heard += peer.recv(4096)
                peer.sendall(answer)
            self.send.wait(30.0)
            for piece in self._pieces:
                peer.sendall(piece)


Make = Callable[..., Controller]
ACCEPTED = (framed(b"V", b"\x01"), framed(b"M", b"\x05hello") + framed(b"O", RECIPE), framed(b"S", b"\x01"))


@pytest.fixture
def controller() -> Iterator[Make]:
    made: list[Controller] = []

    def make(answers: tuple[bytes, ...] = ACCEPTED, pieces: tuple[bytes, ...] = ()) -> Controller:
        made.append(Controller(answers, pieces))
        return made[-1]

    yield make
    for one in made:
        one.send.set()
        one.thread.join()


def test_packets_come_in_order_and_all_of_them_however_late_somebody_looks(controller: Make) -> None:
    first, rest = b"".join(map(shown, range(20))), b"".join(map(shown, range(20, 300)))
    made = controller(pieces=(first, framed(b"M", b"\x05between"), rest[:1001], rest[1001:]))
    packets = Packets("127.0.0.1", 500.0, NAMES, made.port)
    assert packets.take() is None
    made.send.set()
    made.thread.join()
    taken: list[float] = []
    while packets.connected or taken[-1:] != [299.0]:
        values = packets.take()
        if values is not None:
            taken.append(values["payload_cog"][2])
    assert taken == [float(number) for number in range(300)]
    assert packets.take() is None
    assert not packets.connected, "the other end is gone"
    packets.close()
    asked = framed(b"V", b"\x00\x02") + framed(b"O", struct.pack(">d", 500.0) + b"timestamp,robot_mode,payload_cog")
    assert made.heard == asked + framed(b"S", b"")


@pytest.mark.parametrize(
    ("answers", "complaint"),
    [
        ((framed(b"V", b"\x00"),), "RTDE of version 2"),
        ((*ACCEPTED[:2], framed(b"S", b"\x00")), "it refuses"),
        ((ACCEPTED[0], framed(b"O", b"\x00DOUBLE,NOT_FOUND,VECTOR3D")), "does not know robot_mode"),
        ((b"\xff\xff",), "expected an answer"),
        ((b"\xff\xffV",), "expected packets of 3 to 4096 bytes, got one of 65535"),
    ],
)
def test_a_controller_that_does_not_agree_is_said(controller: Make, answers: tuple[bytes, ...], complaint: str) -> None:
    made = controller(answers)
    made.send.set()
    with pytest.raises((LostError, StateError), match=complaint):
        Packets("127.0.0.1", 500.0, NAMES, made.port)


def test_nobody_there_is_said() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(LostError, match=f"expected a controller at 127.0.0.1, port {port}"):
        Packets("127.0.0.1", 500.0, NAMES, port)
