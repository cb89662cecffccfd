"""The figures are there, have the right size, and show something."""

from __future__ import annotations

import io

import matplotlib.image
import msgspec
import numpy as np
import pytest
from numpy.typing import NDArray

from experiments.lab.plots import figures, moving_average, readable, thesis
from services.wire.messages import EpisodeSummary

NAMES = {"return.png", "force.png", "torque.png", "failures.png"}


def episodes(seed: int, count: int, collisions: int) -> tuple[EpisodeSummary, ...]:
    """The first so many episodes collide, the others succeed; force and return get better all the time."""
    return tuple(
        EpisodeSummary(
            run=f"{'0' * 16}-s{seed}",
            episode=number,
            episode_return=-200.0 / (number + 1 + seed),
            moves=50,
            decisions=20,
            mean_force_n=3.0 / (number + 1 + seed),
            peak_force_n=9.0,
            mean_torque_nm=0.2 / (number + 1 + seed),
            peak_torque_nm=0.5,
            states=4,
            outcome="collision" if number < collisions else "inserted",
        )
        for number in range(count)
    )


def pixels(png: bytes) -> NDArray[np.float32]:
    image: NDArray[np.float32] = matplotlib.image.imread(io.BytesIO(png))
    return image[:, :, :3]


def share_of(image: NDArray[np.float32], colour: tuple[int, int, int]) -> float:
    """Part of the picture's points that have exactly this colour."""
    return float((np.rint(image * 255) == colour).all(axis=2).mean())


@pytest.mark.parametrize("count", [1, 25])
@pytest.mark.parametrize("seeds", [(3,), (0, 1, 5)])
def test_four_figures_that_are_not_blank(seeds: tuple[int, ...], count: int) -> None:
    images = figures("by-hand", {seed: episodes(seed, count, 3) for seed in seeds})
    assert set(images) == NAMES
    for png in images.values():
        image = pixels(png)
        assert image.shape == (500, 900, 3)
        assert image.std() > 0.05
        inside = image[60:400, 120:880]
        coloured = inside.max(axis=2) - inside.min(axis=2) > 0.2
        assert coloured.sum() > 20, "axes and grid are there, but nothing in them"


def test_episodes_without_any_contact_can_be_drawn() -> None:
    silent = [msgspec.structs.replace(one, mean_force_n=0.0, mean_torque_nm=0.0) for one in episodes(0, 20, 0)]
    assert set(figures("by-hand", {0: silent})) == NAMES


def test_failures_are_bars_as_high_as_they_are_many() -> None:
    vermilion = (0xD5, 0x5E, 0x00)
    some, all_of_them, none = (
        share_of(pixels(figures("by-hand", {0: episodes(0, 40, collisions)})["failures.png"])[60:400], vermilion)
        for collisions in (20, 40, 0)
    )
    assert none == 0.0
    assert all_of_them > 0.4
    assert some == pytest.approx(all_of_them / 2, rel=0.05)


def test_the_end_of_learning_can_be_read_beside_rare_failures_and_the_thesis() -> None:
    values = np.full((1, 100), -16.0)
    values[0, 3] = -1000.0
    low, high = readable(values[:, 20:], None)
    assert -20 < low < -16 < high < -10
    assert readable(values[:, 20:], -12.0)[1] > -12.0


def test_the_thesis_is_drawn_for_its_own_task_alone() -> None:
    assert thesis("chamfered-q-softmax", "episode_return") == -15.0
    assert thesis("chamfered-q-softmax", "force_n") == 0.33
    assert thesis("initial", "episode_return") is None, "another task than ours"
    assert thesis("by-hand", "episode_return") is None


def test_collisions_are_marked_and_the_thesis_is_a_line() -> None:
    vermilion, green = (0xD5, 0x5E, 0x00), (0x00, 0x9E, 0x73)
    clean, harmed, ours = (
        pixels(figures(name, {0: episodes(0, 40, collisions)})["return.png"])[:410]
        for name, collisions in (("by-hand", 0), ("by-hand", 5), ("chamfered-q-softmax", 0))
    )
    assert share_of(harmed, vermilion) > share_of(clean, vermilion) == 0.0
    assert share_of(ours, green) > share_of(clean, green) == 0.0


def test_same_episodes_give_the_same_bytes() -> None:
    table = {seed: episodes(seed, 12, 2) for seed in (0, 1)}
    assert figures("by-hand", table) == figures("by-hand", table)


def test_moving_average_is_of_the_last_ten() -> None:
    values = np.arange(24.0).reshape(2, 12)
    assert moving_average(values)[0].tolist() == [0, 0.5, 1, 1.5, 2, 2.5, 3, 3.5, 4, 4.5, 5.5, 6.5]
    assert moving_average(values)[1].tolist() == (moving_average(values)[0] + 12).tolist()


@pytest.mark.parametrize("lengths", [(), (0,), (3, 4)])
def test_seeds_of_different_lengths_or_none_are_refused(lengths: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="expected equally many episodes of every seed"):
        figures("by-hand", {seed: episodes(seed, count, 0) for seed, count in enumerate(lengths)})
