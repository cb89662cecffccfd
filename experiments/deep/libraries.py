"""The libraries that this study needs and nothing else does: whether they are there, and which versions."""

from __future__ import annotations

import importlib.util
from importlib.metadata import version

from services.wire.errors import TreenailError

LIBRARIES = {
    "gymnasium": "gymnasium",
    "torch": "torch",
    "stable_baselines3": "stable-baselines3",
    "sb3_contrib": "sb3-contrib",
}
"""Modules, and what each is called where it is installed from."""
REQUIREMENTS = "experiments/deep/requirements.txt"


def require() -> None:
    """See that all are there, without loading them. Raises TreenailError."""
    missing = [name for module, name in LIBRARIES.items() if importlib.util.find_spec(module) is None]
    if missing:
        raise TreenailError(
            f"expected {', '.join(LIBRARIES.values())}, got no {', '.join(missing)}; in Treenail's folder: "
            f"pip install '.[gym,sim,classifier,cli]' -r {REQUIREMENTS}"
        )


def versions() -> dict[str, str]:
    """Return the version of each, on which the numbers depend too."""
    return {name: version(name) for name in LIBRARIES.values()}
