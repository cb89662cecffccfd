"""ur_rtde's interfaces to one controller, and its packets. All but ``state`` may take long.

They are used in a process of their own (``services.robot_ur.hands``): when a connection is lost, ur_rtde connects
again by itself, sends its program again, and now and then takes the process with it.

What ur_rtde says goes into sentences of ours, each with what to do; what it says beyond is passed on.
"""

from __future__ import annotations

import contextlib
import re
from typing import Any, Protocol

from services.robot_ur.errors import LostError, StateError
from services.robot_ur.packets import Packets
from services.robot_ur.poses import from_ur, to_ur
from services.robot_ur.states import State
from services.rules.motions import ArmError
from services.rules.poses import Pose
from services.wire.text import one_line

OUTPUTS = (
    "timestamp",
    "actual_TCP_pose",
    "actual_TCP_speed",
    "actual_TCP_force",
    "robot_mode",
    "safety_mode",
    "runtime_state",
    "payload",
    "payload_cog",
)
RAW = "ft_raw_wrench"
EPISODE_REGISTER, STEP_REGISTER = 18, 19
KNOWN_FIRMWARE = {3: 3, 5: 0}
"""Lowest minor version by major one that ur_rtde says it works with: CB3 and e-Series."""
_DASHBOARD_MS = 2000
_VERSION = re.compile(r"(\d+)\.(\d+)")


class Client(Protocol):
    """One connection to one controller. All but ``state`` and ``connected`` block, and raise ArmError."""

    @property
    def connected(self) -> bool:
        """Whether packets still can come."""

    @property
    def what(self) -> str:
        """Model and version, for people."""

    def state(self) -> State | None:
        """Return the next packet, None for none so far."""

    def take_control(self) -> None:
        """Send our program to the controller and have it run."""

    def check(self) -> None:
        """Say that we are alive, and look whether the controller still takes orders."""

    def move(self, goal: Pose, speed_mm_s: float, acceleration_mm_s2: float) -> None:
        """Begin a straight motion."""

    def stop(self) -> None:
        """End the motion under way."""

    def zero(self) -> None:
        """Zero the wrist's sensor."""

    def tool(self) -> list[float]:
        """Return the TCP in the flange: X, Y, Z [m], rotation vector [rad]."""

    def tell(self, episode: int, step: int) -> None:
        """Write to the registers which motion follows."""

    def unlock(self) -> None:
        """Unlock a protective stop."""

    def power_up(self, release: bool) -> None:
        """Power the arm, or release its brakes."""

    def close(self) -> None:
        """Let go of the controller."""


class RtdeClient:
    """The real one."""

    def __init__(self, address: str, rate_hz: float, *, raw: bool, watchdog_s: float, any_firmware: bool) -> None:
        """Connect and receive. Raises LostError when there is no controller, StateError for one that is not known."""
        import dashboard_client

        self._address, self._raw, self._watchdog_s = address, raw, watchdog_s
        self._control: Any = None
        self._io: Any = None
        self._dashboard = dashboard_client.DashboardClient(address)
        self._said(lambda: self._dashboard.connect(_DASHBOARD_MS))
        version = str(self._said(self._dashboard.polyscopeVersion))
        self.version = _checked_version(version, any_firmware)
        self.what = f"PolyScope {version}"
        names = [*OUTPUTS, RAW] if raw else list(OUTPUTS)
        self._packets = Packets(address, rate_hz, names)

    @property
    def connected(self) -> bool:
        """See Client."""
        return self._packets.connected

    def state(self) -> State | None:
        """See Client."""
        try:
            values = self._packets.take()
        except LostError:
            self._packets.close()
            return None
        if values is None:
            return None
        x, y, z, *_ = values["actual_TCP_speed"]
        return State(
            t_s=values["timestamp"][0],
            pose=from_ur(values["actual_TCP_pose"]),
            speed_mm_s=1000.0 * (x * x + y * y + z * z) ** 0.5,
            force=values["actual_TCP_force"],
            raw=values.get(RAW, (0.0,) * 6),
            robot_mode=int(values["robot_mode"][0]),
            safety_mode=int(values["safety_mode"][0]),
            runtime=int(values["runtime_state"][0]),
            payload_kg=values["payload"][0],
            payload_cog_mm=tuple(1000.0 * value for value in values["payload_cog"]),
        )

    def take_control(self) -> None:
        """See Client."""
        import rtde_control

        self._drop_control()
        self._control = self._said(lambda: rtde_control.RTDEControlInterface(self._address))
        self._done("watchdog", self._said(lambda: self._control.setWatchdog(1.0 / self._watchdog_s)))

    def _drop_control(self) -> None:
        control, self._control = self._control, None
        if control is not None:
            with contextlib.suppress(RuntimeError):
                control.disconnect()

    def check(self) -> None:
        """See Client."""
        if self._control is not None:
            self._done("watchdog", self._said(self._control.kickWatchdog))
        if self.version >= (5, 6) and not self._said(self._dashboard.isInRemoteControl):
            raise StateError(_LOCAL)

    def move(self, goal: Pose, speed_mm_s: float, acceleration_mm_s2: float) -> None:
        """See Client."""
        speed, acceleration = speed_mm_s / 1000.0, acceleration_mm_s2 / 1000.0
        self._done("moveL", self._said(lambda: self._control.moveL(to_ur(goal), speed, acceleration, True)))

    def stop(self) -> None:
        """See Client."""
        if self._control is not None:
            self._said(lambda: self._control.stopL(2.0, True))

    def zero(self) -> None:
        """See Client."""
        self._done("zeroFtSensor", self._said(self._control.zeroFtSensor))

    def tool(self) -> list[float]:
        """See Client."""
        return [float(value) for value in self._said(self._control.getTCPOffset)]

    def tell(self, episode: int, step: int) -> None:
        """See Client. Episode + 1, so that 0 is nothing."""
        import rtde_io

        if self._io is None:
            self._io = self._said(lambda: rtde_io.RTDEIOInterface(self._address))
        for register, value in ((EPISODE_REGISTER, episode + 1), (STEP_REGISTER, step)):
            self._done(
                "register",
                self._said(lambda register=register, value=value: self._io.setInputIntRegister(register, value)),
            )

    def unlock(self) -> None:
        """See Client."""
        self._said(self._dashboard.closeSafetyPopup)
        self._said(self._dashboard.unlockProtectiveStop)

    def power_up(self, release: bool) -> None:
        """See Client."""
        self._said(self._dashboard.brakeRelease if release else self._dashboard.powerOn)

    def _said(self, call: Any) -> Any:
        """Return what ur_rtde answers. Raises ArmError with what it complains of."""
        try:
            return call()
        except RuntimeError as error:
            raise _in_our_words(str(error), self._address) from None

    def _done(self, what: str, done: object) -> None:
        """Raise StateError when ur_rtde says that something was not done."""
        if not done:
            raise StateError(f"robot: {what}: expected the controller to do it, it did not; is our program running?")


_LOCAL = "robot: expected remote control, the controller is in local mode; set it at the pendant, top right"


def _in_our_words(said: str, address: str) -> ArmError:
    """Return an error for what ur_rtde says."""
    lower = said.lower()
    if "could not connect" in lower or "timeout connecting" in lower:
        return LostError(
            f"robot: expected a controller at {address}, ports 29999 and 30004, nobody answers there; is the address "
            "right, is it on, is the cable in?"
        )
    if "already in use" in lower:
        return StateError(
            "robot: expected the controller's input registers for us, another client has them; end it, or switch off "
            "EtherNet/IP, PROFINET and MODBUS units"
        )
    if "remote control" in lower:
        return StateError(_LOCAL)
    return ArmError(f"robot: {one_line(said)[:200]}")


def _checked_version(said: str, any_firmware: bool) -> tuple[int, int]:
    """Return the version. Raises StateError for one that nobody has tried."""
    match = _VERSION.search(said)
    major, minor = (int(match[1]), int(match[2])) if match else (0, 0)
    if not any_firmware and minor < KNOWN_FIRMWARE.get(major, 1 << 30):
        raise StateError(
            f"robot: expected PolyScope 3.3 and up or 5, got {one_line(said)[:40]!r}, which nobody has tried; "
            "--any-firmware does"
        )
    return major, minor
