"""The robot link with its emulated controller as processes: a whole cell through serial bytes, faults, recovery."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest

from services.robot_link.emulator.server import press

COUNTS = ("sensor.full_scale_n=65", "sensor.full_scale_dnm=50")
EMULATED = ("--auto-resume",)
NOISE = ("noise.along_mm=0.005", "noise.across_mm=0.002", "noise.force_n=0.01", "limits.hard_force_n=28.0")


class Emulated:
    """A running emulator."""

    def __init__(self, process: Any) -> None:
        self.process = process

    @property
    def url(self) -> str:
        match = re.search(r"listening on (socket://\S+|/dev/\S+)", self.process.out)
        return "" if match is None else match.group(1)

    @property
    def panel(self) -> int:
        match = re.search(r"panel on \S+:(\d+)", self.process.out)
        return 0 if match is None else int(match.group(1))

    def press(self, line: str) -> str:
        return press("127.0.0.1", self.panel, line)

    def motions(self) -> int:
        return int(self.press("motions"))


@pytest.fixture
def emulate(run_module: Callable[..., Any], wait_until: Callable[..., None]) -> Callable[..., Emulated]:
    def start(*options: str) -> Emulated:
        made = Emulated(run_module("services.robot_link.emulator", *options))
        wait_until("the emulator listens", lambda: (made.url and made.panel) or made.process.popen.poll() is not None)
        return made

    return start


def whole_cell(
    live: Any,
    emulate: Any,
    episodes: int,
    *link: str,
    overrides: tuple[str, ...] = (),
    emulator: tuple[str, ...] = (),
) -> Emulated:
    """Start a cell whose robot and sensor are emulated hardware on a simulator of its own."""
    connect = ("--connect", live.endpoint)
    sets = [word for item in (*COUNTS, *overrides) for word in ("--set", item)]
    live.start("task", "--experiment", str(live.definition), "--seed", "1", "--episodes", str(episodes), *sets)
    live.start("classifier")
    live.start("agent")
    live.start("sim", "--cell", "a-world")
    card = live.run_module(
        "services.sensor_jr3.emulator",
        *connect,
        *("--follow", "a-world", "--no-auto-zero", "--calibration-s", "0.05", "--full-scales", "65,65,65,50,50,50"),
    )
    live.wait_until("the card listens", lambda: re.search(r"tcp://\S+", card.out))
    (url,) = re.findall(r"tcp://\S+", card.out)
    live.start("sensor_jr3", "--url", url, "--settle-s", "0")
    robot: Emulated = emulate("--world", "a-world", "--sensor-s", "5", *connect, *emulator)
    live.start("robot_link", *patient(robot), *link)
    return robot


def patient(robot: Emulated) -> tuple[str, ...]:
    """Return the options of a robot link whose machine may be slow."""
    return ("--url", robot.url, "--settle-s", "0.002", "--oldest-s", "5", "--withdraw-mm", "20")


def resume(live: Any) -> tuple[int, str]:
    """Let the arm move as a person does; return the exit status and what was said."""
    command = live.run_module("treenail", "resume", "--connect", live.endpoint)
    return command.end(), command.out + command.err


def held(live: Any, robot: Emulated, why: str) -> int:
    """Wait until the arm is stopped for a reason, and return how many motions it has made."""
    live.wait_until(
        f"stopped: {why}", lambda: why.lower() in live.phase("robot_link").lower() and "stopped" in live.phase("task")
    )
    return robot.motions()


def stays(live: Any, robot: Emulated, motions: int) -> None:
    """Fail when the arm moves although it is asked for motions again and again."""
    asked = live.refused("robot_link").get("StoppedError", 0)
    live.wait_until("it is asked", lambda: live.refused("robot_link").get("StoppedError", 0) > asked + 5)
    assert robot.motions() == motions


def test_a_cell_through_serial_bytes_ends_byte_equal(live: Any, emulate: Any, reference: Any) -> None:
    robot = whole_cell(live, emulate, 3, *EMULATED)
    assert live.digests() == reference(3, 1, *COUNTS)
    assert robot.motions() > 3 * 5


def test_noise_is_the_same_when_episode_and_step_are_told(live: Any, emulate: Any, reference: Any) -> None:
    whole_cell(live, emulate, 2, *EMULATED, "--tell-episode", overrides=NOISE)
    assert live.digests() == reference(2, 1, *COUNTS, *NOISE)


def test_a_cell_over_the_supervisor_line_ends_byte_equal(live: Any, emulate: Any, reference: Any) -> None:
    supervisor = (*EMULATED, "--mode", "supervisory", "--ddcmp-listen", "0", "--tell-episode")
    robot = whole_cell(live, emulate, 2, *supervisor, emulator=("--mode", "supervisory"))
    assert live.digests() == reference(2, 1, *COUNTS)
    assert robot.motions() > 2 * 5


def test_faults_on_the_line_change_nothing(live: Any, emulate: Any, reference: Any) -> None:
    robot = whole_cell(live, emulate, 6, *EMULATED)
    for fault in ("garbage 1", "misheard 1", "nonsense 1", "half_way 1", "say *E-STOP*", "hangup"):
        before = robot.motions()
        live.wait_until("it moves", lambda since=before: robot.motions() > since + 4)
        refused = sum(live.refused("robot_link").values())
        assert robot.press(fault) == "ok"
        live.wait_until(f"{fault} is seen", lambda seen=refused: sum(live.refused("robot_link").values()) > seen)
    assert live.digests() == reference(6, 1, *COUNTS)


def test_killed_in_mid_episode_link_and_simulator_go_on(live: Any, emulate: Any, reference: Any) -> None:
    robot = whole_cell(live, emulate, 4, *EMULATED)
    live.wait_actions(5)
    live.processes["robot_link"].popen.kill()
    live.processes["robot_link"].end()
    live.start("robot_link", *patient(robot), *EMULATED)
    live.wait_actions(5)
    live.processes["sim"].popen.kill()
    live.processes["sim"].end()
    live.start("sim", "--cell", "a-world")
    assert live.digests() == reference(4, 1, *COUNTS)


def test_an_emulated_arm_goes_on_by_itself_when_its_power_is_back(live: Any, emulate: Any, reference: Any) -> None:
    robot = whole_cell(live, emulate, 2, *EMULATED)
    live.wait_until("it moves", lambda: robot.motions() > 6)
    assert robot.press("power 0") == "ok"
    live.wait_until("the task says it", lambda: "power off" in live.phase("task").lower())
    assert robot.press("power 1") == "ok"
    assert live.digests() == reference(2, 1, *COUNTS)


def test_an_arm_moves_only_when_somebody_says_so(live: Any, emulate: Any, reference: Any) -> None:
    """Arm power is cut, the stop outlives its cause, and whoever is started anew; nothing is lost of the run."""
    robot = whole_cell(live, emulate, 3)
    assert held(live, robot, "since the robot link started") == 0
    stays(live, robot, 0)
    assert resume(live)[0] == 0
    live.wait_until("it moves", lambda: robot.motions() > 10)
    assert robot.press("power 0") == "ok"
    held(live, robot, "POWER OFF")
    assert robot.press("power 1") == "ok"
    made = robot.motions()
    stays(live, robot, made)
    for victim in ("task", "robot_link"):
        live.processes[victim].popen.kill()
        live.processes[victim].end()
    sets = [word for item in COUNTS for word in ("--set", item)]
    live.start("task", "--experiment", str(live.definition), "--seed", "1", "--episodes", "3", *sets)
    live.start("robot_link", *patient(robot))
    held(live, robot, "since the robot link started")
    stays(live, robot, made)
    status, said = resume(live)
    assert status == 0, said
    assert "stopped: nothing has been let move" in said
    assert live.digests() == reference(3, 1, *COUNTS)
    assert resume(live) == (0, "nothing holds the arm\n")


@pytest.mark.parametrize("fault", ["say *E-STOP*", "half_way 1", "hangup"])
def test_whatever_stops_a_motion_holds_the_arm(live: Any, emulate: Any, fault: str) -> None:
    robot = whole_cell(live, emulate, 3)
    held(live, robot, "since the robot link started")
    assert resume(live)[0] == 0
    live.wait_until("it moves", lambda: robot.motions() > 10)
    assert robot.press(fault) == "ok"
    live.wait_until("it is stopped", lambda: "stopped" in live.phase("robot_link"))
    stays(live, robot, robot.motions())
    assert "treenail resume" in live.phase("task")


def test_the_wrong_convention_moves_nothing(live: Any, emulate: Any) -> None:
    robot: Emulated = emulate("--convention", "val_offset")
    live.start_loop(1, "task")
    link = live.start("robot_link", "--url", robot.url, "--convention", "zyz")
    live.wait_until("the probe is refused", lambda: "expected the convention zyz" in link.out)
    live.wait_until("it waits", lambda: "waiting for the controller" in live.phase("robot_link"))
    assert robot.motions() == 0
    assert link.stop() == 0
    assert link.err == ""


def test_a_home_that_outlasts_its_asker_is_answered_when_asked_again(live: Any, emulate: Any) -> None:
    robot: Emulated = emulate("--motion-s", "1.1")
    live.start_loop(1, "task")
    live.start("robot_link", "--url", robot.url, "--withdraw-mm", "10", *EMULATED)
    live.wait_until("nobody answers in time", lambda: "no answer to a motion" in live.phase("task"))
    live.wait_until("it is homed", lambda: "no F/T sample after a motion" in live.phase("task"))
    assert robot.motions() == 3, "homed once, however often it was asked"
