"""The classifier that tells nothing apart."""

from __future__ import annotations

import pytest

from services.classifier.fold import classifier_of
from services.classifier.unclassified import OneClass
from services.rules.plugins import Classification
from services.wire.definition import Unclassified


def test_everything_is_of_the_one_class() -> None:
    network = classifier_of(Unclassified())
    assert network.classify((1.0, 0.0, 0.0), (0.0, 0.0, 0.0)) == Classification(0, 1, 1.0, new=False)
    assert network.learn((0.0, -3.0, 0.0), (0.0, 0.0, 0.1)) == Classification(0, 1, 1.0, new=False)
    assert (network.states, network.counts.tolist(), network.prototypes.shape) == (1, [1], (1, 6))


def test_memory_goes_on() -> None:
    network, other = OneClass(), OneClass()
    network.learn((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert network.digest() != other.digest()
    other.restore(network.snapshot())
    assert network.digest() == other.digest()


@pytest.mark.parametrize("change", [{"felt": -1}, {"felt": b""}, {"states": 2}, {"more": 1}])
def test_a_snapshot_that_does_not_fit_is_refused(change: dict[str, bytes | int]) -> None:
    network = OneClass()
    with pytest.raises(ValueError, match="snapshot: expected"):
        network.restore(network.snapshot() | change)
