"""The controller's side of RTDE, version 2, on one connection. Pure: bytes in, bytes out; values are somebody else's.

Packets, all big-endian: uint16 size of the whole, uint8 type, payload. Source: Universal Robots' "RTDE Guide".
"""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from typing import NamedTuple, Protocol, TypeAlias

Value: TypeAlias = int | float | Sequence[float]

FORMATS = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}
_BY_TYPE = {
    "VECTOR6D": (
        "target_q target_qd target_qdd target_current target_moment actual_q actual_qd actual_current "
        "joint_control_output actual_TCP_pose actual_TCP_speed actual_TCP_force target_TCP_pose target_TCP_speed "
        "joint_temperatures actual_joint_voltage ft_raw_wrench payload_inertia actual_current_window"
    ),
    "VECTOR3D": "actual_tool_accelerometer payload_cog",
    "VECTOR6INT32": "joint_mode",
    "DOUBLE": (
        "timestamp actual_execution_time speed_scaling target_speed_fraction actual_momentum actual_main_voltage "
        "actual_robot_voltage actual_robot_current standard_analog_input0 standard_analog_input1 "
        "standard_analog_output0 standard_analog_output1 payload"
    ),
    "INT32": "robot_mode safety_mode safety_status",
    "UINT32": "runtime_state robot_status_bits safety_status_bits",
    "UINT64": "actual_digital_input_bits actual_digital_output_bits",
}
_OUTPUTS = {name: kind for kind, names in _BY_TYPE.items() for name in names.split()}
_INPUTS = {
    "speed_slider_mask": "UINT32",
    "speed_slider_fraction": "DOUBLE",
    "external_force_torque": "VECTOR6D",
    "standard_analog_output_0": "DOUBLE",
    "standard_analog_output_1": "DOUBLE",
}
_REGISTER = re.compile(r"^(input|output)_(bit|int|double)_register_(\d{1,2})\Z")
_BITS = re.compile(r"^(input|output)_bit_registers(0_to_31|32_to_63)\Z")
_PIN = re.compile(r"^(standard|configurable|tool)_(digital|analog)_output(_mask|_type)?\Z")
_LARGEST = 4096
_MOST_BEHIND_S = 0.25
"""How late a packet of outputs may be; of more, some are lost."""


class Cycle(NamedTuple):
    """The moment that a packet of outputs shows."""

    t_s: float
    """The controller's time."""
    number: int
    """Of the packet on its connection."""


class Data(Protocol):
    """What a connection needs of its controller."""

    @property
    def version(self) -> tuple[int, int, int, int]:
        """Of the controller's software."""
        ...

    def offers(self, name: str) -> bool:
        """Return whether it has this output."""
        ...

    def value(self, name: str, cycle: Cycle) -> Value:
        """Return an output in a packet."""
        ...

    def claim(self, owner: object, name: str) -> bool:
        """Let one connection alone write an input; False when it is another one's."""
        ...

    def write(self, name: str, value: Value) -> None:
        """Take an input."""
        ...

    def heard(self, owner: object) -> None:
        """Note that a connection has sent inputs."""
        ...


class RtdeError(Exception):
    """What cannot be understood; the connection is closed."""


class Session:
    """One client's connection."""

    def __init__(self, data: Data) -> None:
        self._data = data
        self._buffer = b""
        self._outputs: tuple[str, ...] = ()
        self._inputs: dict[int, tuple[str, ...]] = {}
        self._started = False
        self._number = 0
        self._due_s: float | None = None
        self._sent_s = 0.0
        self.period_s = 0.008
        """Between two packets of outputs."""

    def receive(self, data: bytes) -> bytes:
        """Take bytes; return what is answered. Raises RtdeError."""
        self._buffer += data
        said = b""
        while len(self._buffer) >= 3:
            size, kind = struct.unpack(">HB", self._buffer[:3])
            if not 3 <= size <= _LARGEST:
                raise RtdeError(f"a packet of {size} bytes")
            if len(self._buffer) < size:
                break
            payload, self._buffer = self._buffer[3:size], self._buffer[size:]
            said += self._answer(chr(kind), payload)
        return said

    def due(self, now_s: float) -> float | None:
        """Return the time that the next packet of outputs is due at, if it is to be sent now.

        As from a controller the times are even, however late we are; what is late follows one after the other, so that
        a client that looks at the newest packet only sees each.
        """
        if not self._started or not self._outputs:
            return None
        if self._due_s is None or now_s - self._due_s > _MOST_BEHIND_S:
            self._due_s = now_s
        if now_s < max(self._due_s, self._sent_s + self.period_s / 2.0):
            return None
        due_s, self._due_s, self._sent_s = self._due_s, self._due_s + self.period_s, now_s
        return due_s

    def outputs(self, t_s: float) -> bytes:
        """Return a packet of all outputs as they are at a time of the controller."""
        body, cycle = b"\x01", Cycle(t_s, self._number)
        self._number += 1
        for name in self._outputs:
            value = self._data.value(name, cycle)
            numbers = value if isinstance(value, Sequence) else (value,)
            body += struct.pack(">" + FORMATS[output_type(name) or ""], *numbers)
        return packet("U", body)

    def _answer(self, kind: str, payload: bytes) -> bytes:
        if kind == "V":
            (version,) = struct.unpack(">H", payload)
            return packet("V", bytes([version == 2]))
        if kind == "v":
            return packet("v", struct.pack(">4I", *self._data.version))
        if kind == "O":
            return self._set_outputs(payload)
        if kind == "I":
            return self._set_inputs(payload)
        if kind in "SP":
            self._started = kind == "S"
            return packet(kind, b"\x01")
        if kind == "U":
            self._take(payload)
        return b""

    def _set_outputs(self, payload: bytes) -> bytes:
        (rate_hz,) = struct.unpack(">d", payload[:8])
        names = _names(payload[8:])
        types = [output_type(name) if self._data.offers(name) else None for name in names]
        fits = None not in types and 1.0 <= rate_hz <= 500.0
        self._outputs = names if fits else ()
        self.period_s = 1.0 / rate_hz if fits else self.period_s
        return packet("O", bytes([fits]) + ",".join(kind or "NOT_FOUND" for kind in types).encode())

    def _set_inputs(self, payload: bytes) -> bytes:
        names = _names(payload)
        types = [input_type(name) or "NOT_FOUND" for name in names]
        types = [
            kind if kind == "NOT_FOUND" or self._data.claim(self, name) else "IN_USE"
            for name, kind in zip(names, types, strict=True)
        ]
        fits = not {"NOT_FOUND", "IN_USE"} & set(types)
        number = len(self._inputs) + 1 if fits else 0
        if fits:
            self._inputs[number] = names
        return packet("I", bytes([number]) + ",".join(types).encode())

    def _take(self, payload: bytes) -> None:
        names = self._inputs.get(payload[0])
        if names is None:
            raise RtdeError(f"inputs by recipe {payload[0]}, which there is none of")
        offset = 1
        for name in names:
            form = ">" + FORMATS[input_type(name) or ""]
            values = struct.unpack_from(form, payload, offset)
            offset += struct.calcsize(form)
            self._data.write(name, values[0] if len(values) == 1 else values)
        self._data.heard(self)


def packet(kind: str, body: bytes) -> bytes:
    """Return a packet."""
    return struct.pack(">HB", len(body) + 3, ord(kind)) + body


def output_type(name: str) -> str | None:
    """Return the type of an output; None for one that no controller has."""
    if (register := _register_type(name)) is not None:
        return register
    return _OUTPUTS.get(name)


def input_type(name: str) -> str | None:
    """Return the type of an input; None for one that no controller has."""
    if name.startswith("output"):
        return None
    if (register := _register_type(name)) is not None:
        return register
    return "UINT8" if _PIN.match(name) else _INPUTS.get(name)


def _register_type(name: str) -> str | None:
    if match := _REGISTER.match(name):
        return {"bit": "BOOL", "int": "INT32", "double": "DOUBLE"}[match[2]]
    return "UINT32" if _BITS.match(name) else None


def _names(payload: bytes) -> tuple[str, ...]:
    return tuple(name for name in payload.decode("ascii", "replace").split(",") if name)
