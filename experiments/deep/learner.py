"""One run of a deep learner: it learns over the episodes of a seed, and then shows what it knows."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from experiments.deep.episodes import Numbered
from experiments.deep.jobs import FROZEN, Job, Learnt, Order
from experiments.lab.pool import Tell
from experiments.leaderboard.suite import moves_expected

FADES = 0.1
"""Part of a run over which DQN's random moves become few, as the library has it."""


def work(order: Order, tell: Tell) -> Learnt:
    """Do a job, on one thread. The same job gives the same numbers on the same machine with the same libraries."""
    import torch

    torch.set_num_threads(1)
    torch.use_deterministic_algorithms(True)
    job, began_s = order.job, time.process_time()
    env = order.environment.make(
        definition=job.definition, continuous=job.method.continuous, history=job.method.history
    )
    numbered = Numbered(env, job.seed, tell)
    model = _model(job, numbered)
    # The library counts decisions; episodes end this, and as many as cannot be reached are asked for.
    model.learn(_most(job), callback=lambda _locals, _globals: numbered.over < job.episodes)
    outcome, decisions = numbered.outcome(job.episodes, time.process_time() - began_s), numbered.steps
    numbered.clear()
    began_s = time.process_time()
    while numbered.over < FROZEN:
        _show(model, numbered, job.episodes + numbered.over)
    env.close()
    return Learnt(outcome, numbered.outcome(FROZEN, time.process_time() - began_s), decisions)


def _most(job: Job) -> int:
    """Return more decisions than a run can have."""
    return (job.episodes + 1) * job.definition.limits.move_limit


def _model(job: Job, numbered: Numbered) -> Any:
    """Return the learner, before it has learnt anything."""
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    method = job.method
    place: Any = DummyVecEnv([lambda: numbered])
    if method.scaled:
        place = VecNormalize(place, gamma=method.settings.get("gamma", 0.99))
    algorithm, policy = _algorithm(method.algorithm)
    settings: dict[str, Any] = dict(method.settings)
    if method.algorithm == "DQN":
        # Random moves fade over a part of the run, which the library takes for as long as it was asked to be.
        settings["exploration_fraction"] = FADES * job.episodes * moves_expected(job.definition) / _most(job)
    return algorithm(policy, place, seed=job.seed, device="cpu", **settings)


def _algorithm(name: str) -> tuple[Any, str]:
    """Return the class, and what its network is called there."""
    if name == "RecurrentPPO":
        from sb3_contrib import RecurrentPPO

        return RecurrentPPO, "MlpLstmPolicy"
    from stable_baselines3 import DQN, PPO, SAC

    return {"DQN": DQN, "PPO": PPO, "SAC": SAC}[name], "MlpPolicy"


def _show(model: Any, numbered: Numbered, episode: int) -> None:
    """Go through an episode by what is thought best, and learn nothing."""
    scaling = model.get_vec_normalize_env()
    felt, _ = numbered.reset(options={"episode": episode})
    memory, over = None, False
    while not over:
        seen = felt if scaling is None else scaling.normalize_obs(felt)
        begins = np.array([memory is None])
        action, memory = model.predict(seen, state=memory, episode_start=begins, deterministic=True)
        felt, _, terminated, truncated, _ = numbered.step(action)
        over = terminated or truncated
