"""A first touch that never comes."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from experiments.lab.in_process import InProcessRun
from services.rules.motions import DeadSensorError, Robot
from services.rules.touch import Touch
from services.task.insertion import Insertion
from services.wire.actions import Increment
from services.wire.definition import Definition, Noise, Parts, Start
from services.wire.definition_file import load, shipped
from services.wire.definition_world import Change, Hole
from services.wire.messages import FtPacket, Move

DOWN = Increment(dz_mm=0.2)
NONE = ((0.0, 0.0, 0.0),)
EXACT = Definition(name="exact")


def packet(number: int, force_n: float = 0.0) -> FtPacket:
    return FtPacket(sequence=number + 1, t_ns=number + 1, period_ns=1, force_n=((0.0, 0.0, -force_n),), torque_nm=NONE)


def depth_mm(definition: Definition, force_n: float = 0.0, increment: Increment = DOWN) -> float | None:
    """Push on, feeling always the same; return how deep the tip is when a touch is missed, None for never."""
    touch, start = Touch(definition), definition.start
    touch.begin(Insertion(definition, "r-s0", 0).home(0, 0))
    for number in range(70):
        touch.feel(packet(number, force_n))
        if touch.missing() is not None:
            return number * increment.dz_mm - start.height_mm
        touch.take(increment)
    return None


@pytest.mark.parametrize("name", [name for name in shipped() if name.startswith(("cham", "rubber"))])
def test_an_experiment_that_begins_beside_the_hole_cannot_be_done_without_feeling(name: str) -> None:
    deep_mm = depth_mm(load(name))
    assert deep_mm is not None
    assert deep_mm < 4.0, "far from the 9.8 mm of a success"


def test_who_has_felt_once_is_believed() -> None:
    assert depth_mm(EXACT, 0.29) is not None
    assert depth_mm(EXACT, 0.3) is None


@pytest.mark.parametrize("start", [Start(x_mm=0.0, y_mm=0.0, rx_deg=0.0, ry_deg=0.0), Start(x_mm=0.4, y_mm=0.3)])
def test_a_start_that_fits_may_go_in_freely(start: Start) -> None:
    assert depth_mm(replace(EXACT, start=start)) is None


def test_a_wide_hole_lets_everything_in() -> None:
    assert depth_mm(replace(EXACT, parts=Parts(clearance_mm=4.0))) is None


@pytest.mark.parametrize("shape", [Parts(shape="triangle"), Parts(shape="rectangle", peg_breadth_mm=14.0)])
def test_it_knows_every_shape(shape: Parts) -> None:
    deep_mm = depth_mm(replace(EXACT, parts=shape))
    assert deep_mm is not None
    assert deep_mm < 4.5


def test_a_hole_that_may_be_tilted_or_become_wider_explains_more() -> None:
    upright = depth_mm(EXACT)
    tilted = depth_mm(replace(EXACT, hole=Hole(tilt_spread_deg=1.0)))
    assert upright is not None
    assert tilted is not None
    assert upright < tilted
    wider = (Change(episode=9, key="parts.clearance_mm", value=4.0),)
    assert depth_mm(replace(EXACT, changes=wider)) is None


def test_more_errors_of_the_arm_explain_more() -> None:
    exact = depth_mm(EXACT)
    loose = depth_mm(replace(EXACT, noise=Noise(along_mm=0.01, across_mm=0.01)))
    assert exact is not None
    assert loose is not None
    assert exact < loose


def test_a_robot_with_a_sensor_that_shows_nothing_stops_and_says_why() -> None:
    robot, definition = Robot(EXACT, "r-s0"), EXACT
    home = Insertion(definition, "r-s0", 0).home(0, 0)
    robot.home(home)
    robot.homed(home, 0)
    made = 0
    with pytest.raises(DeadSensorError, match=r"expected a touch of 0\.3 N"):
        for step in range(1, 60):
            robot.feel(packet(step), step)
            move = Move(run="r-s0", episode=0, step=step, dz_mm=0.2)
            robot.move(move, step)
            robot.moved(move, DOWN, step)
            made += 1
    assert made * 0.2 - definition.start.height_mm < 3.0


@pytest.mark.parametrize(
    "overrides",
    [
        ("noise.scale=0",),
        ("noise.scale=3", "limits.hard_force_n=60"),
        ("noise.scale=0", "wrist.stiffness_n_per_mm=2", "wrist.stiffness_nm_per_rad=10"),
        ("noise.scale=0", "contact.stiffness_n_per_mm=2"),
        ("parts.chamfer_mm=0", "limits.contact_force_n=2"),
        ("parts.shape=square", "start.rz_deg=3", "noise.scale=0"),
        ("start.rx_deg=10", "start.height_mm=4", "noise.scale=0"),
        ("parts.shape=triangle", "noise.scale=0"),
        ("parts.shape=rectangle", "parts.peg_breadth_mm=12.4", "start.rz_deg=3", "noise.scale=0"),
        ("hole.rx_deg=-6", "hole.ry_deg=3", "start.height_mm=3", "noise.scale=0"),
        ("changes=[{episode=1, key='parts.clearance_mm', value=2.5}]", "noise.scale=0"),
    ],
)
def test_an_honest_simulation_is_never_accused(overrides: tuple[str, ...]) -> None:
    definition = load("chamfered-q-softmax", overrides)
    assert len(list(InProcessRun(definition, 5).episodes(6))) == 6
