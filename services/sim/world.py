"""The contact world: a peg on a compliant wrist, a hole, and the force/torque that the wrist's sensor reads.

Physics is PhysX through SAPIEN on the CPU, in millimetres, so its forces come out in mN and its torques in uN m. The
flange is a moving target; a six-axis spring (``Wrist``) ties the peg, a dynamic convex body, to it; the reading is
the spring's load. Gravity is off, as if the sensor had been zeroed with the peg in the air. While the commanded path
is clear of all material no physics runs at all: the reading is exactly zero.

The forces of an episode are a function of the definition and of the calls since ``home`` and of nothing else: not of
earlier episodes, other worlds or the process.
"""

from __future__ import annotations

import math
import warnings
from typing import NamedTuple

import numpy as np

with warnings.catch_warnings():
    # SAPIEN looks for a renderer on import and warns when there is none; none is used here.
    warnings.simplefilter("ignore")
    import sapien
    from sapien import physx

from services.rules.quaternion import multiply
from services.sim.contact_state import FREE, ContactPoint, label
from services.sim.geometry import Geometry, Vertices, geometry_of, hole_pieces, is_free_move, peg_vertices
from services.sim.pose import (
    Pose,
    Vector,
    conjugate,
    require_finite,
    rotate,
    rotation_vector,
    way,
)
from services.wire.actions import Increment
from services.wire.definition import Definition

STEP_S = 0.002
"""Time step of the physics."""
TRAVEL_MM = 0.04
"""Most the flange travels in one time step; a move of 0.2 mm takes 5."""
TRAVEL_DEG = 0.04
"""Most the flange turns in one time step."""
SETTLE_STEPS = 24
"""Most time steps after the flange has stopped; fewer when the peg stands still."""
LOOK_EVERY = 3
"""Time steps between looks at whether the peg stands still."""
STILL_MM = 2e-5
"""A peg that moved less than this between two looks stands still: the spring's 0.3 mN, far below what a sensor sees."""
STILL_TURN = 2e-6
"""The same for the components of its quaternion."""
RESPONSE_PER_S = 400.0
"""Natural frequency of the peg on its spring [rad/s]; the peg's mass and inertia follow from it and the stiffness.

A settled reading hardly depends on it. It is chosen so that the spring settles well within the time steps above.
"""
BALANCE_MM = 40.0
"""Most that the peg's centre of mass is behind its tip.

A settled reading does not depend on it either, but the solver does: with the mass far back all contacts have nearly
the same lever, and a jammed square peg was left 0.05 mm deep in the wall (docs/decisions/0007).
"""
DAMPING = 1.5
"""Damping of the spring where the sensor is, as a part of critical; the peg's sideways swing is slower and has less."""
SLERP_FACTOR = 4.0
"""PhysX's rotational drive works on the imaginary part of the quaternion, half the angle, and with half the lever: a
quarter of the stiffness asked for. Measured with known torques; ``test_torque_is_lever_times_force`` watches it.
"""
SOLVER_ITERATIONS = {"round": 30, "square": 60, "rectangle": 60, "triangle": 60}
"""A jammed square peg has eight contacts at once; a round one settles as well with 30 as with 60."""
CONTACT_OFFSET_MM = 0.03
"""Distance at which PhysX begins to watch two surfaces; a greater one costs time and changes nothing."""
SILENT_N = 0.002
SILENT_NM = 0.0002
"""A settled load below both is what the solver leaves of no contact at all: the reading is zero."""


class Reading(NamedTuple):
    """What the sensor says after a move: load on the peg by its surroundings, in the tool frame of the flange.

    Pressing the tip onto something in the direction of insertion gives a negative Z force.
    """

    force_n: Vector
    """Settled force [N], shape (3,)."""
    torque_nm: Vector
    """Settled torque [N m], shape (3,), about the point ``sensor_height_mm`` back from the tip."""


AT_REST = np.zeros(3, dtype=np.float32)
NO_LOAD = Reading((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
_new_pose = sapien.Pose.__new__


class World:
    """One peg over one hole. ``home`` begins an episode, ``move`` goes on with it."""

    def __init__(self, definition: Definition, *, _always_physics: bool = False) -> None:
        """Build the scene of ``definition.parts``, ``contact`` and ``wrist``; the peg is nowhere before ``home``.

        ``_always_physics`` switches the shortcut through free space off, for tests of the shortcut.
        """
        self._geometry = geometry_of(definition.parts)
        self._centre_mm = definition.moves.rotation_centre_mm
        self._anchor_mm = -definition.wrist.sensor_height_mm
        self._stiffness = definition.wrist.stiffness_n_per_mm * 1e3  # mN/mm
        self._stiffness_turn = definition.wrist.stiffness_nm_per_rad * 1e6  # uN m/rad
        self._always_physics = _always_physics
        self._scene, self._system, self._body, self._drive = _build(self._geometry, definition)
        self._entity = self._body.entity
        self._flange: Pose | None = None
        self._at_flange = True

    @property
    def flange(self) -> Pose:
        """Pose in the hole frame at which the flange holds the tip: where it is unless something pushes."""
        if self._flange is None:
            raise RuntimeError("world: expected home() before anything else, got none")
        return self._flange

    @property
    def peg(self) -> Pose:
        """Actual pose of the tip in the hole frame."""
        return self.flange if self._at_flange else self._pose_now()

    def contact_state(self) -> str:
        """True contact state by ``services.sim.contact_state.label``, for evaluation only."""
        if self._at_flange:
            return FREE
        points = [ContactPoint(position_mm, math.hypot(*force_n)) for position_mm, force_n in self.touching()]
        return label(points, self._geometry, self.peg)

    def touching(self) -> list[tuple[Vector, Vector]]:
        """Points where peg and hole touch, and the force [N] on the peg at each, both of shape (3,), in the hole frame.

        It is what the last time step transmitted; for evaluation only.
        """
        pairs = []
        for contact in self._system.get_contacts():
            newton = (1.0 if contact.bodies[0] == self._body else -1.0) / STEP_S * 1e-3
            for point in contact.points:
                x, y, z = point.impulse.tolist()
                pairs.append((tuple(point.position.tolist()), (newton * x, newton * y, newton * z)))
        return pairs

    def home(self, pose: Pose) -> Reading:
        """Put flange and peg at ``pose``, at rest, and begin afresh.

        Raises:
            ValueError: if a number of the pose is not finite.
        """
        require_finite("home pose", pose)
        # One time step far from the hole makes PhysX forget every contact, so no episode can remember the last one.
        self._place(Pose(0.0, 0.0, -1000.0 - 10.0 * self._geometry.depth))
        self._system.step()
        self._flange = pose
        self._at_flange = True
        return self._go(pose)

    def move(self, increment: Increment) -> Reading:
        """Move the flange by one increment in its tool frame and let the peg settle.

        Raises:
            ValueError: if a number of the increment is not finite; nothing has moved then.
            RuntimeError: before the first ``home``.
        """
        require_finite("increment", increment)
        return self._go(self.flange.moved(increment, self._centre_mm))

    def _go(self, target: Pose) -> Reading:
        """Take the flange to ``target`` and read the sensor.

        The shortcut needs the peg at its flange: one that is held off may be jammed, and only physics knows.
        """
        start = self.flange
        if self._at_flange and not self._always_physics and is_free_move(self._geometry, start, target):
            self._flange = target
            return NO_LOAD
        if self._at_flange:
            self._place(start)
        anchor = target.point(self._anchor_mm)
        self._travel(start, target, anchor)
        peg = self._settle()
        self._flange = target
        force, torque = self._load(peg, target, anchor)
        self._at_flange = math.hypot(*force) < SILENT_N and math.hypot(*torque) < SILENT_NM
        return NO_LOAD if self._at_flange else Reading(force, torque)

    def _place(self, pose: Pose) -> None:
        """Put the peg at ``pose``, at rest, with the spring relaxed."""
        body, drive = self._body, self._drive
        self._entity.set_pose(_sapien_pose(pose))
        body.set_linear_velocity(AT_REST)
        body.set_angular_velocity(AT_REST)
        drive.set_drive_velocity_target(AT_REST, AT_REST)
        drive.set_drive_target(self._anchor(pose))

    def _anchor(self, flange: Pose) -> sapien.Pose:
        """Where the flange holds the spring."""
        return _sapien_pose((*flange.point(self._anchor_mm), *flange[3:]))

    def _travel(self, start: Pose, target: Pose, anchor: Vector) -> None:
        """Take the flange from start to target, where its anchor is at ``anchor`` [mm]."""
        path = rotation_vector(multiply(target[3:], conjugate(start[3:])))
        turn_deg = math.degrees(math.hypot(*path))
        steps = max(1, math.ceil(max(math.dist(start[:3], target[:3]) / TRAVEL_MM, turn_deg / TRAVEL_DEG) - 1e-6))
        step, drive = self._system.step, self._drive
        aim, anchor_mm = drive.set_drive_target, self._anchor_mm
        x0, y0, z0 = start.point(anchor_mm)
        x1, y1, z1 = anchor
        turn_x, turn_y, turn_z = path
        duration = steps * STEP_S
        # The damper must act on the peg's speed relative to the flange, or a free peg would lag behind it.
        drive.set_drive_velocity_target(
            ((x1 - x0) / duration, (y1 - y0) / duration, (z1 - z0) / duration),
            (turn_x / duration, turn_y / duration, turn_z / duration),
        )
        for numbers in way(start, target, steps, anchor_mm):
            aim(_sapien_pose(numbers))
            step()
        aim(_sapien_pose((*anchor, *target[3:])))
        step()
        drive.set_drive_velocity_target(AT_REST, AT_REST)

    def _settle(self) -> tuple[float, ...]:
        """Step until the peg stands still, or has had the time that it needs to; return where it is."""
        step, entity = self._system.step, self._entity
        x, y, z, w, i, j, k = now = _numbers(entity)
        for _ in range(SETTLE_STEPS // LOOK_EVERY):
            for _ in range(LOOK_EVERY):
                step()
            now_x, now_y, now_z, now_w, now_i, now_j, now_k = now = _numbers(entity)
            if (
                abs(now_x - x) <= STILL_MM
                and abs(now_y - y) <= STILL_MM
                and abs(now_z - z) <= STILL_MM
                and abs(now_w - w) <= STILL_TURN
                and abs(now_i - i) <= STILL_TURN
                and abs(now_j - j) <= STILL_TURN
                and abs(now_k - k) <= STILL_TURN
            ):
                break
            x, y, z, w, i, j, k = now
        return now

    def _pose_now(self) -> Pose:
        """Pose of the peg in the physics."""
        return Pose(*_numbers(self._entity))

    def _load(self, peg: tuple[float, ...], flange: Pose, anchor: Vector) -> tuple[Vector, Vector]:
        """The spring's load: force [N] and torque [N m] on the peg by its surroundings, in the flange's tool frame.

        The peg at ``peg`` is at rest, so what the surroundings do to it is the opposite of what the spring does
        between its point and ``anchor`` [mm], that of the flange.
        """
        back, along_mm = conjugate(flange[3:]), self._anchor_mm
        px, py, pz, w, x, y, z = peg
        # The peg's point as ``Pose.point`` has it.
        apart_x = px + along_mm * (2.0 * (x * z + w * y)) - anchor[0]
        apart_y = py + along_mm * (2.0 * (y * z - w * x)) - anchor[1]
        apart_z = pz + along_mm * (1.0 - 2.0 * (x * x + y * y)) - anchor[2]
        shift_x, shift_y, shift_z = rotate(back, (apart_x, apart_y, apart_z))
        turn_x, turn_y, turn_z = rotation_vector(multiply(back, (w, x, y, z)))
        newton, newton_metre = self._stiffness * 1e-3, self._stiffness_turn * 1e-6
        force = (shift_x * newton, shift_y * newton, shift_z * newton)
        return force, (turn_x * newton_metre, turn_y * newton_metre, turn_z * newton_metre)


def _numbers(entity: sapien.Entity) -> tuple[float, ...]:
    """Return position [mm] and quaternion (w, x, y, z) of a body, shape (7,).

    A pose's state is the same seven numbers as its ``p`` and ``q``, without two arrays made on the way.
    """
    numbers: tuple[float, ...] = entity.pose.__getstate__()
    return numbers


def _sapien_pose(numbers: tuple[float, ...]) -> sapien.Pose:
    """Return the pose of position [mm] and quaternion (w, x, y, z), shape (7,): the way back, without arrays too."""
    pose = _new_pose(sapien.Pose)
    pose.__setstate__(numbers)
    return pose


def _shape(vertices: Vertices, material: physx.PhysxMaterial) -> physx.PhysxCollisionShapeConvexMesh:
    return physx.PhysxCollisionShapeConvexMesh(vertices=vertices, scale=np.ones(3, dtype=np.float32), material=material)


def _build(
    geometry: Geometry, definition: Definition
) -> tuple[sapien.Scene, physx.PhysxCpuSystem, physx.PhysxRigidDynamicComponent, physx.PhysxDriveComponent]:
    """A scene with the hole fixed in the hole frame and the peg hanging on its spring."""
    physx.set_scene_config(
        gravity=np.zeros(3, dtype=np.float32),
        # Both were measured: persistent manifolds make a peg in the bore rattle by 0.05 to 0.1 N from move to move,
        # and the temporal Gauss-Seidel solver lets friction creep; without them a resting reading stays put.
        enable_pcm=False,
        enable_tgs=False,
        enable_enhanced_determinism=True,
        enable_friction_every_iteration=True,
        cpu_workers=0,
    )
    physx.set_body_config(
        solver_position_iterations=SOLVER_ITERATIONS[definition.parts.shape],
        solver_velocity_iterations=1,
        sleep_threshold=0.0,
    )
    physx.set_shape_config(contact_offset=CONTACT_OFFSET_MM, rest_offset=0.0)
    system = physx.PhysxCpuSystem()
    scene = sapien.Scene([system])
    scene.set_timestep(STEP_S)
    friction = definition.contact.friction
    # PhysX takes a negative restitution for a spring [mN/mm] at every contact point. Where two surfaces meet it takes
    # their mean, so both get the spring of the peg's surface.
    spring = -1e3 * definition.contact.stiffness_n_per_mm if definition.contact.stiffness_n_per_mm else 0.0
    material = physx.PhysxMaterial(friction, friction, spring)

    hole = physx.PhysxRigidStaticComponent()
    for piece in hole_pieces(geometry):
        hole.attach(_shape(piece, material))
    hole_entity = sapien.Entity()
    hole_entity.add_component(hole)
    scene.add_entity(hole_entity)

    body = physx.PhysxRigidDynamicComponent()
    body.attach(_shape(peg_vertices(geometry), material))
    stiffness = definition.wrist.stiffness_n_per_mm * 1e3
    stiffness_turn = definition.wrist.stiffness_nm_per_rad * 1e6
    body.set_mass(stiffness / RESPONSE_PER_S**2)
    body.set_inertia(np.full(3, stiffness_turn / RESPONSE_PER_S**2, dtype=np.float32))
    anchor = sapien.Pose([0.0, 0.0, -definition.wrist.sensor_height_mm])
    body.set_cmass_local_pose(sapien.Pose([0.0, 0.0, -min(BALANCE_MM, definition.wrist.sensor_height_mm)]))
    body.set_linear_damping(0.0)
    body.set_angular_damping(0.0)
    entity = sapien.Entity()
    entity.add_component(body)
    drive = physx.PhysxDriveComponent(body)
    drive.set_pose_in_child(anchor)
    damping_s = DAMPING * 2.0 / RESPONSE_PER_S
    damping, damping_turn = damping_s * stiffness, damping_s * stiffness_turn
    drive.set_drive_property_x(stiffness, damping)
    drive.set_drive_property_y(stiffness, damping)
    drive.set_drive_property_z(stiffness, damping)
    drive.set_drive_property_slerp(SLERP_FACTOR * stiffness_turn, SLERP_FACTOR * damping_turn)
    entity.add_component(drive)
    scene.add_entity(entity)
    return scene, system, body, drive
