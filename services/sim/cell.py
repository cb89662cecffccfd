"""The simulated cell: the contact world behind the messages of a robot and a sensor, with errors, clock and guard.

What a motion gives depends on the definition, the seed, the episode's start pose and its motions so far, and on
nothing else: a cell that was killed is brought back by the same ``home`` and the same motions.

The simulator is its own sensor, so what can fail of it is the physics: a load that is no number is a sensor lost, and
nothing but ``home`` is taken then.
"""

from __future__ import annotations

from services.rules.guard import increment_of
from services.rules.hole import standing
from services.rules.motions import GuardError, Robot
from services.sim.arm import Arm
from services.sim.pose import Pose
from services.sim.sensor import SimulatedSensor
from services.sim.world import Reading, World
from services.wire.actions import Increment
from services.wire.definition import Definition
from services.wire.definition_changes import at_episode
from services.wire.low_pass import MOTION_NS as MOTION_NS
from services.wire.messages import FtPacket, Home, Move, Moved, Truth

SATURATED = 1
"""Bit of ``FtPacket.status``."""
_MOTIONS_PER_EPISODE = 2**17


class SimulatedCell:
    """Robot and sensor of one run."""

    def __init__(self, definition: Definition, run: str, seed: int, world: World | None = None) -> None:
        """Build what the definition says; ``world``, if given, is the one of its first episode."""
        self.world = World(definition) if world is None else world
        self._definition, self._seed = definition, seed
        self._settings = at_episode(definition, 0)
        """Those that the world was built with."""
        self._arm = Arm(definition.noise, seed)
        self._sensor = SimulatedSensor(definition, seed)
        self._robot = Robot(definition, run)
        self._packet: FtPacket | None = None
        """Felt after the last motion."""

    def home(self, home: Home) -> tuple[Moved, FtPacket]:
        """Put the peg at the start pose of an episode, to the arm's error; may be called at any time.

        Raises OtherRunError, and GuardError for a pose that no episode begins with or a sensor that is lost.
        """
        self._robot.home(home)
        self._change_parts(home.episode)
        pose = Pose.from_tilt(home.x_mm, home.y_mm, home.z_mm, home.rx_deg, home.ry_deg, home.rz_deg)
        executed = self._arm.executed(Increment(), home.episode, 0)
        pose = pose.moved(executed, self._definition.moves.rotation_centre_mm)
        stands = standing(self._definition.hole, self._seed, home.episode)
        # The world is the hole's: where the hole is tilted, it is the arm that comes from another direction.
        reading = self.world.home(pose if stands is None else Pose(*stands.in_hole(pose)))
        packet = self._felt(home.episode, 0, reading)
        # An episode that begins again has the numbers and times that it had before.
        self._robot.feel_anew()
        return self._answer(self._robot.homed(home, packet.t_ns), packet)

    def move(self, move: Move) -> tuple[Moved, FtPacket]:
        """Make the next motion, or answer the last one again.

        The answer is the motion as the arm believes it was made; its true error shows only in the forces.

        Raises OutOfOrderError for any other step, GuardError for a motion beyond the limits, OtherRunError for
        another run; nothing moves then. Raises GuardError also when the sensor is lost in the motion, and from then on.
        """
        # Simulated time stands still between motions, so that the sample is as old as the end of the last one.
        packet = self._packet
        now_ns = 0 if packet is None else packet.t_ns
        again = self._robot.again(move, now_ns)
        if again is not None and packet is not None:
            return again, packet
        self._robot.move(move, now_ns)
        increment = increment_of(move)
        reading = self.world.move(self._arm.executed(increment, move.episode, move.step))
        packet = self._felt(move.episode, move.step, reading)
        return self._answer(self._robot.moved(move, increment, packet.t_ns), packet)

    def _change_parts(self, episode: int) -> None:
        """Build another world when the parts of this episode are others than those of the last one."""
        settings = at_episode(self._definition, episode)
        if (settings.parts, settings.contact) != (self._settings.parts, self._settings.contact):
            self._settings = settings
            self.world = type(self.world)(settings)

    def _answer(self, moved: Moved, packet: FtPacket) -> tuple[Moved, FtPacket]:
        """Return an answer, and refuse to answer with what no sensor can read."""
        self._packet = packet
        self._robot.feel(packet, packet.t_ns)
        complaint = self._robot.sensing(packet.t_ns)
        if complaint is not None:
            raise GuardError(complaint)
        return moved, packet

    def _felt(self, episode: int, step: int, reading: Reading) -> FtPacket:
        number = episode * _MOTIONS_PER_EPISODE + step
        loads, saturated = self._sensor.samples(reading, self.world.flange, episode, step)
        forces, torques = zip(*loads, strict=True)
        return FtPacket(
            # Numbered by the last of them, so that none is numbered twice.
            sequence=(number + 1) * self._sensor.most_samples - 1,
            t_ns=number * MOTION_NS,
            status=SATURATED if saturated else 0,
            force_n=forces,
            torque_nm=torques,
        )


def truth_of(world: World, moved: Moved) -> Truth:
    """Return where flange and peg really are after a motion, for who looks on."""
    return Truth(
        run=moved.run,
        episode=moved.episode,
        step=moved.step,
        flange=world.flange,
        peg=world.peg,
        contact=world.contact_state(),
    )
