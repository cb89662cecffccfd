"""The chapter on uncertainty: the thesis's tables, simulated with the noise of the shipped definitions."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.reproduce.uncertainty import EXPERIMENT, motions, readings, thesis
from services.wire.definition import Noise
from services.wire.definition_file import load


def test_a_load_is_read_as_it_is_but_for_the_noise() -> None:
    exact = readings(Noise(), 5.0, 4, 0)
    assert exact.tolist() == [[0.0, 0.0, 5.0, 0.0, 0.0, 0.0]] * 4
    noisy = readings(load(EXPERIMENT).noise, 5.0, 6000, 0)
    assert noisy[:, 2].mean() == pytest.approx(5.0, abs=0.005)
    assert noisy[:, :3].std(axis=0) == pytest.approx(load(EXPERIMENT).noise.force_n, rel=0.05)
    assert not np.array_equal(noisy, readings(load(EXPERIMENT).noise, 5.0, 6000, 1))


@pytest.mark.parametrize("direction", ["-X", "+X", "-Y", "+Y", "-Z", "+Z"])
def test_motions_end_where_they_were_told_but_for_the_noise(direction: str) -> None:
    axis, sign = "XYZ".index(direction[1]), -1 if direction[0] == "-" else 1
    ends = motions(load(EXPERIMENT).noise, 0.2, direction, 2000, 3)
    expected = np.zeros(3)
    expected[axis] = 0.2 * sign
    assert ends.mean(axis=0) == pytest.approx(expected, abs=0.003)
    assert motions(Noise(), 0.2, direction, 1, 0)[0] == pytest.approx(expected)
    assert thesis().motion[direction].mean(axis=0) == pytest.approx(expected, abs=0.04)
