"""Bad luck with a real connection: whatever happens, a clear sentence, and an arm that moves only when it may."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest

from services.robot_ur.at_arms_length import DistantClient
from services.robot_ur.link import Cause, Link
from services.robot_ur.motion import Arm
from services.robot_ur.settings import Settings
from services.robot_ur.states import State
from services.rules.motions import ArmError
from services.wire.actions import Increment
from services.wire.messages import Home
from tests.unit.robot_ur.conftest import Rig

pytest.importorskip("rtde_control", reason="pip install '.[robot_ur]'")

START_MM = (120.3, -431.7, 214.6, 2.31, -1.94, 0.17)
HOME = Home(run="r", episode=0, x_mm=1.0, y_mm=-1.4, z_mm=-0.2, rx_deg=1.0, ry_deg=0.4, rz_deg=0.0)
STEP = Increment(dx_mm=0.2)
PATIENCE_S = 30.0


class Driven:
    """A link that is pumped, and what it told."""

    def __init__(self, rig: Rig, **settings: object) -> None:
        usual: dict[str, object] = {"start": START_MM, "move_s": 2.0, "watchdog_s": 5.0, "robot": rig.address}
        self.settings = Settings(**(usual | settings))  # type: ignore[arg-type]
        self.arm = Arm(self.settings)
        self.faults: list[tuple[str, Cause]] = []
        self.states: list[State] = []
        self.link = Link(lambda: DistantClient(self.settings), self.arm, self.settings, self.states.append, self._lost)

    def until(self, holds: Callable[[], object]) -> None:
        """Pump until something holds."""
        deadline = time.monotonic() + PATIENCE_S
        while not holds():
            assert time.monotonic() < deadline, (self.link.trouble, self.faults)
            self.link.pump(0.005)

    def until_trouble(self, words: str) -> None:
        """Pump until that is what is wrong."""
        self.until(lambda: words in self.link.trouble)
        assert not self.link.ready

    def until_ready(self) -> Driven:
        """Pump until the arm takes motions."""
        self.until(lambda: self.link.ready)
        return self

    def home(self) -> Increment | ArmError:
        """Make ``home`` and return what came of it."""
        return self._make(lambda then: self.link.run(self.arm.home(HOME), then))

    def move(self, step: int = 1) -> Increment | ArmError:
        """Make a step and return what came of it."""
        return self._make(lambda then: self.link.run(self.arm.move(STEP, 0, step), then))

    def _make(self, begin: Callable[[Callable[[Increment | ArmError], None]], None]) -> Increment | ArmError:
        results: list[Increment | ArmError] = []
        begin(results.append)
        self.until(lambda: results)
        return results[0]

    def _lost(self, error: ArmError, cause: Cause) -> None:
        self.faults.append((str(error), cause))


@pytest.fixture
def driven(rig: Rig) -> Iterator[Callable[..., Driven]]:
    """Make links to the emulated controller."""
    links: list[Driven] = []

    def make(**settings: object) -> Driven:
        links.append(Driven(rig, **settings))
        return links[-1]

    yield make
    for made in links:
        made.link.close()


def test_it_homes_and_moves_and_answers_what_was_applied(driven: Callable[..., Driven], rig: Rig) -> None:
    made = driven(tell_episode=True).until_ready()
    assert made.home() == Increment()
    before = made.states[-1].pose
    assert made.move() == STEP
    after = made.states[-1].pose
    assert max(abs(a - b) for a, b in zip(after.position_mm, before.after(STEP).position_mm, strict=True)) < 1e-9
    assert made.faults == []


def test_a_wrong_address_is_said(driven: Callable[..., Driven]) -> None:
    driven(robot="127.254.253.252").until_trouble("expected a controller at 127.254.253.252")


def test_local_mode_is_said_and_left_is_enough(driven: Callable[..., Driven], rig: Rig) -> None:
    rig.press("remote 0")
    made = driven()
    made.until_trouble("local mode")
    rig.press("remote 1")
    made.until_ready()


def test_local_mode_while_it_works_takes_a_deliberate_act(driven: Callable[..., Driven], rig: Rig) -> None:
    made = driven(watchdog_s=0.5).until_ready()
    rig.press("remote 0")
    made.until_trouble("local mode")
    rig.press("remote 1")
    stays_out(made)
    made.link.recover()
    made.until_ready()


def test_another_client_in_control_is_said(driven: Callable[..., Driven], rig: Rig) -> None:
    rig.press("busy 1")
    made = driven()
    made.until_trouble("another client has them")
    rig.press("busy 0")
    made.until_ready()


def test_a_program_that_somebody_stops_is_not_sent_again_by_itself(driven: Callable[..., Driven], rig: Rig) -> None:
    made = driven().until_ready()
    rig.press("stop_program")
    made.until_trouble("somebody has stopped it")
    assert made.faults[-1][1] is Cause.PROGRAM
    stays_out(made)
    made.link.recover()
    made.until_ready()


def test_a_protective_stop_in_mid_move_stops_until_somebody_unlocks_it(driven: Callable[..., Driven], rig: Rig) -> None:
    made = driven().until_ready()
    made.home()
    rig.press("protect_in_motion")
    result = made.move()
    assert isinstance(result, ArmError)
    assert "protective stop" in str(result)
    assert made.faults[-1][1] is Cause.SAFETY
    with pytest.raises(ArmError, match="unlock it at the pendant"):
        made.link.recover()
    stays_out(made)
    rig.press("unlock")
    stays_out(made)
    assert "treenail resume" in made.link.trouble
    made.link.recover()
    made.until_ready()
    result = made.move(2)
    assert isinstance(result, ArmError), "nobody knows where the arm is: home first"
    made.until_ready()
    assert made.home() == Increment()


def test_with_the_setting_resume_unlocks(driven: Callable[..., Driven], rig: Rig) -> None:
    made = driven(unlock=True).until_ready()
    rig.press("protect")
    made.until_trouble("protective stop")
    made.link.recover()
    made.until_ready()


def test_an_emergency_stop_is_never_undone_from_here(driven: Callable[..., Driven], rig: Rig) -> None:
    made = driven(unlock=True, power=True).until_ready()
    rig.press("estop 1")
    made.until_trouble("emergency stop: release the button")
    with pytest.raises(ArmError, match="release the button"):
        made.link.recover()
    rig.press("estop 0")
    made.until_trouble("arm power is off")
    made.link.recover()
    made.until_trouble("the brakes are on")
    made.link.recover()
    made.until_ready()


def test_power_stays_off_without_the_setting(driven: Callable[..., Driven], rig: Rig) -> None:
    rig.press("power 0")
    made = driven()
    made.until_trouble("arm power is off")
    with pytest.raises(ArmError, match="switch it on at the pendant"):
        made.link.recover()


def test_a_pulled_cable_is_lost_at_once_and_comes_back(driven: Callable[..., Driven], rig: Rig) -> None:
    made = driven().until_ready()
    made.home()
    rig.press("pull 1")
    began = time.monotonic()
    made.until(lambda: made.faults)
    assert made.faults[-1][1] is Cause.LINE
    assert time.monotonic() - began < 2.0
    rig.press("pull 0")
    made.until_ready()
    assert made.home() == Increment()


def test_a_few_lost_packets_are_no_trouble(driven: Callable[..., Driven], rig: Rig) -> None:
    made = driven().until_ready()
    rig.press("drop 5")
    made.home()
    assert made.move() == STEP
    assert made.faults == []


def test_slow_answers_are_waited_for(driven: Callable[..., Driven], rig: Rig) -> None:
    rig.press("slow 20")
    made = driven().until_ready()
    assert made.home() == Increment()


@pytest.mark.parametrize("jump", ["-100", "100"])
def test_a_clock_that_jumps_is_another_controller(driven: Callable[..., Driven], rig: Rig, jump: str) -> None:
    made = driven().until_ready()
    rig.press(f"jump {jump}")
    made.until(lambda: made.faults)
    assert "clock to go on evenly" in made.faults[-1][0]
    assert made.faults[-1][1] is Cause.LINE
    made.until_ready()


def test_a_refused_recipe_names_what_is_missing(driven: Callable[..., Driven], rig: Rig) -> None:
    rig.press("forget ft_raw_wrench")
    driven(wrist="raw").until_trouble("does not know ft_raw_wrench")
    driven().until_ready()


def test_a_firmware_that_nobody_has_tried_is_said(driven: Callable[..., Driven], rig: Rig) -> None:
    rig.press("firmware 11.2")
    driven().until_trouble("got '11.2.0.0', which nobody has tried")


@pytest.mark.parametrize(
    ("line", "settings", "words"),
    [
        ("payload 0.2", {"payload_kg": 1.2}, "expected the 1.2 kg of --payload-kg, the controller has 0.2 kg set"),
        ("payload 0", {"payload_cog_mm": (0.0, 0.0, 40.0)}, "expected its centre at --payload-cog-mm"),
        ("payload 0", {"tcp": (0.0, 0.0, 120.0, 0.0, 0.0, 0.0)}, "the controller's is 120.00 mm"),
        ("weigh 1", {}, "the weight of 1.00 kg: is the payload right"),
        ("short 0.5", {"move_s": 0.3}, "0.500 mm"),
    ],
)
def test_what_is_not_as_said_stops_home(
    driven: Callable[..., Driven], rig: Rig, line: str, settings: dict[str, object], words: str
) -> None:
    rig.press(line)
    made = driven(**settings).until_ready()
    result = made.home()
    assert isinstance(result, ArmError)
    assert words in str(result)
    assert made.faults


def stays_out(made: Driven) -> None:
    """Pump for a while: the arm may not become ready."""
    for _ in range(100):
        made.link.pump(0.005)
        assert not made.link.ready
