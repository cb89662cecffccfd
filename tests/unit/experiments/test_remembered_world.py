"""A world that remembers gives what physics gives, whatever the order in which it is asked."""

from __future__ import annotations

import pytest

from experiments.lab.in_process import InProcessRun
from experiments.lab.remembered_world import RememberedWorld
from services.sim.pose import Pose
from services.sim.world import World
from services.wire.actions import Increment, increments
from services.wire.definition import Definition, Noise, Start

DEFINITION = Definition(name="remembered")
START = Pose.from_tilt(1.6, -2.2, 0.9, 1.8, 0.4, 0.0)
SIDE, DOWN = Increment(dx_mm=-0.2), Increment(dz_mm=0.2)
EPISODES = ((DOWN, DOWN, SIDE), (DOWN, DOWN, SIDE, DOWN), (DOWN, SIDE, DOWN), (DOWN, DOWN, SIDE, DOWN, SIDE))


def test_repeated_and_branching_episodes_are_those_of_physics() -> None:
    plain, remembered = World(DEFINITION), RememberedWorld(DEFINITION)
    for motions in EPISODES:
        assert remembered.home(START) == plain.home(START)
        for motion in motions:
            assert remembered.move(motion) == plain.move(motion)


@pytest.mark.parametrize("asked", ["peg", "flange", "contact_state"])
def test_what_is_asked_of_physics_is_up_to_date(asked: str) -> None:
    plain, remembered = World(DEFINITION), RememberedWorld(DEFINITION)
    for _ in range(2):
        for world in (plain, remembered):
            world.home(START)
            for motion in EPISODES[1]:
                world.move(motion)
        expected, got = getattr(plain, asked), getattr(remembered, asked)
        assert (got() if callable(got) else got) == (expected() if callable(expected) else expected)


@pytest.mark.parametrize("noise", [Noise(), Noise(force_n=0.05), Noise(force_n=0.04, along_mm=0.025, across_mm=0.021)])
@pytest.mark.parametrize("spread", [0.0, 0.2])
def test_a_run_ends_in_the_same_bytes(noise: Noise, spread: float) -> None:
    definition = Definition(name="both", noise=noise, start=Start(x_mm=0.9, y_mm=-0.6, rx_deg=0.5, xy_spread_mm=spread))
    runs = [InProcessRun(definition, 3, remember=remember) for remember in (False, True)]
    plain, remembered = [list(run.episodes(12)) for run in runs]
    assert plain == remembered
    assert runs[0].agent.learner.digest() == runs[1].agent.learner.digest()
    assert runs[0].classifier.network.digest() == runs[1].classifier.network.digest()
    assert any(summary.decisions for summary in plain)


def test_a_motion_that_is_no_number_is_refused_and_nothing_is_remembered() -> None:
    world = RememberedWorld(DEFINITION)
    for _ in range(2):
        world.home(START)
        with pytest.raises(ValueError, match="finite"):
            world.move(Increment(dx_mm=float("nan")))
        assert all(world.move(increment) is not None for increment in increments(DEFINITION.moves))
