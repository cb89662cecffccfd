"""The same peg and hole as a bare SAPIEN scene, for ``bench sim``: what the physics takes with nothing round it.

PhysX's own settings, the peg on a drive, its target going to and fro, ``STEPS`` time steps a move as the contact world
takes them at most. No force is read and nothing is waited for; its forces are not to be believed.
"""

from __future__ import annotations

import time
import warnings

with warnings.catch_warnings():
    # SAPIEN looks for a renderer on import and warns when there is none; none is used here.
    warnings.simplefilter("ignore")
    import sapien
    from sapien import physx

from services.sim.geometry import geometry_of, hole_pieces, peg_vertices
from services.wire.definition import Definition
from services.wire.errors import TreenailError

STEPS = 25
STEP_S = 0.002
RESPONSE_PER_S = 400.0
PRESSED_MM = 0.2
"""How far the drive's target is below where the peg comes to lie on the flat top, beside the hole."""


def moves_per_s(definition: Definition, moves: int) -> float:
    """Return how many lateral moves in contact a bare loop makes in a second. Raises TreenailError without contact."""
    _kept, system, drive = _scene(definition)
    # One radius aside the tip lies on the chamfer or on the top, whatever the shape.
    aside_mm, size_mm = definition.parts.peg_width_mm / 2, definition.moves.lateral_mm
    ends = [sapien.Pose([aside_mm + shift, 0.0, PRESSED_MM]) for shift in (0.0, size_mm)]
    began = time.perf_counter()
    for n in range(moves):
        drive.set_drive_target(ends[n % 2])
        for _ in range(STEPS):
            system.step()
    seconds = time.perf_counter() - began
    if not system.get_contacts():
        raise TreenailError("bench: expected the peg to touch in the bare scene, it does not")
    return moves / seconds


def _scene(definition: Definition) -> tuple[sapien.Scene, physx.PhysxCpuSystem, physx.PhysxDriveComponent]:
    geometry = geometry_of(definition.parts)
    physx.set_scene_config(gravity=[0.0, 0.0, 0.0], cpu_workers=0)
    system = physx.PhysxCpuSystem()
    scene = sapien.Scene([system])
    scene.set_timestep(STEP_S)
    friction = definition.contact.friction
    material = physx.PhysxMaterial(friction, friction, 0.0)
    hole, peg = physx.PhysxRigidStaticComponent(), physx.PhysxRigidDynamicComponent()
    for body, pieces in ((hole, hole_pieces(geometry)), (peg, [peg_vertices(geometry)])):
        for piece in pieces:
            body.attach(physx.PhysxCollisionShapeConvexMesh(vertices=piece, scale=[1.0, 1.0, 1.0], material=material))
    stiffness, turning = definition.wrist.stiffness_n_per_mm * 1e3, definition.wrist.stiffness_nm_per_rad * 1e6
    peg.set_mass(stiffness / RESPONSE_PER_S**2)
    peg.set_inertia([turning / RESPONSE_PER_S**2] * 3)
    drive = physx.PhysxDriveComponent(peg)
    for set_drive in (drive.set_drive_property_x, drive.set_drive_property_y, drive.set_drive_property_z):
        set_drive(stiffness, 2.0 * stiffness / RESPONSE_PER_S)
    drive.set_drive_property_slerp(turning, 2.0 * turning / RESPONSE_PER_S)
    for components in ((hole,), (peg, drive)):
        entity = sapien.Entity()
        for component in components:
            entity.add_component(component)
        scene.add_entity(entity)
    peg.entity.set_pose(sapien.Pose([definition.parts.peg_width_mm / 2, 0.0, -PRESSED_MM]))
    return scene, system, drive
