"""What a classifier with prototypes remembers, as plain bytes: packed, checked, named by its digest."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

_KEYS = {"states", "inputs", "weights", "counts"}
_ITEM_BYTES = 8

Weights = NDArray[np.float64]
Counts = NDArray[np.int64]


def pack(weights: Weights, counts: Counts) -> dict[str, bytes | int]:
    """Return weights, shape (states, inputs), and presentations per class, shape (states,), in plain types.

    ``weights`` becomes little-endian float64, row by row; ``counts`` little-endian int64.
    """
    return {
        "states": weights.shape[0],
        "inputs": weights.shape[1],
        "weights": weights.astype("<f8").tobytes(),
        "counts": counts.astype("<i8").tobytes(),
    }


def unpack(snapshot: Mapping[str, object], shape: tuple[int, int], who: str) -> tuple[Weights, Counts]:
    """Return weights and counts of a snapshot of ``pack``; ``shape`` is (capacity, inputs) of who is to take it.

    Raises:
        ValueError: unknown or missing keys, a wrong type, size or number of inputs, more classes than the capacity,
            weights that are not finite, a count below 1. The message begins with ``who``.
    """
    if set(snapshot) != _KEYS:
        raise ValueError(f"{who} snapshot: expected keys {sorted(_KEYS)}, got {sorted(map(str, snapshot))}")
    capacity, inputs = shape
    states = snapshot["states"]
    if type(states) is not int or not 0 <= states <= capacity:
        raise ValueError(f"{who} snapshot states: expected an integer from 0 to {capacity} (capacity), got {states!r}")
    if type(snapshot["inputs"]) is not int or snapshot["inputs"] != inputs:
        raise ValueError(f"{who} snapshot inputs: expected {inputs}, as the encoding has, got {snapshot['inputs']!r}")
    weights = np.frombuffer(_bytes_of(snapshot, "weights", states * inputs, who), "<f8").reshape(states, inputs)
    counts = np.frombuffer(_bytes_of(snapshot, "counts", states, who), "<i8")
    if not np.isfinite(weights).all():
        raise ValueError(f"{who} snapshot weights: expected finite numbers, got some that are not")
    if not (counts >= 1).all():
        raise ValueError(f"{who} snapshot counts: expected at least 1 for each class, got {counts.tolist()}")
    return weights.astype(np.float64), counts.astype(np.int64)


def digest(weights: Weights, counts: Counts) -> str:
    """Return the SHA-256 in hex over number of classes (int64), weights and counts, all little-endian."""
    states = len(weights).to_bytes(_ITEM_BYTES, "little")
    return hashlib.sha256(states + weights.astype("<f8").tobytes() + counts.astype("<i8").tobytes()).hexdigest()


def _bytes_of(snapshot: Mapping[str, object], key: str, items: int, who: str) -> bytes:
    """The bytes under a key, which must hold that many eight-byte items."""
    value = snapshot[key]
    if not isinstance(value, bytes) or len(value) != items * _ITEM_BYTES:
        got = f"{len(value)} bytes" if isinstance(value, bytes) else type(value).__name__
        raise ValueError(f"{who} snapshot {key}: expected {items * _ITEM_BYTES} bytes, got {got}")
    return value
