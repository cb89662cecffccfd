"""The emulated controller: modes, registers, faults, and what RTDE shows of them. One lock; time is an argument.

power off (3) --power on--> idle, brakes on (5) --brake release--> running (7)
normal (1) --protective stop--> 3 --unlock, 5 s later--> 1
any --emergency stop--> 7, power off --released--> 1, power off
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Sequence
from dataclasses import dataclass, field

from services.bus.emulated_arm import Arm, Load
from services.bus.frames import frame, turned
from services.robot_ur.emulator.rtde import Cycle, Value, output_type

LOG = logging.getLogger("ur-emulator")

RUNNING, IDLE, POWER_OFF = 7, 5, 3
NORMAL, REDUCED, PROTECTIVE, SAFEGUARD, SYSTEM_STOP, ROBOT_STOP = 1, 2, 3, 5, 6, 7
PLAYING, STOPPED = 2, 1
ROBOT_MODES = {POWER_OFF: "POWER_OFF", IDLE: "IDLE", RUNNING: "RUNNING"}
SAFETY_MODES = {
    NORMAL: "NORMAL",
    REDUCED: "REDUCED",
    PROTECTIVE: "PROTECTIVE_STOP",
    SAFEGUARD: "SAFEGUARD_STOP",
    SYSTEM_STOP: "SYSTEM_EMERGENCY_STOP",
    ROBOT_STOP: "ROBOT_EMERGENCY_STOP",
}
CYCLE_S = 0.002
_SAFETY_BITS = {NORMAL: 1, REDUCED: 1 << 1, PROTECTIVE: 1 << 2, SAFEGUARD: 1 << 4}
_STOP_BITS = {SYSTEM_STOP: 1 << 5 | 1 << 7, ROBOT_STOP: 1 << 6 | 1 << 7}
_GRAVITY = 9.80665


@dataclass
class Behaviour:
    """What a controller is like."""

    version: tuple[int, int, int, int] = (5, 21, 0, 0)
    remote: bool = True
    unlock_after_s: float = 5.0
    """How long after a protective stop it cannot be unlocked."""
    motion_s: float = 0.0
    """How long a motion takes."""
    payload_kg: float = 0.0
    payload_cog_m: tuple[float, ...] = (0.0, 0.0, 0.0)
    tcp: tuple[float, ...] = (0.0,) * 6
    """X, Y, Z [m], rotation vector [rad] of the tool in the flange."""


@dataclass
class Faults:
    """What can go wrong on demand."""

    stop_in_motion: bool = False
    """The next motion ends half-way in a protective stop."""
    short_mm: float = 0.0
    """Motions end so far before their goal, and nothing says so."""
    drop: int = 0
    """RTDE packets of outputs that are still to be lost."""
    slow_s: float = 0.0
    """How much later everything is answered."""
    jump_s: float = 0.0
    """Of the controller's clock."""
    pulled: bool = False
    """The network cable is out."""
    busy: bool = False
    """Another client has the input registers."""
    missing: set[str] = field(default_factory=set)
    """Outputs that this controller does not offer."""
    weigh_kg: float = 0.0
    """What hangs at the tool beyond the payload that is set."""


class Controller:
    """One arm's controller; ``services.robot_ur.emulator.program`` is what moves it."""

    def __init__(self, arm: Arm, behaviour: Behaviour) -> None:
        self.arm, self.behaviour, self.faults = arm, behaviour, Faults()
        self.lock = threading.RLock()
        self.remote = behaviour.remote
        self.robot_mode, self.safety_mode, self.runtime = RUNNING, NORMAL, STOPPED
        self.payload_kg, self.payload_cog_m = behaviour.payload_kg, behaviour.payload_cog_m
        self.pose: tuple[float, ...] = arm.pose
        """Where the tool is now, also on the way."""
        self.loads: tuple[Load, ...] = arm.loads
        self.tare: tuple[float, ...] = (0.0,) * 6
        """What ``zero_ftsensor`` has taken away, in the tool frame."""
        self.inputs: dict[str, Value] = {}
        self.registers: dict[str, int | float] = {}
        """Outputs of the program."""
        self.heard_s = 0.0
        """When the control client last sent its registers."""
        self.now_s = 0.0
        """Since the controller was switched on."""
        self._stopped_s = -60.0
        self._usual = behaviour
        self._owners: dict[str, object] = {}

    def reset(self) -> None:
        """Be as at the start, but for what was sent and said."""
        self.faults, self.behaviour = Faults(), self._usual
        self.remote = self.behaviour.remote
        self.robot_mode, self.safety_mode, self.runtime = RUNNING, NORMAL, STOPPED
        self.payload_kg, self.payload_cog_m = self.behaviour.payload_kg, self.behaviour.payload_cog_m
        self.tare = (0.0,) * 6

    # -- what people and safety devices do ------------------------------------------------------------------------

    def protect(self) -> None:
        """Make a protective stop."""
        self.safety_mode, self.runtime, self._stopped_s = PROTECTIVE, STOPPED, self.now_s
        LOG.info("protective stop")

    def unlock(self) -> str:
        """Unlock a protective stop; return what the dashboard says."""
        if self.safety_mode == PROTECTIVE and self.now_s - self._stopped_s < self.behaviour.unlock_after_s:
            return (
                "Cannot unlock protective stop until 5s after occurrence. "
                "Always inspect cause of protective stop before unlocking"
            )
        if self.safety_mode == PROTECTIVE:
            self.safety_mode = NORMAL
        return "Protective stop releasing"

    def stop_by_hand(self, mode: int) -> None:
        """Press an emergency stop, or let a safeguard (5) stop the arm; NORMAL releases either."""
        if mode in (SYSTEM_STOP, ROBOT_STOP):
            self.robot_mode = POWER_OFF
        self.safety_mode = mode
        if mode not in (NORMAL, REDUCED):
            self.runtime = STOPPED

    def power(self, mode: int) -> bool:
        """Come to a robot mode, one step at a time upwards; False when it cannot be."""
        blocked = self.safety_mode not in (NORMAL, REDUCED) and mode != POWER_OFF
        if blocked or (mode == RUNNING and self.robot_mode == POWER_OFF):
            return False
        self.robot_mode = mode
        if mode != RUNNING:
            self.runtime = STOPPED
        return True

    def start_program(self) -> bool:
        """Run the program that a client has sent; False when it is not taken."""
        can = self.remote and self.robot_mode == RUNNING and self.safety_mode in (NORMAL, REDUCED)
        if can:
            self.runtime = PLAYING
        return can

    # -- what RTDE shows -------------------------------------------------------------------------------------------

    @property
    def version(self) -> tuple[int, int, int, int]:
        """Of the controller's software."""
        return self.behaviour.version

    def offers(self, name: str) -> bool:
        """Return whether there is such an output."""
        return name not in self.faults.missing

    def claim(self, owner: object, name: str) -> bool:
        """See rtde.Data."""
        return not self.faults.busy and self._owners.setdefault(name, owner) is owner

    def release(self, owner: object) -> None:
        """Forget a connection that is gone."""
        self._owners = {name: other for name, other in self._owners.items() if other is not owner}

    def write(self, name: str, value: Value) -> None:
        """Take an input."""
        self.inputs[name] = value

    def heard(self, owner: object) -> None:
        """See rtde.Data."""
        if self._owners.get("input_int_register_0") is owner:
            self.heard_s = self.now_s

    def number(self, name: str) -> float:
        """Return an input register; 0 before it is written."""
        value = self.inputs.get(name, 0)
        return 0.0 if isinstance(value, Sequence) else float(value)

    def value(self, name: str, cycle: Cycle) -> Value:
        """Return an output; each packet of a connection has the next sample of the wrist."""
        if name.startswith("output_"):
            return self.registers.get(name, 0)
        if name.startswith("input_"):
            return self.inputs.get(name, 0)
        shown = self._shown(name, cycle)
        if shown is not None:
            return shown
        kind = output_type(name) or ""
        return (0,) * int(kind[6]) if kind.startswith("VECTOR") else 0

    def _shown(self, name: str, cycle: Cycle) -> Value | None:
        match name:
            case "timestamp":
                return cycle.t_s + self.faults.jump_s
            case "actual_TCP_pose" | "target_TCP_pose":
                return self.pose
            case "actual_TCP_force":
                return turned(frame(self.pose), self._compensated(cycle.number))
            case "ft_raw_wrench":
                return self._raw(cycle.number)
            case "robot_mode":
                return self.robot_mode
            case "safety_mode" | "safety_status":
                return self.safety_mode
            case "runtime_state":
                return self.runtime
            case "robot_status_bits":
                return (self.robot_mode >= IDLE) | (self.runtime == PLAYING) << 1
            case "safety_status_bits":
                return (_SAFETY_BITS | _STOP_BITS)[self.safety_mode]
            case "payload":
                return self.payload_kg
            case "payload_cog":
                return self.payload_cog_m
            case "speed_scaling" | "target_speed_fraction" | "speed_slider_fraction":
                return 1.0
            case _:
                return None

    def zero(self) -> None:
        """Take what is felt now, the mean of all samples, for nothing."""
        samples = [self._raw(number) for number in range(len(self.loads))]
        self.tare = tuple(sum(column) / len(samples) for column in zip(*samples, strict=True))

    def _raw(self, number: int) -> Load:
        load = self.loads[number % len(self.loads)]
        if not self.faults.weigh_kg:
            return load
        down = frame(self.pose)[:3, :3].T @ (0.0, 0.0, -_GRAVITY * self.faults.weigh_kg)
        return (*(felt + more for felt, more in zip(load[:3], down.tolist(), strict=True)), *load[3:])

    def _compensated(self, number: int) -> Load:
        return tuple(felt - nothing for felt, nothing in zip(self._raw(number), self.tare, strict=True))
