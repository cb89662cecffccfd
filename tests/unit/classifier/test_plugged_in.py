"""The classifiers that are plug-ins: what every one of them promises, and what Fuzzy ART does with simple vectors."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pytest

from services.classifier.art2a import Art2A
from services.classifier.fold import classifier_of
from services.classifier.fuzzy_art import FuzzyArt
from services.rules.plugins import Classifier, ClassifierFullError
from services.wire.definition import Plugin, Setting

KINDS: dict[str, Callable[[Mapping[str, Setting]], Classifier]] = {"fuzzy-art": FuzzyArt, "art2a": Art2A}
NO_TORQUE = (0.0, 0.0, 0.0)
AXES = [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)]
Kind = Callable[[Mapping[str, Setting]], Classifier]

pytest.importorskip("artlib")


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> Kind:
    return KINDS[request.param]


def vectors(count: int, seed: int = 3) -> list[tuple[list[float], list[float]]]:
    draw = np.random.Generator(np.random.Philox(key=seed)).standard_normal((count, 6))
    return [(row[:3].tolist(), row[3:].tolist()) for row in draw]


def test_directions_of_both_signs_are_classes_of_their_own(kind: Kind) -> None:
    network = kind({})
    assert [network.learn(axis, NO_TORQUE).state for axis in AXES] == [0, 1, 2, 3, 4, 5]
    for size in (0.01, 30.0):
        for number, axis in enumerate(AXES):
            found = network.learn([size * component for component in axis], NO_TORQUE)
            assert (found.state, found.states, found.new) == (number, 6, False)
            assert found.match == pytest.approx(1.0)
    assert network.counts.tolist() == [3] * 6


def test_classifying_changes_nothing_and_says_when_nothing_fits(kind: Kind) -> None:
    network = kind({"rho": 0.95})
    assert network.classify(AXES[0], NO_TORQUE) == (-1, 0, 0.0, False)
    network.learn(AXES[0], NO_TORQUE)
    before = network.digest()
    assert network.classify(AXES[0], NO_TORQUE).state == 0
    other = network.classify(AXES[2], NO_TORQUE)
    assert (other.state, other.states) == (-1, 1)
    assert 0.0 <= other.match < 0.95
    assert network.digest() == before


def test_a_restored_memory_goes_on_bit_for_bit(kind: Kind) -> None:
    network, half = kind({"rho": 0.8}), vectors(300)
    for force, torque in half:
        network.learn(force, torque)
    copy = kind({"rho": 0.8})
    copy.restore(network.snapshot())
    assert copy.digest() == network.digest()
    for force, torque in vectors(300, seed=4):
        assert copy.learn(force, torque) == network.learn(force, torque)
    assert copy.digest() == network.digest()
    assert copy.prototypes.tobytes() == network.prototypes.tobytes()
    assert 5 < network.states < 200


@pytest.mark.parametrize(
    "damage",
    [
        {"states": 3},
        {"states": -1},
        {"inputs": 6},
        {"weights": b""},
        {"weights": np.full((2, 12), np.nan).tobytes()},
        {"weights": np.full((2, 12), 7.0).tobytes()},
        {"counts": np.zeros(2, np.int64).tobytes()},
        {"more": 1},
    ],
)
def test_a_memory_that_cannot_be_is_refused_and_nothing_changes(kind: Kind, damage: dict[str, bytes | int]) -> None:
    network = kind({})
    for axis in AXES[:2]:
        network.learn(axis, NO_TORQUE)
    before = network.digest()
    with pytest.raises(ValueError, match="snapshot"):
        network.restore(network.snapshot() | damage)
    assert network.digest() == before


def test_a_full_network_refuses_what_fits_nothing(kind: Kind) -> None:
    network = kind({"capacity": 2})
    for axis in AXES[:2]:
        network.learn(axis, NO_TORQUE)
    before = network.digest()
    with pytest.raises(ClassifierFullError, match="at most 2"):
        network.learn(AXES[4], NO_TORQUE)
    assert network.digest() == before
    assert network.learn(AXES[1], NO_TORQUE).state == 1


@pytest.mark.parametrize("force", [NO_TORQUE, (float("nan"), 0.0, 0.0), (1.0, 2.0)])
def test_a_vector_without_direction_is_refused(kind: Kind, force: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match=r"norm|finite|components"):
        kind({}).learn(force, NO_TORQUE)


@pytest.mark.parametrize("settings", [{"rho": 1.0}, {"rho": "high"}, {"vigilance": 0.9}, {"capacity": 0}, {"beta": 0}])
def test_wrong_settings_are_refused(kind: Kind, settings: dict[str, Setting]) -> None:
    with pytest.raises(ValueError, match=r"[Ee]xpected|unknown field"):
        kind(settings)


def test_a_box_of_fuzzy_art_grows_to_hold_what_it_learns_up_to_its_vigilance() -> None:
    network = FuzzyArt({"rho": 0.9})
    network.learn((1.0, 0.0, 0.0), NO_TORQUE)
    # Direction (0.8, 0.6): the box gets sides of 0.1 and 0.3, so the match is 1 - 0.4 / 6.
    found = network.learn((0.8, 0.6, 0.0), NO_TORQUE)
    assert (found.state, found.states) == (0, 1)
    assert found.match == pytest.approx(1.0 - 0.4 / 6.0)
    assert network.prototypes[0] == pytest.approx([0.9, 0.5, 0.5, 0.5, 0.5, 0.5, 0.0, 0.2, 0.5, 0.5, 0.5, 0.5])
    # (0, 1) would make it 0.5 and 0.5: 1 - 1 / 6 is below the vigilance.
    assert network.learn((0.0, 1.0, 0.0), NO_TORQUE).new
    assert network.classify((0.9, 0.4, 0.0), NO_TORQUE).state == 0


def test_the_fold_takes_them_by_their_entry_points() -> None:
    assert isinstance(classifier_of(Plugin(name="fuzzy-art", settings={"rho": 0.8})), FuzzyArt)
    assert isinstance(classifier_of(Plugin(name="art2a")), Art2A)
