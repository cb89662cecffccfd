"""The arm's error: drawn per motion, of the size that the thesis measured, and never told to who commanded it."""

from __future__ import annotations

import math
import tomllib
from importlib.resources import files
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from msgspec.structs import replace

from services.sim.arm import Arm
from services.sim.cell import SimulatedCell
from services.wire.actions import Increment, increments
from services.wire.definition import Definition, Moves, Noise, Start
from services.wire.definition_file import load
from services.wire.messages import Home, Move

RUN = "test-s0"
NOISE = Noise(along_mm=0.025, across_mm=0.021)
UP = Definition(name="up", noise=NOISE, start=Start(x_mm=0.0, y_mm=0.0, height_mm=15.0, rx_deg=0.0, ry_deg=0.0))
"""High above everything, so that the peg is where the arm holds it."""
HOME = Home(run=RUN, episode=4, x_mm=0.0, y_mm=0.0, z_mm=-15.0, rx_deg=0.0, ry_deg=0.0, rz_deg=0.0)
Table = npt.NDArray[np.float64]


def measured() -> dict[str, Table]:
    """Return the thesis's readings by direction, shape (5, 3): X, Y, Z in mm."""
    motion = tomllib.loads((Path(str(files("experiments.reproduce"))) / "thesis_cell.toml").read_text())["motion"]
    assert motion.pop("commanded_mm") == 0.2
    return {direction: np.array(rows) for direction, rows in motion.items()}


def errors(direction: str, readings: Table) -> tuple[Table, Table]:
    """Return what a direction's readings are off by along it, shape (n,), and across it, shape (n, 2)."""
    axis = "XYZ".index(direction[1])
    commanded = 0.2 if direction[0] == "+" else -0.2
    return readings[:, axis] - commanded, np.delete(readings, axis, axis=1)


def draws(commanded: Increment, count: int, noise: Noise = NOISE) -> Table:
    arm = Arm(noise, seed=3)
    return np.array([arm.executed(commanded, 0, step) for step in range(count)])


# -- the fit -------------------------------------------------------------------------------------------------------


def test_the_thesis_measured_every_direction_five_times() -> None:
    tables = measured()
    assert sorted(tables) == ["+X", "+Y", "+Z", "-X", "-Y", "-Z"]
    assert {table.shape for table in tables.values()} == {(5, 3)}


def test_the_shipped_size_is_that_of_the_thesis_tables() -> None:
    along, across = zip(*(errors(direction, table) for direction, table in measured().items()), strict=True)
    noise = load("chamfered-q-softmax").noise
    assert noise.along_mm == pytest.approx(np.sqrt(np.mean(np.square(along))), abs=0.0005)
    assert noise.across_mm == pytest.approx(np.sqrt(np.mean(np.square(across))), abs=0.0005)


@pytest.mark.parametrize("direction", ["+X", "-X", "+Y", "-Y", "+Z", "-Z"])
def test_the_thesis_tables_could_be_ours(direction: str) -> None:
    """Mean and spread along the motion lie within what 99 % of simulated tables of five repetitions have."""
    axis = "XYZ".index(direction[1])
    commanded = [0.0, 0.0, 0.0]
    commanded[axis] = 0.2 if direction[0] == "+" else -0.2
    simulated = errors(direction, draws(Increment(*commanded), 5000)[:, :3])[0].reshape(1000, 5)
    real = errors(direction, measured()[direction])[0]
    for figure in (np.mean, np.std):
        low, high = np.quantile(figure(simulated, axis=1), [0.005, 0.995])
        assert low < figure(real) < high


@pytest.mark.parametrize("commanded", increments(Moves(actions=11)))
def test_an_error_has_the_size_asked_for(commanded: Increment) -> None:
    noise = Noise(scale=2.0, along_mm=0.03, across_mm=0.01, turn_deg=0.05)
    off = draws(commanded, 4000, noise) - np.array(commanded)
    expected = [0.06 if value else 0.02 for value in commanded[:3]] + [0.1] * 3
    assert np.allclose(off.std(axis=0), expected, rtol=0.05)
    assert np.allclose(off.mean(axis=0), 0.0, atol=0.06 * np.array(expected))
    correlation = np.corrcoef(off.T) - np.eye(6)
    assert np.abs(correlation).max() < 0.06


def test_an_error_is_a_function_of_seed_episode_and_step() -> None:
    down = Increment(dz_mm=0.2)
    one, other = Arm(NOISE, 5), Arm(NOISE, 5)
    places = [(0, 1), (7, 3), (0, 1), (3, 7)]
    made = [one.executed(down, *place) for place in places]
    assert [other.executed(down, *place) for place in reversed(places)] == made[::-1]
    assert len(set(made)) == 3
    assert Arm(NOISE, 6).executed(down, 0, 1) != made[0]


@pytest.mark.parametrize("noise", [Noise(), Noise(scale=0.0, along_mm=0.1, across_mm=0.1, turn_deg=0.1)])
def test_without_noise_a_motion_is_what_was_commanded(noise: Noise) -> None:
    for commanded in increments(Moves(actions=11)):
        assert Arm(noise, 5).executed(commanded, 2, 3) is commanded


# -- in the cell ---------------------------------------------------------------------------------------------------


def test_the_robot_reports_what_was_commanded_and_the_peg_is_elsewhere() -> None:
    cell = SimulatedCell(UP, RUN, 1)
    cell.home(HOME)
    before = cell.world.peg
    assert 0.0 < math.dist(before.position, (0.0, 0.0, -15.0)) < 0.15
    moved, _ = cell.move(Move(run=RUN, episode=4, step=1, dx_mm=0.2))
    assert (moved.dx_mm, moved.dy_mm, moved.dz_mm) == (0.2, 0.0, 0.0)
    assert cell.world.peg == before.moved(Arm(NOISE, 1).executed(Increment(dx_mm=0.2), 4, 1))
    assert cell.world.peg.y_mm != before.y_mm


def test_errors_of_an_episode_add_up() -> None:
    """A random walk: after the home motion and 63 more the peg is off by eight times as much as after one."""
    cell = SimulatedCell(UP, RUN, 1)
    off = []
    for episode in range(150):
        cell.home(replace(HOME, episode=episode))
        for step in range(1, 64):
            cell.move(Move(run=RUN, episode=episode, step=step, dx_mm=0.2 if step % 2 else -0.2))
        off.append(cell.world.peg.y_mm)
    assert np.std(off) == pytest.approx(8 * 0.021, rel=0.15)


def test_a_motion_asked_for_again_is_not_made_again() -> None:
    cell = SimulatedCell(UP, RUN, 1)
    cell.home(HOME)
    move = Move(run=RUN, episode=4, step=1, dz_mm=0.2)
    answer, peg = cell.move(move), cell.world.peg
    assert cell.move(move) == answer
    assert cell.world.peg == peg


def test_a_cell_brought_back_is_off_by_the_same() -> None:
    moves = [Move(run=RUN, episode=4, step=step, dy_mm=0.2) for step in range(1, 12)]
    cells = [SimulatedCell(UP, RUN, 1), SimulatedCell(UP, RUN, 1)]
    cells[1].home(Home(run=RUN, episode=2, x_mm=0.0, y_mm=0.0, z_mm=-15.0, rx_deg=0.0, ry_deg=0.0, rz_deg=0.0))
    for cell in cells:
        cell.home(HOME)
        for move in moves:
            cell.move(move)
    assert cells[0].world.peg == cells[1].world.peg
