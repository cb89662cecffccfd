"""Tests of the input encoding of the classifier."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.classifier.encoding import encode, input_count

COMPONENT = st.floats(-100, 100).map(lambda x: round(x, 6))
TRIPLE = st.tuples(COMPONENT, COMPONENT, COMPONENT)


def test_odd_encoding_scales_the_torque_and_keeps_signs() -> None:
    assert encode((1, -2, 3), (0.1, -0.5, 0), 10.0, "odd").tolist() == [1.0, -2.0, 3.0, 1.0, -5.0, 0.0]


def test_split_encoding_gives_positive_parts_then_negative_parts() -> None:
    expected = [1.0, 0.0, 3.0, 0.5, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 2.5, 0.0]
    assert encode((1, -2, 3), (0.1, -0.5, 0), 5.0, "split").tolist() == expected


def test_split_encoding_has_one_zero_only() -> None:
    encoded = encode((-0.0, 1.0, -1.0), (-0.0, 0.0, 0.0), 1.0, "split")
    assert not np.signbit(encoded).any()


@pytest.mark.parametrize("encoding", ["odd", "split"])
def test_encoded_length_is_the_announced_one(encoding: str) -> None:
    assert encode((1, 0, 0), (0, 0, 0), 1.0, encoding).shape == (input_count(encoding),)  # type: ignore[arg-type]


@given(TRIPLE, TRIPLE, st.floats(0.01, 100))
def test_split_is_odd_in_two_halves_of_equal_norm(
    force: tuple[float, float, float], torque: tuple[float, float, float], gain: float
) -> None:
    if not any(force) and not any(torque):
        force = (1.0, 0.0, 0.0)
    odd, split = encode(force, torque, gain, "odd"), encode(force, torque, gain, "split")
    assert (split >= 0).all()
    assert (split[:6] - split[6:] == odd).all()
    assert (split[:6] * split[6:] == 0).all()


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
@pytest.mark.parametrize("name", ["force_n", "torque_nm"])
def test_refuses_what_is_not_finite_and_names_it(name: str, value: float) -> None:
    good, bad = (1.0, 2.0, 3.0), (0.0, value, 0.0)
    with pytest.raises(ValueError, match=rf"{name}: expected finite components, got {value} for y"):
        encode(bad if name == "force_n" else good, bad if name == "torque_nm" else good, 10.0, "odd")


@pytest.mark.parametrize("length", [0, 2, 4, 6])
def test_refuses_wrong_lengths(length: int) -> None:
    with pytest.raises(ValueError, match=f"force_n: expected 3 components, got {length}"):
        encode([1.0] * length, (0, 0, 0), 10.0, "odd")
    with pytest.raises(ValueError, match=f"torque_nm: expected 3 components, got {length}"):
        encode((1, 0, 0), [1.0] * length, 10.0, "odd")


@pytest.mark.parametrize("force", [(0, 0, 0), (1e-200, 0, 0), (1e200, 0, 0), (1.7e308, 1.7e308, 1.7e308)])
def test_refuses_vectors_without_a_usable_norm(force: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="norm of the force/torque vector"):
        encode(force, (0, 0, 0), 10.0, "split")


def test_torque_alone_is_zero_when_its_gain_is_zero() -> None:
    with pytest.raises(ValueError, match="got 0"):
        encode((0, 0, 0), (1, 2, 3), 0.0, "odd")


def test_accepts_arrays() -> None:
    assert encode(np.array([1.0, 2.0, 3.0]), np.zeros(3), 1.0, "odd")[2] == 3.0  # type: ignore[arg-type]
