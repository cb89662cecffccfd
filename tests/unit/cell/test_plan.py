"""What a cell on this machine is planned to be, and the command lines that follow."""

from __future__ import annotations

import socket
from dataclasses import replace
from pathlib import Path

import pytest

from services.cell.hil import FULL_SCALES, Hil, emulated
from services.cell.local import LocalCell, temporary_cell
from services.cell.plan import Hardware, make_plan, viewer_at
from services.cell.ros2 import Graph, RosArm
from services.cell.start import commands
from services.cell.ur import arm
from services.together.__main__ import PARTS, split
from services.wire.errors import CellError, TreenailError

NAME = "chamfered-q-softmax"


def test_a_plan_starts_the_router_first_and_names_its_endpoint_everywhere(tmp_path: Path) -> None:
    plan = make_plan(NAME, seed=3, episodes=40, swaps=["20:agent:learner=sarsa"], cell="b", out=tmp_path)
    services = commands(plan)
    assert list(services) == ["router", "store", "task", "classifier", "agent", "sim"]
    assert services["router"] == ("--listen", plan.endpoint)
    assert all(words[:4] == ("--cell", "b", "--connect", plan.endpoint) for words in list(services.values())[1:])
    assert services["store"][4:] == ("--file", str(tmp_path / "store.sqlite"))
    length = ("--seed", "3", "--episodes", "40", "--swap", "20:agent:learner=sarsa")
    assert services["task"][4:] == ("--experiment", str(plan.experiment), *length)
    assert plan.experiment.is_absolute(), "the services may have another current folder"


def test_a_service_may_stand_at_another_router() -> None:
    plan = make_plan(NAME)
    services = commands(plan, {"agent": "tcp/127.0.0.1:1"})
    assert services["agent"][3] == "tcp/127.0.0.1:1"
    assert services["task"][3] == plan.endpoint


def test_four_services_may_be_one_program_whose_words_are_theirs() -> None:
    apart, together = (commands(make_plan(NAME, seed=3, port=7, together=joined)) for joined in (False, True))
    assert list(together) == ["router", "store", "together"]
    one = together["together"]
    assert one[:4] == apart["task"][:4], "it has a session of its own"
    assert split(one[4:]) == [[name, *apart[name]] for name in ("task", "classifier", "agent", "sim")]
    assert set(PARTS) == {"task", "classifier", "agent", "sim"}


def test_one_program_has_neither_certificates_nor_other_hardware(tmp_path: Path) -> None:
    with pytest.raises(CellError, match="--together: expected the simulator"):
        make_plan(NAME, together=True, hardware=emulated())
    with pytest.raises(CellError, match="--together: expected no --certs"):
        make_plan(NAME, together=True, certs=tmp_path)


def test_a_viewer_is_started_last_and_records_where_it_is_told(tmp_path: Path) -> None:
    viewer = viewer_at("127.0.0.1", 0, None, tmp_path / "a.rrd")
    words = commands(make_plan(NAME, viewer=viewer))
    assert list(words)[-1] == "viewer"
    assert words["viewer"][-3:] == ("--no-web", "--save", str(tmp_path / "a.rrd"))


def test_emulated_hardware_stands_in_for_the_simulator_which_has_a_world_of_its_own() -> None:
    plan = make_plan(NAME, hardware=emulated("supervisory"))
    services = commands(plan)
    assert services["sim"][1] == "a-world"
    assert set(services) > {"robot_link", "robot_link.emulator", "sensor_jr3", "sensor_jr3.emulator"}
    assert plan.overrides == FULL_SCALES
    assert plan.definition.sensor.full_scale_n == 200


@pytest.mark.parametrize(
    ("sets", "hardware", "rate"),
    [
        (["sensor.window=8"], emulated(), "1000"),
        (["sensor.window=8", "sensor.rate_hz=500"], emulated(), "500"),
        (["sensor.window=8", "sensor.rate_hz=300"], emulated(), "1000"),
        (["sensor.window=8", "sensor.rate_hz=300"], arm(), "300"),
        (["sensor.window=8", "sensor.rate_hz=1000"], arm(), "125"),
        (["sensor.rate_hz=1000", "sensor.filter_hz=31.25", "limits.hard_force_n=23"], arm(), "125"),
        ([], arm("192.168.0.10"), None),
        (["sensor.window=8", "sensor.rate_hz=250"], arm("192.168.0.10"), "250"),
    ],
)
def test_a_window_is_made_of_samples_at_a_rate_that_the_hardware_has(
    sets: list[str], hardware: Hardware, rate: str | None
) -> None:
    plan = make_plan(NAME, overrides=sets, hardware=hardware)
    services = commands(plan)
    words = services["sensor_jr3" if isinstance(hardware, Hil) else "robot_ur"]
    assert (words[words.index("--rate-hz") + 1] if "--rate-hz" in words else None) == rate
    if sets and hardware.emulated:
        assert str(plan.definition.sensor.rate_hz) == rate
    if isinstance(hardware, Hil):
        emulator = services["sensor_jr3.emulator"]
        assert emulator[emulator.index("--rate-hz") + 1] == rate, "or samples are left out, or come twice"


@pytest.mark.parametrize("hardware", [emulated(), emulated("supervisory"), arm(), RosArm()])
def test_random_starts_are_on_the_grid_of_an_emulated_arm(hardware: Hardware) -> None:
    assert make_plan("suite-round", hardware=hardware).definition.start.decimals == 4
    assert make_plan("suite-round", overrides=["start.decimals=3"], hardware=hardware).definition.start.decimals == 3
    assert make_plan(NAME, hardware=hardware).definition.start.decimals == 0, "one start is as it is given"
    assert make_plan("suite-round", hardware=arm("192.168.0.10")).definition.start.decimals == 0


def test_the_run_directory_is_named_by_all_that_makes_the_run() -> None:
    plain, swapped = make_plan(NAME, seed=2), make_plan(NAME, seed=2, swaps=["20:agent:learner=sarsa"])
    assert plain.out.name.endswith("-s2")
    assert swapped.out.name.startswith(f"{plain.out.name}-w")
    assert make_plan(NAME, overrides=["start.x_mm=-1.1"]).out.name != make_plan(NAME).out.name


def test_a_run_is_named_by_its_definition_and_seed() -> None:
    plan = make_plan(NAME, seed=2)
    assert replace(plan, seed=3).run == make_plan(NAME, seed=3).run != plan.run


@pytest.mark.parametrize(("option", "index"), [("--port", 0), ("--viewer-port", 1), ("--web-port", 2)])
def test_a_port_in_use_is_named_with_its_option(option: str, index: int) -> None:
    with socket.create_server(("127.0.0.1", 0)) as holder:
        port = holder.getsockname()[1]
        ports = [port if place == index else 0 for place in range(3)]
        with pytest.raises(CellError, match=f"{option} {port}: cannot listen on 127.0.0.1:{port}"):
            make_plan(NAME, port=ports[0], viewer=viewer_at("127.0.0.1", ports[1], ports[2]))


def test_a_folder_in_which_no_run_can_be_kept_is_named_before_anything_starts(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    cell = LocalCell(make_plan(NAME, out=tmp_path / "file" / "run"))
    with pytest.raises(TreenailError, match=str(tmp_path / "file")), cell:
        pass
    assert not cell.supervisor.children


def test_a_fresh_plan_forgets_the_stores_file_and_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "store.sqlite").write_text("old")
    (tmp_path / "summary.json").write_text("{}")
    with LocalCell(make_plan(NAME, out=tmp_path)):
        assert (tmp_path / "store.sqlite").exists()
    with LocalCell(make_plan(NAME, out=tmp_path, fresh=True)):
        assert not (tmp_path / "store.sqlite").exists()
    assert (tmp_path / "summary.json").exists()


def test_an_arm_of_ros_2_that_is_there_gets_no_simulator_and_meets_ros_where_it_is_said() -> None:
    graph = Graph(3, "kilted")
    arm = RosArm(("--target", "/target"), ("ros2_sensor", ("--topic", "/wrench")), graph)
    services = commands(make_plan("suite-round", hardware=arm, ros2=graph))
    where = ("--domain", "3", "--distribution", "kilted")
    assert list(services)[5:] == ["ros2_sensor", "ros2_robot", "ros2_out"]
    assert services["ros2_robot"][4:] == (*where, "--target", "/target")
    assert services["ros2_sensor"][4:] == (*where, "--topic", "/wrench")
    assert services["router"][2:] == ("--ros2", "3"), "ROS 2 may speak at the cell's router, in that domain"
    boxed = commands(make_plan("suite-round", hardware=RosArm(("--x",), ("sensor_rdt", ("--box", "b")), graph)))
    assert boxed["sensor_rdt"][4:] == ("--box", "b")


def test_a_temporary_cell_leaves_nothing() -> None:
    with temporary_cell(make_plan(NAME)) as cell:
        folder = cell.plan.out.parent
        assert cell.plan.logs.is_dir()
    assert not folder.exists()


def test_emulated_hardware_turns_about_the_tip_only() -> None:
    with pytest.raises(CellError, match=r"moves\.rotation_centre_mm: expected 0 with `treenail up hil`.*got 130"):
        make_plan(NAME, overrides=["moves.rotation_centre_mm=130"], hardware=emulated())
