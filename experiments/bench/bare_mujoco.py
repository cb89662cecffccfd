"""The same peg and hole as a bare MuJoCo scene, for ``bench sim``: what another physics takes, with nothing round it.

The same convex pieces, friction, masses and springs, the same to and fro, and as many time steps of the same length a
move as ``bare_physics`` makes. No force is read and nothing is waited for; its forces are not to be believed.
"""

from __future__ import annotations

import time
from typing import Any

from experiments.bench.bare_physics import PRESSED_MM, RESPONSE_PER_S, STEP_S, STEPS
from services.sim.geometry import geometry_of, hole_pieces, peg_vertices
from services.wire.definition import Definition
from services.wire.errors import TreenailError

M_PER_MM = 1e-3


def moves_per_s(definition: Definition, moves: int) -> float:
    """Return how many lateral moves in contact a bare loop makes in a second.

    Raises ImportError where MuJoCo is not installed, TreenailError without contact.
    """
    import mujoco

    model = _scene(mujoco, definition).compile()
    data = mujoco.MjData(model)
    aside_m = definition.parts.peg_width_mm / 2 * M_PER_MM
    data.qpos[:3] = aside_m, 0.0, -PRESSED_MM * M_PER_MM
    model.qpos_spring[2] = PRESSED_MM * M_PER_MM
    ends = [aside_m + shift * M_PER_MM for shift in (0.0, definition.moves.lateral_mm)]
    began = time.perf_counter()
    for n in range(moves):
        model.qpos_spring[0] = ends[n % 2]
        mujoco.mj_step(model, data, STEPS)
    seconds = time.perf_counter() - began
    if not data.ncon:
        raise TreenailError("bench: expected the peg to touch in the bare MuJoCo scene, it does not")
    return moves / seconds


def _scene(mujoco: Any, definition: Definition) -> Any:
    """Return the specification of the scene, in metres; the peg on three springs along the axes and one about them."""
    geometry, spec = geometry_of(definition.parts), mujoco.MjSpec()
    spec.option.timestep, spec.option.gravity = STEP_S, [0.0, 0.0, 0.0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    along, about = definition.wrist.stiffness_n_per_mm / M_PER_MM, definition.wrist.stiffness_nm_per_rad
    peg = spec.worldbody.add_body(name="peg", mass=along / RESPONSE_PER_S**2, inertia=[about / RESPONSE_PER_S**2] * 3)
    peg.explicitinertial = True
    for axis in ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]):
        kind, damping = mujoco.mjtJoint.mjJNT_SLIDE, 2.0 * along / RESPONSE_PER_S
        peg.add_joint(type=kind, axis=axis, stiffness=along, damping=damping)
    peg.add_joint(type=mujoco.mjtJoint.mjJNT_BALL, stiffness=about, damping=2.0 * about / RESPONSE_PER_S)
    bodies = ((spec.worldbody, hole_pieces(geometry)), (peg, [peg_vertices(geometry)]))
    for place, (body, pieces) in enumerate(bodies):
        for number, vertices in enumerate(pieces):
            name = f"{place}-{number}"
            spec.add_mesh(name=name, uservert=(vertices * M_PER_MM).ravel())
            friction = [definition.contact.friction, 0.0, 0.0]
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, friction=friction, condim=3)
    return spec
