"""A robot learns to put pegs into holes by feel: experiments from Python.

    import treenail

    results = treenail.run(treenail.load("chamfered-q-softmax"), seeds=2, episodes=100)
    results.table()  # a row an episode, for pandas.DataFrame

With Gymnasium, ``gymnasium.make("treenail/PegInHole-v0")`` is the same task for an agent of one's own. docs/python.md
has more. Loading this module takes no time; what runs experiments is loaded with the first use of it.
"""

from __future__ import annotations

import sys
from importlib.machinery import PathFinder
from importlib.util import module_from_spec
from pathlib import Path
from typing import TYPE_CHECKING

from treenail.registration import when_loaded

if TYPE_CHECKING:
    from treenail.api import (
        Definition,
        EpisodeSummary,
        Interrupted,
        Results,
        Run,
        Skill,
        TreenailError,
        load,
        read_skill,
        run,
        shipped,
    )

__all__ = [
    "Definition",
    "EpisodeSummary",
    "Interrupted",
    "Results",
    "Run",
    "Skill",
    "TreenailError",
    "load",
    "read_skill",
    "run",
    "shipped",
]


def __getattr__(name: str) -> object:
    """Load what is asked for. Raises AttributeError."""
    if name not in __all__:
        raise AttributeError(f"module 'treenail' has no attribute {name!r}; it has {', '.join(__all__)}")
    take_own_packages()
    from treenail import api

    return getattr(api, name)


def __dir__() -> list[str]:
    return __all__


def take_own_packages() -> None:
    """Load the packages beside this one, also where a folder of the caller's has the name of one of them.

    Raises ImportError when theirs is loaded already.
    """
    root = Path(__file__).resolve().parent.parent
    for name in ("services", "experiments"):
        if name not in sys.modules:
            spec = PathFinder.find_spec(name, [str(root)])
            if spec is None or spec.loader is None:
                raise ImportError(f"treenail: expected its package {name} in {root}, got none")
            sys.modules[name] = module_from_spec(spec)
            spec.loader.exec_module(sys.modules[name])
        file = sys.modules[name].__file__
        if file is None or Path(file).resolve().parent.parent != root:
            raise ImportError(
                f"treenail: expected its own package {name}, got the one of {file or 'a bare folder'};"
                " import treenail before it, or give it another name"
            )


when_loaded()
