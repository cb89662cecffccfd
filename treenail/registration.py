"""Tells Gymnasium of Treenail's environment, as soon as both are loaded, whichever comes first.

``import treenail`` takes no time and must not load Gymnasium, which has to be loaded before it can be told anything.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import gymnasium

NAME = "treenail/PegInHole-v0"
LIBRARY = "gymnasium"


def when_loaded() -> None:
    """Register now where Gymnasium is loaded, else right after it will be."""
    if sys.modules.get(LIBRARY) is not None:
        register()
    else:
        sys.meta_path.insert(0, _Awaiting())


def register() -> None:
    """Register the environment; a second time changes nothing."""
    import gymnasium

    if NAME not in gymnasium.registry:
        gymnasium.register(NAME, entry_point=peg_in_hole, vector_entry_point=pegs_in_holes)


def peg_in_hole(**settings: Any) -> gymnasium.Env[Any, Any]:
    """Return the environment; what it takes is in ``treenail.gym.environment.PegInHole``."""
    _own_packages_first()
    from treenail.gym.environment import PegInHole

    return PegInHole(**settings)


def pegs_in_holes(**settings: Any) -> gymnasium.vector.VectorEnv[Any, Any, Any]:
    """Return environments in processes; what they take is in ``treenail.gym.vector.in_processes``."""
    _own_packages_first()
    from treenail.gym.vector import in_processes

    return in_processes(**settings)


class _Awaiting:
    """A finder that finds nothing itself: it is told when Gymnasium is looked for."""

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        """Return where Gymnasium is, with what is to be done after it is loaded; None for everything else."""
        if name != LIBRARY:
            return None
        sys.meta_path.remove(self)
        spec = importlib.util.find_spec(name)
        if spec is None or spec.loader is None:
            return spec
        load = spec.loader.exec_module

        def load_and_register(module: ModuleType) -> None:
            load(module)
            register()

        spec.loader.exec_module = load_and_register  # type: ignore[method-assign]
        return spec


def _own_packages_first() -> None:
    from treenail import take_own_packages

    take_own_packages()
