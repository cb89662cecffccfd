"""The sensor's axes: as given or drawn for a run; the load is the same, only its components change."""

from __future__ import annotations

import math

import pytest
from msgspec.structs import replace

from services.sim.cell import SimulatedCell
from services.sim.mount import Mount
from services.sim.pose import rotate, rotation_vector
from services.wire.definition import Definition, Noise, Wrist
from services.wire.messages import Home, Move

FORCE = (1.0, -2.0, 3.0)


def test_an_aligned_sensor_reads_the_load_as_it_is() -> None:
    assert Mount(Wrist(), 3).seen(FORCE) is FORCE


@pytest.mark.parametrize(
    ("angles", "reads"),
    [((90.0, 0.0, 0.0), (1.0, 3.0, 2.0)), ((0.0, 90.0, 0.0), (-3.0, -2.0, 1.0)), ((0.0, 0.0, 90.0), (-2.0, -1.0, 3.0))],
)
def test_a_turned_sensor_reads_along_its_own_axes(
    angles: tuple[float, float, float], reads: tuple[float, float, float]
) -> None:
    """About Z by 90 degrees its X axis is the tool's Y and its Y axis the tool's -X; the others likewise."""
    rx, ry, rz = angles
    assert Mount(Wrist(sensor_rx_deg=rx, sensor_ry_deg=ry, sensor_rz_deg=rz), 0).seen(FORCE) == pytest.approx(reads)


def test_an_unknown_turn_belongs_to_the_seed() -> None:
    wrist = Wrist(sensor_mount="unknown")
    assert Mount(wrist, 7).orientation == Mount(wrist, 7).orientation
    assert len({Mount(wrist, seed).orientation for seed in range(50)}) == 50


def test_every_turn_is_as_likely() -> None:
    """Of SO(3) the mean of the turned axes is 0 and that of the angle pi/2 + 2/pi; 4000 draws know both to 2 %."""
    turns = [Mount(Wrist(sensor_mount="unknown"), seed).orientation for seed in range(4000)]
    for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)):
        for component in zip(*(rotate(turn, axis) for turn in turns), strict=True):
            assert math.fsum(component) / 4000 == pytest.approx(0.0, abs=0.04)
            assert math.fsum(value * value for value in component) / 4000 == pytest.approx(1 / 3, abs=0.02)
    angles = [math.hypot(*rotation_vector(turn)) for turn in turns]
    assert math.fsum(angles) / 4000 == pytest.approx(math.pi / 2 + 2 / math.pi, rel=0.02)


@pytest.mark.parametrize("noise", [Noise(), Noise(along_mm=0.02, across_mm=0.02)])
def test_a_cell_with_a_turned_sensor_feels_the_same_load(noise: Noise) -> None:
    plain = Definition(name="plain", noise=noise)
    turned = replace(plain, wrist=Wrist(sensor_mount="unknown"))
    mount = Mount(turned.wrist, 5)
    start = Home(run="r-s5", episode=0, x_mm=1.6, y_mm=-2.2, z_mm=-1.0, rx_deg=1.8, ry_deg=0.4, rz_deg=0.0)
    cells = [SimulatedCell(definition, "r-s5", 5) for definition in (plain, turned)]
    for cell in cells:
        cell.home(start)
    touched = 0
    for step in range(1, 16):
        straight, tilted = (cell.move(Move(run="r-s5", episode=0, step=step, dz_mm=0.2))[1] for cell in cells)
        assert tilted.force_n[-1] == mount.seen(straight.force_n[-1])
        assert tilted.torque_nm[-1] == mount.seen(straight.torque_nm[-1])
        touched += math.hypot(*tilted.force_n[-1]) > 0.3
    assert touched > 3
