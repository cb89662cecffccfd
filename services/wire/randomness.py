"""Counter-based randomness: what is drawn depends on seed, role, episode and step, never on what was drawn before."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np

MAX_SEED = 2**63 - 1


class Role(IntEnum):
    """Who draws; each role has its own stream, so that two services never share numbers."""

    START_POSE = 1
    SENSOR_NOISE = 2
    POLICY = 3
    ARM_ERROR = 4
    SENSOR_MOUNT = 5
    HOLE_TILT = 6
    SENSOR_ZERO = 7
    ZERO_WALK = 8


class Draws:
    """The numbers of one role in one run. To be used by one thread at a time."""

    def __init__(self, seed: int, role: Role) -> None:
        """``seed`` is in 0..2**63-1; ValueError otherwise."""
        _check("seed", seed)
        self._philox = np.random.Philox(key=[seed, int(role)])
        self._generator = np.random.Generator(self._philox)
        # As a bit generator is that has drawn nothing: to set it costs a twentieth of making another one.
        self._place: dict[str, Any] = {"counter": (0, 0, 0, 0), "key": (seed, int(role))}
        self._state: Any = {
            "bit_generator": "Philox",
            "state": self._place,
            "buffer": (0, 0, 0, 0),
            "buffer_pos": 4,
            "has_uint32": 0,
            "uinteger": 0,
        }

    def at(self, episode: int, step: int) -> np.random.Generator:
        """Return the generator of one step of one episode, as ``generator`` does; it is good until the next call.

        ``episode`` and ``step`` are in 0..2**63-1; ValueError otherwise.
        """
        if not (0 <= episode <= MAX_SEED and 0 <= step <= MAX_SEED):
            _check("episode", episode)
            _check("step", step)
        self._place["counter"] = (0, 0, step, episode)
        self._philox.state = self._state
        return self._generator


def generator(seed: int, role: Role, episode: int, step: int) -> np.random.Generator:
    """Return the generator of one role for one step of one episode (Philox; key = seed and role).

    ``seed``, ``episode`` and ``step`` are in 0..2**63-1; ValueError otherwise. Who draws often has ``Draws``.
    """
    for name, value in (("seed", seed), ("episode", episode), ("step", step)):
        _check(name, value)
    return np.random.Generator(np.random.Philox(key=[seed, int(role)], counter=[0, 0, step, episode]))


def _check(name: str, value: int) -> None:
    if not 0 <= value <= MAX_SEED:
        raise ValueError(f"{name}: expected 0 to {MAX_SEED}, got {value}")
