"""Several environments, each in a process of its own."""

from __future__ import annotations

from typing import Any

from gymnasium.vector import AsyncVectorEnv, AutoresetMode

from services.rules.command_line import safe_path
from services.wire.errors import TreenailError
from treenail.registration import NAME, peg_in_hole

MOST = 256


def in_processes(
    num_envs: int,
    *,
    autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
    start_method: str = "spawn",
    shared_memory: bool = True,
    **settings: Any,
) -> AsyncVectorEnv:
    """Return ``num_envs`` environments with the same settings; ``reset(seed=s)`` gives them the seeds s, s + 1, ...

    An environment whose episode is over begins the next one with the step after (``AutoresetMode.NEXT_STEP``), unless
    ``autoreset_mode`` says otherwise; ``metadata`` says which it is. Processes are begun afresh (``spawn``): physics
    and Zenoh do not outlive a fork. A script needs no ``if __name__ == "__main__"``: they do not run it again.
    """
    if not 1 <= num_envs <= MOST:
        raise TreenailError(f"{NAME}: num_envs: expected 1 to {MOST}, got {num_envs}")
    with safe_path():
        return AsyncVectorEnv(
            [_Maker(settings)] * num_envs,
            shared_memory=shared_memory,
            context=start_method,
            autoreset_mode=autoreset_mode,
        )


class _Maker:
    """Makes one environment; in a class, so that it can be sent to a process."""

    def __init__(self, settings: dict[str, Any]) -> None:
        self._settings = settings

    def __call__(self) -> Any:
        return peg_in_hole(**self._settings)
