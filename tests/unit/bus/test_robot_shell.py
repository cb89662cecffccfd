"""What every arm does when its sensor fails: it is held until somebody has looked, and its place is forgotten."""

from __future__ import annotations

import time
from collections.abc import Callable

import pytest

from services.bus.robot import Manner, RobotShell
from services.bus.testing import FakeService
from services.rules.motions import OutOfOrderError
from services.wire.actions import Increment
from services.wire.definition import Calibration, Definition, Sensor
from services.wire.definition_file import definition_sha256, run_id
from services.wire.errors import CellError
from services.wire.messages import Experiment, FtPacket, Home, Move, Resume

MS = 1_000_000
TARED = Definition(
    name="tared", sensor=Sensor(tare_samples=4), calibration=Calibration(sigma_n=0.1, sigma_nm=0.01, residual_n=0.01)
)
RUN = run_id(TARED, 0)
HOME = Home(run=RUN, episode=0, x_mm=1.6, y_mm=-2.2, z_mm=-1.0, rx_deg=1.8, ry_deg=0.4, rz_deg=0.0)
DOWN = Move(run=RUN, episode=0, step=1, dz_mm=0.2)


class Arm:
    """Stands where it is and is always ready."""

    ready, busy, trouble = True, False, ""

    def home(self, home: Home) -> Increment:
        return Increment()

    def move(self, increment: Increment, episode: int, step: int) -> Increment:
        return increment

    def run(self, script: Increment, then: Callable[[Increment], None]) -> None:
        then(script)

    def give_up(self, error: CellError) -> None:
        """Nothing is under way."""

    def pump(self, timeout_s: float) -> None:
        """Nothing is to be done."""

    def close(self) -> None:
        """Nothing is open."""


class Cell:
    """An arm that somebody has let move, with a sensor."""

    def __init__(self, definition: Definition, *, by_itself: bool = False) -> None:
        arm, manner = Arm(), Manner(settle_s=0.0, oldest_s=1000.0, by_itself=by_itself)
        self.shell: RobotShell[Increment] = RobotShell(FakeService("robot_link"), arm, arm, manner)
        self.shell.take_up(
            Experiment(
                run=RUN,
                seed=0,
                definition=definition,
                definition_sha256=definition_sha256(definition),
                skill_sha256=None,
                first_policy_version=0,
                episodes=1,
                episodes_done=0,
                decisions=0,
                phase="running",
            )
        )
        self.number = 0
        self.resume()
        self.feel()

    def feel(self, *, status: int = 0, force_n: float = 0.0, samples: int = 1) -> None:
        """Let samples come, and look at them."""
        self.number += samples
        self.shell.feel(
            FtPacket(
                sequence=self.number,
                t_ns=self.number * MS,
                period_ns=MS,
                status=status,
                force_n=((0.0, 0.0, force_n),) * samples,
                torque_nm=((0.0, 0.0, 0.0),) * samples,
            )
        )
        self.shell.watch_sensor()

    def resume(self) -> None:
        """Let it move."""
        self.shell.resume(Resume(stop_t_ns=self.shell.hold.stop.stop_t_ns))

    def home(self) -> None:
        """Stand at the start pose, in the air, with a zero."""
        robot = self.shell.robot
        assert robot is not None
        robot.home(HOME)
        robot.homed(HOME, self.number * MS)
        self.feel(samples=5)

    def move(self) -> None:
        """Ask for the next motion."""
        robot = self.shell.robot
        assert robot is not None
        robot.move(DOWN, time.monotonic_ns())


@pytest.mark.parametrize(("status", "why"), [(1, "saturated"), (4, "lost"), (8, "changed"), (16, "not yet zeroed")])
def test_an_arm_whose_sensor_fails_stays_held_until_somebody_says_so(status: int, why: str) -> None:
    cell = Cell(Definition(name="plain"))
    assert not cell.shell.hold.held
    cell.feel(status=status)
    assert why in cell.shell.hold.words()
    cell.feel()
    assert cell.shell.hold.held, "a sensor that is well again is nobody's deliberate act"
    cell.resume()
    cell.feel()
    assert not cell.shell.hold.held


def test_an_emulated_arm_goes_on_by_itself_once_its_sensor_is_well() -> None:
    cell = Cell(Definition(name="plain"), by_itself=True)
    cell.feel(status=1)
    assert not cell.shell.hold.held


@pytest.mark.parametrize("by_itself", [False, True])
def test_a_sensor_that_began_anew_since_its_tare_holds_any_arm(by_itself: bool) -> None:
    cell = Cell(TARED, by_itself=by_itself)
    cell.home()
    cell.move()
    cell.feel(status=4)
    cell.feel(force_n=3.0)
    assert "began anew" in cell.shell.hold.words()
    cell.resume()
    with pytest.raises(OutOfOrderError):
        cell.move()
    cell.home()
    assert not cell.shell.hold.held
    cell.move()


def test_a_zero_that_cannot_be_one_holds_any_arm() -> None:
    cell = Cell(TARED, by_itself=True)
    robot = cell.shell.robot
    assert robot is not None
    robot.home(HOME)
    robot.homed(HOME, (cell.number + 1) * MS)
    cell.feel(force_n=-9.0, samples=5)
    assert "expected a zero within 5 N of that of the calibration, got 9.00 N more" in cell.shell.hold.words()
