"""Tests of the ART2 classifier: classes, capacity, refusals, snapshots."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from services.classifier.art2 import Art2
from services.rules.plugins import Classification, ClassifierFullError
from services.wire.definition import Art2Settings

Vector = tuple[float, ...]

COMPONENT = st.floats(-10, 10).map(lambda x: round(x, 3))
VECTOR = st.tuples(*[COMPONENT] * 6).filter(lambda v: math.hypot(*v) > 0.1)
VECTORS = st.lists(VECTOR, min_size=1, max_size=15)
SETTINGS = st.builds(
    Art2Settings,
    rho=st.floats(0.3, 0.99),
    theta=st.sampled_from([0.0, 0.02, 0.05, 0.1, 0.25]),
    learning_rate=st.sampled_from([0.1, 1.0]),
    encoding=st.sampled_from(["odd", "split"]),
    capacity=st.integers(1, 20),
    torque_gain_per_m=st.just(1.0),
)
X, Y = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0, 0.0, 0.0)


def learn(network: Art2, vector: Vector) -> Classification:
    return network.learn(vector[:3], vector[3:])


def classify(network: Art2, vector: Vector) -> Classification:
    return network.classify(vector[:3], vector[3:])


def turned(angle: float) -> Vector:
    """Force of 1 N in the x-y plane at this angle [rad] to x."""
    return (math.cos(angle), math.sin(angle), 0.0, 0.0, 0.0, 0.0)


# --- Classes.


@pytest.mark.parametrize("rate", [1.0, 0.5, 0.1])
@pytest.mark.parametrize(("a", "b", "d"), [(10.0, 10.0, 0.9), (1.0, 1.0, 0.9), (10.0, 10.0, 0.5), (30.0, 5.0, 0.8)])
def test_a_class_turns_by_the_documented_part_of_a_small_angle(a: float, b: float, d: float, rate: float) -> None:
    """Settled angles, input at phi from z, u at s from z (small): w at (phi + a s)/(1 + a), p at s (1 - d).

    s (1 + b) = (phi + a s)/(1 + a) + b s (1 - d), hence s = phi / (1 + (1 + a) b d).
    """
    network = Art2(Art2Settings(a=a, b=b, d=d, theta=0.0, learning_rate=rate))
    angle = 0.02
    learn(network, X)
    assert not learn(network, turned(angle)).new
    z = network.prototypes[0]
    assert math.atan2(z[1], z[0]) == pytest.approx(rate * angle / (1 + (1 + a) * b * d), rel=1e-3)


def test_e_is_added_to_the_match_before_it_is_compared() -> None:
    """E = 0.1: ||r|| of a vector with itself is about (1 + 1) / (0.1 + 1 + 1) = 0.952, below rho, but fits with e."""
    network = Art2(Art2Settings(e=0.1, rho=0.97))
    learn(network, tuple(100 * c for c in X))
    again = learn(network, tuple(100 * c for c in X))
    assert (again.state, again.new) == (0, False)
    assert 0.94 < again.match < 0.97


def test_the_lowest_number_wins_a_tie() -> None:
    network = Art2(Art2Settings(rho=0.9))
    learn(network, Y)
    learn(network, X)
    assert learn(network, (1.0, 1.0, 0.0, 0.0, 0.0, 0.0)).state == 0


def test_a_new_class_takes_the_whole_equilibrium_whatever_the_rate() -> None:
    network = Art2(Art2Settings(learning_rate=0.1, d=0.75))
    assert learn(network, (0.0, -2.0, 0.0, 0.0, 0.0, 0.0)) == Classification(0, 1, 1.0, True)
    assert network.prototypes.tolist() == [[0.0, -4.0, 0.0, 0.0, 0.0, 0.0]]
    assert network.counts.tolist() == [1]


def test_classes_are_numbered_in_order_of_birth_and_recognised() -> None:
    network = Art2(Art2Settings())
    assert [learn(network, v).state for v in (X, Y, X, turned(0.1), turned(1.5))] == [0, 1, 0, 0, 1]
    assert network.states == 2
    assert network.counts.tolist() == [3, 2]


def test_classify_changes_nothing() -> None:
    network = Art2(Art2Settings())
    assert classify(network, X) == Classification(-1, 0, 0.0, False)
    learn(network, X)
    digest = network.digest()
    assert classify(network, X)[:2] == (0, 1)
    unknown = classify(network, Y)
    assert (unknown.state, unknown.states, unknown.new) == (-1, 1, False)
    assert 0 < unknown.match < 0.94
    assert network.digest() == digest


def test_sixteen_noisy_directions_are_found_in_both_encodings() -> None:
    """The twelve signed axes and four oblique directions, with noise of 0.05 on each component of unit vectors."""
    rng = np.random.Generator(np.random.Philox(key=7))
    s = math.sqrt(0.5)
    oblique = np.array([[s, s, 0, 0, 0, 0], [-s, -s, 0, 0, 0, 0], [0, 0, s, 0, -s, 0], [0, 0, -s, 0, s, 0]])
    directions = np.concatenate([np.eye(6), -np.eye(6), oblique])
    truth = np.concatenate([np.arange(16), rng.integers(16, size=500)])
    vectors = directions[truth] + rng.normal(size=(len(truth), 6)) * 0.05
    for encoding in ("odd", "split"):
        network = Art2(Art2Settings(rho=0.97, torque_gain_per_m=1.0, encoding=encoding))
        found = [learn(network, tuple(v)).state for v in vectors]
        assert found == truth.tolist()


def test_higher_vigilance_never_gives_fewer_classes() -> None:
    """On directions every 20 degrees round a circle, each presented three times."""
    vectors = [turned(math.radians(angle)) for angle in range(0, 360, 20)] * 3
    for encoding in ("odd", "split"):
        states = []
        for rho in (0.5, 0.7, 0.8, 0.9, 0.94, 0.96, 0.98, 0.99, 0.999):
            network = Art2(Art2Settings(rho=rho, theta=0.0, encoding=encoding))
            for vector in vectors:
                learn(network, vector)
            states.append(network.states)
        assert states == sorted(states)
        assert states[0] < 6
        assert states[-1] == 18


@given(SETTINGS, VECTORS)
@settings(deadline=None)
def test_answers_stay_in_their_ranges(parameters: Art2Settings, vectors: list[Vector]) -> None:
    network = Art2(parameters)
    states = 0
    for vector in vectors:
        answer = learn(network, vector)
        assert 0 <= answer.state < answer.states == network.states <= parameters.capacity
        assert 0 <= answer.match <= 1
        assert answer.states == states + answer.new
        states = answer.states
    assert network.prototypes.shape == (states, 6 if parameters.encoding == "odd" else 12)
    assert (np.linalg.norm(network.prototypes, axis=1) <= 10.0 * (1 + 1e-9)).all()


@given(SETTINGS, VECTOR)
@settings(deadline=None)
def test_an_input_shown_again_keeps_its_class(parameters: Art2Settings, vector: Vector) -> None:
    network = Art2(parameters)
    first = learn(network, vector)
    prototype = network.prototypes
    again = [learn(network, vector) for _ in range(5)]
    assert first.new
    assert {(a.state, a.new) for a in again} == {(0, False)}
    assert network.prototypes == pytest.approx(prototype, abs=1e-7)


@given(SETTINGS, VECTORS, st.floats(1e-3, 1e3))
@settings(deadline=None)
def test_only_the_direction_counts(parameters: Art2Settings, vectors: list[Vector], scale: float) -> None:
    # A component that lies on the threshold exactly may fall on either side of it by rounding.
    for v in vectors:
        assume(all(abs(abs(c) / math.hypot(*v) - parameters.theta) > 1e-9 or c == 0 for c in v))
    plain, scaled = Art2(parameters), Art2(parameters)
    for vector in vectors:
        expected, got = learn(plain, vector), learn(scaled, tuple(scale * c for c in vector))
        if got.state != expected.state:
            # Rounding may also choose between two classes that are equally near; then they learn apart.
            assert got.match == pytest.approx(expected.match, abs=1e-7)
            return
        assert got.match == pytest.approx(expected.match, abs=1e-7)
    assert scaled.prototypes == pytest.approx(plain.prototypes, abs=1e-6)


@given(VECTOR, st.floats(0.01, 0.99), st.sampled_from(["odd", "split"]))
@settings(deadline=None)
def test_opposite_vectors_are_different_classes(vector: Vector, rho: float, encoding: str) -> None:
    network = Art2(Art2Settings(rho=rho, encoding=encoding))  # type: ignore[arg-type]
    opposite = tuple(-c for c in vector)
    assert [learn(network, v).state for v in (vector, opposite, vector, opposite)] == [0, 1, 0, 1]


# --- Capacity.


def test_a_full_network_answers_with_the_nearest_class_and_does_not_learn_it() -> None:
    network = Art2(Art2Settings(capacity=2, when_full="nearest"))
    learn(network, X)
    learn(network, Y)
    digest = network.digest()
    answer = learn(network, (1.0, 1.5, -4.0, 0.0, 0.0, 0.0))
    assert (answer.state, answer.states, answer.new) == (1, 2, False)
    assert answer.match < 0.94
    assert learn(network, (-2.0, -1.0, 0.0, 0.0, 0.0, 0.0)).state == 1
    assert network.digest() == digest
    assert learn(network, X).state == 0
    assert network.digest() != digest


def test_a_full_network_refuses_if_told_so_and_goes_on() -> None:
    network = Art2(Art2Settings(capacity=1, when_full="refuse"))
    learn(network, X)
    digest = network.digest()
    with pytest.raises(ClassifierFullError, match=r"at most 1 .capacity.*class 0, vigilance 0.92"):
        learn(network, Y)
    assert network.digest() == digest
    assert classify(network, Y).state == -1
    assert learn(network, turned(0.05)).state == 0


# --- Refusals.


@pytest.mark.parametrize(
    ("force", "torque", "message"),
    [
        ((math.nan, 0, 0), (0, 0, 0), "force_n: expected finite"),
        ((1, 0, 0), (0, 0, math.inf), "torque_nm: expected finite"),
        ((0, 0, 0), (0, 0, 0), "norm of the force/torque vector"),
        ((1, 0), (0, 0, 0), "force_n: expected 3 components, got 2"),
        ((1, 0, 0), (0, 0, 0, 0), "torque_nm: expected 3 components, got 4"),
    ],
)
def test_bad_vectors_are_refused_and_leave_no_trace(force: Vector, torque: Vector, message: str) -> None:
    network = Art2(Art2Settings())
    learn(network, X)
    digest = network.digest()
    for present in (network.learn, network.classify):
        with pytest.raises(ValueError, match=message):
            present(force, torque)
    assert network.digest() == digest


def test_an_input_that_e_swallows_is_refused() -> None:
    """E = 0.1, |I| = 0.001: x = I / 0.101 has norm 0.0099, below theta."""
    network = Art2(Art2Settings(e=0.1))
    with pytest.raises(ValueError, match=r"above theta = 0.05 .* e = 0.1, got none .norm 0.001"):
        network.learn((0.001, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert network.states == 0


def test_thresholds_that_could_silence_a_direction_are_refused() -> None:
    """A unit vector of n equal components has components of 1/sqrt(n): 0.408 for 6 inputs, 0.289 for 12."""
    with pytest.raises(ValueError, match=r"theta: expected below 1/sqrt\(6\) = 0.4082"):
        Art2(Art2Settings(theta=0.41))
    with pytest.raises(ValueError, match=r"theta: expected below 1/sqrt\(12\) = 0.2887"):
        Art2(Art2Settings(theta=0.3, encoding="split"))
    assert Art2(Art2Settings(theta=0.4)).learn((1, 1, 1), (0.1, 0.1, 0.1)).new


# --- Snapshots.


@given(SETTINGS, VECTORS, VECTORS)
@settings(deadline=None)
def test_a_restored_network_continues_bit_for_bit(
    parameters: Art2Settings, before: list[Vector], after: list[Vector]
) -> None:
    original, restored = Art2(parameters), Art2(parameters)
    for vector in before:
        learn(original, vector)
    for vector in after:
        learn(restored, vector)  # whatever it knew must be gone
    snapshot = original.snapshot()
    restored.restore(snapshot)
    assert restored.digest() == original.digest()
    assert [learn(restored, v) for v in after] == [learn(original, v) for v in after]
    assert restored.digest() == original.digest()
    assert restored.snapshot() == original.snapshot()
    original.restore(snapshot)
    assert original.snapshot() == snapshot


def test_prototypes_and_counts_are_copies() -> None:
    network = Art2(Art2Settings())
    learn(network, X)
    digest = network.digest()
    network.prototypes[:] = 0
    network.counts[:] = 0
    assert network.digest() == digest


def test_digest_sees_every_part() -> None:
    """Same classes and counts from different vectors, and the same vectors shown once more."""
    digests = set()
    for vectors in ([], [X], [Y], [X, X], [X, Y], [Y, X]):
        network = Art2(Art2Settings())
        for vector in vectors:
            learn(network, vector)
        digests.add(network.digest())
    assert len(digests) == 6


Snapshot = dict[str, object]


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda s: s.pop("counts"), "expected keys .* got .'inputs', 'states', 'weights'."),
        (lambda s: s.update(extra=1), "expected keys"),
        (lambda s: s.update(states=3), r"weights: expected 144 bytes, got 96"),
        (lambda s: s.update(states=201), r"states: expected an integer from 0 to 200 .capacity., got 201"),
        (lambda s: s.update(states=-1), "states: expected"),
        (lambda s: s.update(states=True), "states: expected"),
        (lambda s: s.update(states=2.0), "states: expected"),
        (lambda s: s.update(inputs=12), "inputs: expected 6"),
        (lambda s: s.update(weights="text"), "weights: expected 96 bytes, got str"),
        (lambda s: s.update(counts=struct.pack("<q", 1)), "counts: expected 16 bytes, got 8"),
        (lambda s: s.update(counts=struct.pack("<2q", 1, 0)), r"counts: expected at least 1 .* got \[1, 0\]"),
        (lambda s: s.update(weights=struct.pack("<12d", *[1.0] * 11, math.nan)), "weights: expected finite"),
        (lambda s: s.update(weights=struct.pack("<12d", *[1.0] * 11, math.inf)), "weights: expected finite"),
        (lambda s: s.update(weights=struct.pack("<12d", *[1.0] * 11, 1e3)), "weights: expected norms"),
        (lambda s: s.update(weights=bytes(96)), "weights: expected norms above 0"),
    ],
)
def test_damaged_snapshots_are_refused_and_change_nothing(damage: Callable[[Snapshot], object], message: str) -> None:
    network = Art2(Art2Settings())
    learn(network, X)
    learn(network, Y)
    digest = network.digest()
    snapshot: Snapshot = {**network.snapshot()}
    damage(snapshot)
    with pytest.raises(ValueError, match=f"ART2 snapshot.*{message}"):
        network.restore(snapshot)
    assert network.digest() == digest
