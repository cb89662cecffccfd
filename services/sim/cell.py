"""The simulated cell: the contact world behind the messages of a robot and a sensor, with errors, clock and guard.

What a motion gives depends on the definition, the seed, the episode's start pose and its motions so far, and on
nothing else: a cell that was killed is brought back by the same ``home`` and the same motions.

The simulator is its own sensor, so what can fail of it is the physics: a load that is no number is a sensor lost, and
nothing but ``home`` is taken then.
"""

from __future__ import annotations

import math

from services.rules.ft_counts import FtCounts
from services.rules.guard import Guard, increment_of
from services.rules.motions import GuardError, OtherRunError, OutOfOrderError
from services.sim.arm import Arm
from services.sim.pose import Pose
from services.sim.world import Reading, World
from services.wire.actions import Increment
from services.wire.definition import Definition, Sensor
from services.wire.messages import Force, FtPacket, Home, Move, Moved, Torque
from services.wire.randomness import Role, generator

MOTION_NS = 20_000_000
"""Simulated time that one motion takes."""
SATURATED = 1
"""Bit of ``FtPacket.status``."""
_MOTIONS_PER_EPISODE = 2**17


class SimulatedCell:
    """Robot and sensor of one run."""

    def __init__(self, definition: Definition, run: str, seed: int, world: World | None = None) -> None:
        self.world = World(definition) if world is None else world
        noise = definition.noise
        self._force_error_n, self._torque_error_nm = noise.scale * noise.force_n, noise.scale * noise.torque_nm
        self._counts = _counts(definition.sensor)
        self._arm = Arm(noise, seed)
        self._guard = Guard(definition)
        self._run = run
        self._seed = seed
        self._last: Home | Move | None = None
        self._answer: tuple[Moved, FtPacket] | None = None

    def home(self, home: Home) -> tuple[Moved, FtPacket]:
        """Put the peg at the start pose of an episode, to the arm's error; may be called at any time.

        Raises OtherRunError, and GuardError for a pose that no episode begins with or a sensor that is lost.
        """
        self._check_run(home.run)
        self._allow(self._guard.homing(home))
        pose = Pose.from_tilt(home.x_mm, home.y_mm, home.z_mm, home.rx_deg, home.ry_deg, home.rz_deg)
        reading = self.world.home(pose.moved(self._arm.executed(Increment(), home.episode, 0)))
        self._guard.homed(home)
        return self._remember(home, self._felt(home.episode, 0, Increment(), reading))

    def move(self, move: Move) -> tuple[Moved, FtPacket]:
        """Make the next motion, or answer the last one again.

        The answer is the motion as the arm believes it was made; its true error shows only in the forces.

        Raises OutOfOrderError for any other step, GuardError for a motion beyond the limits, OtherRunError for
        another run; nothing moves then. Raises GuardError also when the sensor is lost in the motion, and from then on.
        """
        self._check_run(move.run)
        if self._answer is not None and move == self._last:
            self._allow(self._guard.sensing(self._answer[1], 0.0))
            return self._answer
        done, packet = self._answer or (None, None)
        if done is None or packet is None or (move.episode, move.step) != (done.episode, done.step + 1):
            at = "not homed" if done is None else f"at episode {done.episode}, step {done.step}"
            raise OutOfOrderError(f"move: cannot make step {move.step} of episode {move.episode}: the robot is {at}")
        # Simulated time stands still between motions, so that the sample is as old as the end of the last one.
        self._allow(self._guard.moving(move, packet, (done.arrived_t_ns - packet.t_ns) * 1e-9))
        increment = increment_of(move)
        reading = self.world.move(self._arm.executed(increment, move.episode, move.step))
        answer = self._felt(move.episode, move.step, increment, reading)
        self._guard.moved(answer[0])
        return self._remember(move, answer)

    def _check_run(self, run: str) -> None:
        if run != self._run:
            raise OtherRunError(f"robot: this cell runs {self._run}, got a motion of run {run}")

    def _allow(self, complaint: str | None) -> None:
        if complaint is not None:
            raise GuardError(complaint)

    def _remember(self, request: Home | Move, answer: tuple[Moved, FtPacket]) -> tuple[Moved, FtPacket]:
        """Keep what was answered, and refuse to answer with what no sensor can read."""
        self._last, self._answer = request, answer
        self._allow(self._guard.sensing(answer[1], 0.0))
        return answer

    def _felt(self, episode: int, step: int, applied: Increment, reading: Reading) -> tuple[Moved, FtPacket]:
        number = episode * _MOTIONS_PER_EPISODE + step
        force_n, torque_nm = self._sense(reading, episode, step)
        saturated = False
        if self._counts is not None and all(map(math.isfinite, (*force_n, *torque_nm))):
            force_n, torque_nm, saturated = self._counts.quantised(force_n, torque_nm)
        t_ns = number * MOTION_NS
        moved = Moved(run=self._run, episode=episode, step=step, arrived_t_ns=t_ns, **applied._asdict())
        status = SATURATED if saturated else 0
        return moved, FtPacket(sequence=number, t_ns=t_ns, status=status, force_n=(force_n,), torque_nm=(torque_nm,))

    def _sense(self, reading: Reading, episode: int, step: int) -> tuple[Force, Torque]:
        force_error_n, torque_error_nm = self._force_error_n, self._torque_error_nm
        if force_error_n == 0.0 and torque_error_nm == 0.0:
            return reading.force_n, reading.torque_nm
        draw = generator(self._seed, Role.SENSOR_NOISE, episode, step).standard_normal(6).tolist()
        fx, fy, fz = (value + force_error_n * z for value, z in zip(reading.force_n, draw[:3], strict=True))
        tx, ty, tz = (value + torque_error_nm * z for value, z in zip(reading.torque_nm, draw[3:], strict=True))
        return (fx, fy, fz), (tx, ty, tz)


def _counts(sensor: Sensor) -> FtCounts | None:
    """Return the scale of a sensor that is read in counts, None for one that is read as it is."""
    if sensor.full_scale_n == 0:
        return None
    return FtCounts("1", (sensor.full_scale_n,) * 3 + (sensor.full_scale_dnm,) * 3)
