"""The rivals that are taught before the first insertion and then learn no more, by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from experiments.evaluate.controllers import Controller
from experiments.rivals.knowledge_base import ArtmapController
from experiments.rivals.networks import asada, howarth
from experiments.rivals.normals import NormalsController
from services.wire.definition import Definition

Teach = Callable[[Definition, int], Controller]
"""Makes the controller of a task and a seed, and teaches it."""
TAUGHT: Mapping[str, Teach] = {
    "asada": asada,
    "howarth": howarth,
    "artmap": lambda definition, _seed: ArtmapController(definition),
    "art-normals": lambda definition, _seed: NormalsController(definition),
}
