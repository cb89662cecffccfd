"""Counter-based randomness: what is drawn depends on seed, role, episode and step, never on what was drawn before."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

MAX_SEED = 2**63 - 1


class Role(IntEnum):
    """Who draws; each role has its own stream, so that two services never share numbers."""

    START_POSE = 1
    SENSOR_NOISE = 2
    POLICY = 3
    ARM_ERROR = 4
    SENSOR_MOUNT = 5


def generator(seed: int, role: Role, episode: int, step: int) -> np.random.Generator:
    """Return the generator of one role for one step of one episode (Philox; key = seed and role).

    ``seed``, ``episode`` and ``step`` are in 0..2**63-1; ValueError otherwise.
    """
    for name, value in (("seed", seed), ("episode", episode), ("step", step)):
        if not 0 <= value <= MAX_SEED:
            raise ValueError(f"{name}: expected 0 to {MAX_SEED}, got {value}")
    return np.random.Generator(np.random.Philox(key=[seed, int(role)], counter=[0, 0, step, episode]))
