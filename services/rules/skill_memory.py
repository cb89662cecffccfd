"""What a skill's memories must look like, so that whoever passes one on knows that the workers can load it."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from services.wire.actions import lines as lines_of
from services.wire.definition import Art2Settings, Moves
from services.wire.errors import BadPayloadError
from services.wire.text import one_line

_ITEM_BYTES = 8
_LARGEST_VALUE = 1e12
_LARGEST_VERSION = 2**53
_AGENT = ("actions", "q", "states", "version", "visits")
_MODEL = ("covariances", "features", "lines", "theta")
_SEARCHED = ("search_found", "search_tried")
_IN_A_ROW = "in_a_row"
_MOST_FEATURES = 1000
_WIDEST = 101
"""Most places along a side of what a search has looked at: 50 moves each way."""
_CLASSIFIER = ("counts", "inputs", "states", "weights")

Memory = Mapping[str, bytes | int]


def check_felt(memory: Memory, moves: Moves) -> int:
    """Return the number of states in the memory of a felt learner. Raises BadPayloadError."""
    searched = any(name in memory for name in _SEARCHED)
    in_a_row = (_IN_A_ROW,) if _IN_A_ROW in memory else ()
    _check_names(memory, (*_AGENT, *_MODEL, *(_SEARCHED if searched else ()), *in_a_row), "agent")
    if searched:
        _check_searched(memory)
    if in_a_row and number(memory, _IN_A_ROW) > _LARGEST_VERSION:
        raise BadPayloadError(f"skill: agent: expected {_IN_A_ROW} up to {_LARGEST_VERSION}, got more")
    lines, features = 1 + max(lines_of(moves)[0]), number(memory, "features")
    if number(memory, "lines") != lines or not 0 < features <= _MOST_FEATURES:
        raise BadPayloadError(f"skill: agent: expected a model of {lines} lines, got another")
    halves = features * (features + 1) // 2
    for name, items in (("theta", lines * features), ("covariances", lines * halves)):
        values = np.frombuffer(_block(memory, name, items), "<f8")
        if not (np.abs(values) <= _LARGEST_VALUE).all():
            raise BadPayloadError(f"skill: agent: expected {name} within {_LARGEST_VALUE:g}, got others")
    # The diagonal of an upper half, row by row: each row is one shorter than that before.
    diagonal = np.cumsum([0, *range(features, 1, -1)])
    if (values.reshape(lines, halves)[:, diagonal] < 0.0).any():
        raise BadPayloadError("skill: agent: expected variances of 0 or more, got less")
    return check_agent({name: memory[name] for name in _AGENT}, moves.count)


def check_agent(memory: Memory, actions: int) -> int:
    """Return the number of states in the table of a learner with so many actions. Raises BadPayloadError."""
    _check_names(memory, _AGENT, "agent")
    states, version = number(memory, "states"), number(memory, "version")
    if number(memory, "actions") != actions:
        raise BadPayloadError(f"skill: agent: expected {actions} actions, got {memory['actions']!r}")
    q = np.frombuffer(_block(memory, "q", states * actions), "<f8").reshape(states, actions)
    visits = np.frombuffer(_block(memory, "visits", states * actions), "<i8").reshape(states, actions)
    if not (np.abs(q) <= _LARGEST_VALUE).all():
        raise BadPayloadError(f"skill: agent: expected action values within {_LARGEST_VALUE:g}, got others")
    if version > _LARGEST_VERSION or ((visits < 0) | (visits > version)).any() or int(visits.sum()) != version:
        raise BadPayloadError(f"skill: agent: expected visits that add up to version {version}, got others")
    if states > 0 and not visits[-1].any():
        raise BadPayloadError(f"skill: agent: expected visits in the last of {states} states, got none")
    return states


def check_classifier(memory: Memory, settings: Art2Settings) -> int:
    """Return the number of classes in the memory of a classifier with these settings. Raises BadPayloadError."""
    _check_names(memory, _CLASSIFIER, "classifier")
    states, inputs = number(memory, "states"), 6 if settings.encoding == "odd" else 12
    if number(memory, "inputs") != inputs:
        raise BadPayloadError(f"skill: classifier: expected {inputs} inputs, got {memory['inputs']!r}")
    weights = np.frombuffer(_block(memory, "weights", states * inputs), "<f8").reshape(states, inputs)
    counts = np.frombuffer(_block(memory, "counts", states), "<i8")
    longest = 1 / (1 - settings.d)
    with np.errstate(over="ignore", invalid="ignore"):
        norms = np.sqrt((weights * weights).sum(axis=1))
        sound = (norms > 0) & (norms <= longest * (1 + 1e-9))
    if not sound.all():
        raise BadPayloadError(f"skill: classifier: expected prototypes of a norm above 0 and up to {longest:g}")
    if not (counts >= 1).all():
        raise BadPayloadError("skill: classifier: expected at least one presentation of each class, got none of some")
    return states


def untried(memory: Memory) -> tuple[int, ...]:
    """Return the actions in the memory of a learner of Treenail's own that were never learnt from, in any state."""
    actions, visits = number(memory, "actions"), memory["visits"]
    assert isinstance(visits, bytes)
    tried = np.frombuffer(visits, "<i8").reshape(-1, actions).any(axis=0)
    return tuple(int(action) for action in np.flatnonzero(~tried))


def number(memory: Memory, name: str) -> int:
    """Return a whole number of 0 or more from a memory. Raises BadPayloadError."""
    value = memory.get(name)
    if not isinstance(value, int) or value < 0:
        raise BadPayloadError(f"skill: {name}: expected a whole number of 0 or more, got {type(value).__name__}")
    return value


def _check_searched(memory: Memory) -> None:
    """Check the counts of a search: two squares with the start in the middle."""
    found = memory[_SEARCHED[0]]
    size = len(found) // _ITEM_BYTES if isinstance(found, bytes) else 0
    side = math.isqrt(size)
    if side * side != size or side % 2 == 0 or not 3 <= side <= _WIDEST:
        raise BadPayloadError(f"skill: agent: expected a square of odd sides as {_SEARCHED[0]}, got {size} places")
    for name in _SEARCHED:
        counts = np.frombuffer(_block(memory, name, size), "<i8")
        if (counts < 0).any() or (counts > _LARGEST_VERSION).any():
            raise BadPayloadError(f"skill: agent: expected counts of 0 or more as {name}, got others")


def _check_names(memory: Memory, expected: tuple[str, ...], whose: str) -> None:
    if sorted(memory) != sorted(expected):
        got = one_line(", ".join(sorted(memory)), 100)
        raise BadPayloadError(f"skill: {whose}: expected {', '.join(expected)}, got {got}")


def _block(memory: Memory, name: str, items: int) -> bytes:
    """Return so many eight-byte items from a memory."""
    value, size = memory[name], items * _ITEM_BYTES
    if not isinstance(value, bytes) or len(value) != size:
        got = f"{len(value)} bytes" if isinstance(value, bytes) else type(value).__name__
        raise BadPayloadError(f"skill: {name}: expected {size} bytes, got {got}")
    return value
