"""An emulated VAL II controller at its terminal. Pure: characters and time in, characters out.

Real texts are not public; these are in the style that is remembered, and only as much of the language is there as a
robot link and a curious person need. A motion is carried out in ``tick``, so that a prompt that means no more than
"started" is on its way before; call it after each ``receive``.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from services.robot_link.emulator import poses
from services.robot_link.emulator.arm import Arm, ArmFault
from services.robot_link.emulator.poses import Frame
from services.wire.errors import TreenailError

BANNER = ("VAL II EMULATOR", "No arm was harmed")
LOAD = "Load VAL II from floppy (Y/N)? "
"""What a controller asks first that has lost its memory."""
_NAME = re.compile(r"[A-Z][A-Z0-9.]{0,14}\Z")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)\Z", re.ASCII)
_CALL = re.compile(r"TRANS\(([^()]*)\)\Z")
_COMMANDS = ("ABORT", "CALIBRATE", "DO", "HERE", "LISTL", "SPEED", "STATUS", "WHERE")
_LONGEST = 128


class Mistake(Exception):
    """A command that cannot be carried out; the text is what the controller says."""


@dataclass(frozen=True)
class Behaviour:
    """What kind of controller this is."""

    convention: str = "zyz"
    """How it takes O, A, T: zyz or val_offset."""
    prompt: str = "started"
    """What its prompt after a motion means: started or arrived."""
    echo: bool = True
    cold: bool = False
    """Whether it begins with the questions of a cold start."""
    motion_s: float = 0.0
    """How long a motion takes [s]."""
    reach_mm: float = 1000.0
    """How far from its base the arm gets."""
    decimals: int = 3
    """Of what WHERE and LISTL print."""


@dataclass
class Faults:
    """What goes wrong, set at any time; those with a number happen that often."""

    garbage: int = 0
    """Replies with bytes in them that are no text."""
    nonsense: int = 0
    """Replies to WHERE without numbers."""
    misheard: int = 0
    """Lines of which a digit is another one when it gets here."""
    silence: bool = False
    """Nothing is said any more, and nothing carried out."""
    half_way: int = 0
    """Motions that end half-way without a word."""
    power: bool = True
    """Arm power."""


@dataclass
class _Motion:
    begin_s: float
    start: Frame
    end: Frame
    act: Callable[[], None]


@dataclass
class Controller:
    """One controller with its arm. ``receive`` and ``tick`` are those of ``ControllerText``."""

    arm: Arm
    behaviour: Behaviour = field(default_factory=Behaviour)
    locations: dict[str, Frame] = field(default_factory=dict)
    faults: Faults = field(default_factory=Faults)
    boot: Callable[[], str] | None = None
    """Loads its system off a floppy, and returns what that says first; whatever TreenailError it raises is shown."""
    motions: int = 0
    """Motions begun so far."""
    heard: list[str] = field(default_factory=list)
    """The newest lines that were sent off, oldest first."""

    def __post_init__(self) -> None:
        """Begin with an empty line and, cold, with the first question."""
        self._line, self._shown = "", False
        self._variables: dict[str, float] = {}
        self._waiting: list[str] = []
        self._motion: _Motion | None = None
        self._calibrated = not self.behaviour.cold
        self._questions = [LOAD, "Initialize (Y/N)? "] if self.behaviour.cold else []

    @property
    def next_deadline_s(self) -> float | None:
        """When ``tick`` ends a motion."""
        return None if self._motion is None else self._motion.begin_s + self.behaviour.motion_s

    def start(self, now_s: float) -> bytes:
        """Be connected to; return what is shown then, which is something only when it has just been switched on."""
        if self._shown:
            return b""
        self._shown = True
        lines = "".join(f"{line}\r\n" for line in BANNER)
        return ("\r\n" + lines + (self._questions[0] if self._questions else ".")).encode()

    def receive(self, text: bytes, now_s: float) -> bytes:
        """Take what is typed; return what is shown."""
        if self.faults.silence:
            return b""
        shown = ""
        for value in text:
            if value in b"\r\n":
                line, self._line = self._line.strip().upper(), ""
                shown += "\r\n" + self._take(line, now_s)
            elif value == 0x15:
                self._line = ""
                shown += "\r\n" if self.behaviour.echo else ""
            elif value in (0x08, 0x7F):
                self._line = self._line[:-1]
            elif 0x20 <= value < 0x7F and len(self._line) < _LONGEST:
                shown += self._type(chr(value))
        return self._out(shown)

    def tick(self, now_s: float) -> bytes:
        """Let time pass; return what is shown."""
        motion = self._motion
        if motion is None or self.faults.silence or now_s < motion.begin_s + self.behaviour.motion_s:
            return b""
        self._motion = None
        shown = ""
        try:
            self._finish(motion)
        except ArmFault as fault:
            shown = f"\r\n*{fault}*\r\n"
        if self.behaviour.prompt == "arrived":
            shown += "."
            while self._waiting and self._motion is None:
                shown += self._take(self._waiting.pop(0), now_s)
        return self._out(shown)

    # -- typing ------------------------------------------------------------------------------------------------------

    def _type(self, character: str) -> str:
        if self.faults.misheard and character.isdigit():
            self.faults.misheard -= 1
            character = str(9 - int(character))
        self._line += character
        return character if self.behaviour.echo else ""

    def _take(self, line: str, now_s: float) -> str:
        """Carry a line out; return what is shown, the prompt included."""
        self.heard = [*self.heard[-99:], line]
        if self._questions:
            return self._answer(line)
        if self._motion is not None and self.behaviour.prompt == "arrived" and not line.startswith("AB"):
            self._waiting.append(line)
            return ""
        begun = self.motions
        try:
            lines = self._carry_out(line, now_s) if line else []
        except Mistake as mistake:
            lines = [f"*{mistake}*"]
        body = "".join(f"{answer}\r\n" for answer in lines)
        moving = self.motions != begun and self.behaviour.prompt == "arrived"
        return body + ("" if moving else ".")

    def _answer(self, line: str) -> str:
        """Take the answer to a question; a load that fails asks again."""
        loaded = ""
        if (self._questions[0], line) == (LOAD, "Y") and self.boot is not None:
            try:
                loaded = f"{self.boot()}\r\n"
            except TreenailError as error:
                return f"*{error}*\r\n{LOAD}"
        if line in ("Y", "N", ""):
            self._questions.pop(0)
        return loaded + (self._questions[0] if self._questions else ".")

    def _out(self, shown: str) -> bytes:
        data = shown.encode()
        if self.faults.garbage and data.endswith(b"."):
            self.faults.garbage -= 1
            data = data[:-1] + b"\x93\xfe#\r\n\x07."
        return data

    # -- commands ----------------------------------------------------------------------------------------------------

    def _carry_out(self, line: str, now_s: float) -> list[str]:
        word, _, rest = line.partition(" ")
        matches = [command for command in _COMMANDS if command.startswith(word)]
        if len(matches) != 1:
            raise Mistake("Ambiguous command" if matches else "Unknown command")
        rest = rest.strip()
        command = matches[0]
        if command == "DO":
            return self._do(rest, now_s)
        if command == "WHERE":
            if self.faults.nonsense:
                self.faults.nonsense -= 1
                return ["    X/JT1    Y/JT2 ?? ", "   12.3  ---  7"]
            return ["   X/JT1    Y/JT2    Z/JT3    O/JT4    A/JT5    T/JT6", self._row(self._now(now_s))]
        if command == "LISTL":
            return [f"{rest:<10}{self._row(self._location(rest, now_s))}"]
        if command == "HERE":
            self.locations[_name(rest)] = self._now(now_s)
        elif command == "SPEED":
            if not 0.0 < _number(rest.removesuffix("MONITOR").strip()) <= 300.0:
                raise Mistake("Illegal value")
        elif command == "STATUS":
            return ["Arm power " + ("on" if self.faults.power else "off"), "Not executing"]
        elif command == "CALIBRATE":
            self._calibrated = True
        elif command == "ABORT":
            self._stop(now_s)
        return []

    def _do(self, line: str, now_s: float) -> list[str]:
        word, _, rest = line.partition(" ")
        place = rest.replace(" ", "")
        if word in ("MOVE", "MOVES"):
            self._move(place, now_s)
        elif word == "ALIGN":
            self._begin(self._align(self._now(now_s)), self.arm.move_to, "", now_s)
        elif word == "SET":
            name, _, value = place.partition("=")
            self.locations[_name(name)] = self._location(value, now_s)
        elif "=" in line:
            name, _, value = line.partition("=")
            self._variables[_name(name.strip())] = _number(value.strip())
        else:
            raise Mistake("Unknown instruction")
        return []

    def _move(self, place: str, now_s: float) -> None:
        end = self._location(place, now_s)
        if place.startswith("HERE:"):
            variables = dict(self._variables)
            step = self._step(place.removeprefix("HERE:"))
            self._begin(end, lambda *_: self.arm.move_by(step, variables), "", now_s)
        else:
            self._begin(end, self.arm.move_to, place, now_s)

    def _begin(self, end: Frame, act: Callable[[Frame, str], None], name: str, now_s: float) -> None:
        if not self._calibrated:
            raise Mistake("Arm not calibrated")
        if not self.faults.power:
            raise Mistake("Arm power off")
        if self._motion is not None:
            raise Mistake("Motion in progress")
        if float(np.linalg.norm(end[:3, 3])) > self.behaviour.reach_mm:
            raise Mistake("Location out of range")
        self.motions += 1
        self._motion = _Motion(now_s, self.arm.place.copy(), end, lambda: act(end, name))

    def _finish(self, motion: _Motion) -> None:
        if not self.faults.power:
            self.arm.stop_at(motion.start)
            raise ArmFault("Arm power off")
        if self.faults.half_way:
            self.faults.half_way -= 1
            self.arm.stop_at(poses.between(motion.start, motion.end, 0.5))
            return
        motion.act()

    def _stop(self, now_s: float) -> None:
        if self._motion is None:
            raise Mistake("Nothing to abort")
        place = self._now(now_s)
        self._motion = None
        self._waiting.clear()
        self.arm.stop_at(place)

    # -- places ------------------------------------------------------------------------------------------------------

    def _now(self, now_s: float) -> Frame:
        motion, motion_s = self._motion, self.behaviour.motion_s
        if motion is None or motion_s <= 0.0:
            return self.arm.place
        return poses.between(motion.start, motion.end, min(1.0, (now_s - motion.begin_s) / motion_s))

    def _location(self, text: str, now_s: float) -> Frame:
        place = np.eye(4)
        for part in text.split(":"):
            if part.startswith("TRANS"):
                place = place @ self._step(part)
            elif part == "HERE":
                place = place @ self._now(now_s)
            elif part in self.locations:
                place = place @ self.locations[part]
            else:
                raise Mistake(f"Undefined value: {_name(part)}")
        return place

    def _step(self, text: str) -> Frame:
        call = _CALL.match(text)
        if call is None:
            raise Mistake("Syntax error")
        words = [word.strip() for word in call.group(1).split(",")]
        if len(words) > 6:
            raise Mistake("Syntax error")
        numbers = [_number(word) if word else 0.0 for word in words]
        return poses.frame((*numbers, *[0.0] * (6 - len(numbers))), self.behaviour.convention)

    def _row(self, place: Frame) -> str:
        decimals = self.behaviour.decimals
        return "".join(f" {value:8.{decimals}f}" for value in poses.numbers_of(place, self.behaviour.convention))

    def _align(self, place: Frame) -> Frame:
        """Return the place with its tool's axis along the nearest axis of the base."""
        aligned = place.copy()
        axis = int(np.argmax(np.abs(place[:3, 2])))
        approach = np.zeros(3)
        approach[axis] = np.sign(place[axis, 2])
        side = place[:3, 1] - approach * float(place[:3, 1] @ approach)
        side /= np.linalg.norm(side)
        aligned[:3, 0], aligned[:3, 1], aligned[:3, 2] = np.cross(side, approach), side, approach
        return aligned


def _name(text: str) -> str:
    if not _NAME.match(text):
        raise Mistake("Syntax error")
    return text


def _number(text: str) -> float:
    if not _NUMBER.match(text):
        raise Mistake("Syntax error")
    return float(text)
