"""``bench env``: steps a second of the Gymnasium environment, beside other peg-in-hole environments that are installed.

All are driven by random actions, one after the other in every round, each with its own physics and its own idea of a
step: a step of ours is a decision with all the guidance before it, one of theirs a control period. What is not
installed, or does not start, is named with the reason.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from typing import Any

from experiments.bench.values import Value, spread
from services.wire.errors import TreenailError

OURS = "treenail/PegInHole-v0"
MANISKILL = "ManiSkill PegInsertionSide-v1"
ROBOSUITE = "robosuite NutAssemblyRound"


def measure(experiment: str, overrides: Sequence[str], steps: int, seed: int, rounds: int) -> dict[str, Value]:
    """Measure ours, with listed moves and with any, and the others; each is made once. Raises TreenailError."""
    made: dict[str, Any] = {
        f"{OURS}, {kind}": _ours(experiment, overrides, continuous)
        for kind, continuous in (("listed moves", False), ("any moves", True))
    }
    absent: dict[str, Value] = {}
    for name, make in ((MANISKILL, _maniskill), (ROBOSUITE, _robosuite)):
        try:
            made[name] = make()
        except Exception as error:  # whatever somebody else's package says about this machine
            absent[name] = f"not measured: {type(error).__name__}: {' '.join(str(error).split())[:120]}"
    rates: dict[str, list[float]] = {name: [] for name in made}
    try:
        for number in range(rounds):
            for name, env in made.items():
                rates[name].append(_steps_per_s(env, steps, seed + number))
    finally:
        for env in made.values():
            env.close()
    return {
        "rounds": rounds,
        "steps": steps,
        "steps_per_s": {name: spread(values) for name, values in rates.items()},
        "others": absent or "all measured",
    }


def _steps_per_s(env: Any, steps: int, seed: int) -> float:
    """Return how fast an environment takes random actions; resets count as time, not as steps."""
    env.action_space.seed(seed)
    env.reset(seed=seed)
    began = time.perf_counter()
    for _ in range(steps):
        *_, terminated, truncated, _ = env.step(env.action_space.sample())
        if terminated or truncated:
            env.reset()
    return steps / (time.perf_counter() - began)


def _ours(experiment: str, overrides: Sequence[str], continuous: bool) -> Any:
    import gymnasium

    try:
        return gymnasium.make(OURS, definition=experiment, overrides=overrides, continuous=continuous)
    except gymnasium.error.NameNotFound as error:
        raise TreenailError(f"bench env: expected {OURS} to be registered, as in `treenail bench env`") from error


def _maniskill() -> Any:
    """Return ManiSkill's insertion on the CPU, for states, without pictures."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import gymnasium
        import mani_skill.envs  # noqa: F401  # registers

        settings: dict[str, Any] = {"obs_mode": "state", "sim_backend": "cpu", "render_backend": "none"}
        return gymnasium.make("PegInsertionSide-v1", num_envs=1, **settings)


def _robosuite() -> Any:
    """Return robosuite's nut on a peg, without pictures, as a Gymnasium environment."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import robosuite
        from robosuite.wrappers import GymWrapper

        settings = {"has_renderer": False, "has_offscreen_renderer": False, "use_camera_obs": False}
        return GymWrapper(robosuite.make("NutAssemblyRound", robots="Panda", **settings))
