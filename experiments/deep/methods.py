"""The deep learners: algorithms of stable-baselines3, as they come and with what a tuning chose."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias

import msgspec

from services.wire.errors import TreenailError

Algorithm: TypeAlias = Literal["DQN", "PPO", "SAC", "RecurrentPPO"]


class Method(msgspec.Struct, frozen=True, eq=False):
    """One learner."""

    name: str
    algorithm: Algorithm
    settings: dict[str, float | int] = {}
    """Of the algorithm; what is not named is as the library has it."""
    scaled: bool = False
    """Whether observation and reward are divided by their running spread (``VecNormalize``)."""
    history: int = 0
    """Wrenches of so many decisions before are observed along."""

    @property
    def continuous(self) -> bool:
        """Whether it chooses any increment rather than a move of the list."""
        return self.algorithm == "SAC"

    @property
    def about(self) -> str:
        """What sets it apart, in words."""
        words = [f"{name} {value:g}" for name, value in self.settings.items()]
        words += ["observation and reward scaled"] * self.scaled
        words += [f"{self.history + 1} wrenches observed"] * (self.history > 0)
        return f"{self.algorithm}, {', '.join(words) or 'as it comes'}"


DEFAULTS = (
    Method("dqn", "DQN"),
    Method("ppo", "PPO"),
    Method("sac", "SAC"),
    Method("recurrent-ppo", "RecurrentPPO"),
)
TRIED = (
    Method("dqn-a", "DQN", {"learning_rate": 1e-3, "target_update_interval": 500, "gamma": 0.9}, scaled=True),
    Method("dqn-b", "DQN", {"learning_rate": 1e-3, "target_update_interval": 200, "train_freq": 1}, scaled=True),
    Method(
        "dqn-c",
        "DQN",
        {"learning_rate": 1e-3, "target_update_interval": 500, "gamma": 0.9, "exploration_final_eps": 0.01},
        scaled=True,
        history=2,
    ),
    Method("ppo-a", "PPO", {"n_steps": 256, "learning_rate": 1e-3}, scaled=True),
    Method("ppo-b", "PPO", {"n_steps": 256, "learning_rate": 1e-3, "gamma": 0.9}, scaled=True),
    Method("ppo-c", "PPO", {"n_steps": 128, "learning_rate": 1e-3, "gamma": 0.9}, scaled=True, history=2),
    Method("sac-a", "SAC", {"learning_rate": 1e-3}, scaled=True),
    Method("sac-b", "SAC", {"learning_rate": 1e-3, "gamma": 0.9}, scaled=True),
    Method("recurrent-ppo-a", "RecurrentPPO", {"n_steps": 256, "learning_rate": 1e-3}, scaled=True),
    Method("recurrent-ppo-b", "RecurrentPPO", {"n_steps": 256, "learning_rate": 1e-3, "gamma": 0.9}, scaled=True),
)
"""Settings that `treenail deep --tune` tries, on seeds of its own."""
CHOSEN = {"dqn-tuned": "dqn-a", "ppo-tuned": "ppo-b", "sac-tuned": "sac-b", "recurrent-ppo-tuned": "recurrent-ppo-b"}
"""Which of them did best there."""


def _tuned() -> tuple[Method, ...]:
    tried = {method.name: method for method in TRIED}
    return tuple(msgspec.structs.replace(tried[chosen], name=name) for name, chosen in CHOSEN.items())


METHODS = (*DEFAULTS, *_tuned())
"""The rows of the page."""


def methods(names: Sequence[str] | None) -> tuple[Method, ...]:
    """Return the methods of these names, in the page's order; all for None. Raises TreenailError."""
    by_name = {method.name: method for method in METHODS}
    for name in names or ():
        if name not in by_name:
            raise TreenailError(f"--methods: expected some of {', '.join(by_name)}, got {name!r}")
    return tuple(method for method in METHODS if names is None or method.name in names)
