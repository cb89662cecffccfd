"""The options of ``treenail up`` that say what moves and feels, and the hardware that they make."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any

from services.cell import hil, ur
from services.cell.plan import Hardware
from services.cell.ros2 import Graph, RosArm
from services.cell.ur import EMULATED
from services.robot_ur import settings as robot_ur
from services.rules.command_line import Parser
from services.sensor_rdt.settings import Settings as BoxSettings
from services.wire.errors import CellError

_ONLY = {
    ("hil",): ("link", "thesis_speed"),
    ("ur", "ros2"): ("robot", "arm", "box"),
    ("ros2",): ("sensor",),
}
"""Options by the profiles that take them."""
_THERE = "--arm target=TOPIC --arm pose=TOPIC --arm frame=NAME"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument(
        "--link",
        choices=hil.LINKS,
        help="hil: how the controller is spoken to (default: terminal); supervisory is DDCMP",
    )
    parser.add_argument(
        "--thesis-speed",
        action="store_true",
        help=f"hil: a line of {hil.THESIS_BAUD} baud, motions of {hil.THESIS_MOTION_S} s: "
        "about one decision a second, as in the thesis",
    )
    parser.add_argument(
        "--robot", metavar="ADDRESS", help=f"ur: of the controller, as 192.168.0.10; or {EMULATED}, the usual"
    )
    parser.add_argument(
        "--arm",
        action="append",
        default=[],
        metavar="OPTION[=VALUE]",
        help="ur: an option of `treenail robot_ur`: --arm start=120,-430,215,2.3,-1.9,0.2 "
        "--arm unlock-protective-stop; "
        f"ros2: of `treenail ros2_robot`, for an arm that is there: {_THERE}",
    )
    parser.add_argument(
        "--sensor",
        action="append",
        default=[],
        metavar="OPTION[=VALUE]",
        help="ros2: of `treenail ros2_sensor`, beside such an arm: --sensor topic=TOPIC --sensor frame=NAME",
    )
    parser.add_argument(
        "--box",
        metavar="ADDRESS",
        help="ur, ros2: of a Net F/T, Axia or HEX beside a real arm, instead of its wrist or of a topic",
    )


def hardware_of(arguments: argparse.Namespace, graph: Graph) -> Hardware | None:
    """Return what parsed arguments ask for; None for the simulator. Raises TreenailError."""
    profile = arguments.profile
    for profiles, names in _ONLY.items():
        if profile not in profiles and any(getattr(arguments, name) for name in names):
            options = ", ".join(f"--{name.replace('_', '-')}" for name in names)
            ups = " or ".join(f"`treenail up {word}`" for word in profiles)
            raise CellError(f"{options}: expected with {ups} only, got `treenail up {profile}`")
    if profile == "hil":
        return hil.emulated(arguments.link or hil.LINKS[0], thesis_speed=arguments.thesis_speed)
    if profile == "ur":
        return _ur(arguments)
    return _ros2(arguments, graph) if profile == "ros2" else None


def _ur(arguments: argparse.Namespace) -> Hardware:
    robot = arguments.robot or EMULATED
    if robot == EMULATED and arguments.box is not None:
        raise CellError("--box: expected with --robot ADDRESS only: the emulated arm has a wrist that feels its peg")
    options = [f"--{word.lstrip('-')}" for word in arguments.arm]
    robot_ur.settings(_checked("ur: --arm", "robot_ur", robot_ur.add_arguments, ["--robot", robot, *options]))
    return ur.arm(robot, options, None if arguments.box is None else _box(arguments.box))


def _ros2(arguments: argparse.Namespace, graph: Graph) -> Hardware:
    """Return an arm of ROS 2: the emulated one where nothing is said about another."""
    if arguments.robot not in (None, EMULATED):
        raise CellError(
            f"--robot: expected none with `treenail up ros2`, whose arm is where its topics are, got "
            f"{arguments.robot[:60]!r}; say {_THERE} (docs/ros2.md)"
        )
    if not (arguments.arm or arguments.sensor or arguments.box):
        return RosArm()
    if arguments.robot == EMULATED or not arguments.arm or bool(arguments.sensor) == bool(arguments.box):
        raise CellError(
            f"--arm, --sensor, --box: expected none for the emulated arm; for one that is there {_THERE}, and "
            "either --sensor topic=TOPIC --sensor frame=NAME or --box ADDRESS (docs/ros2.md)"
        )
    from services.ros2 import robot_settings, sensor_settings  # here: only this needs the extra

    arm, sensor = ([f"--{word.lstrip('-')}" for word in words] for words in (arguments.arm, arguments.sensor))
    said = [robot_settings.settings(_checked("ros2: --arm", "ros2_robot", robot_settings.add_arguments, arm)).graph]
    if sensor:
        given = _checked("ros2: --sensor", "ros2_sensor", sensor_settings.add_arguments, sensor)
        said.append(sensor_settings.settings(given).graph)
    if any(one != type(one)() for one in said):
        raise CellError("--arm, --sensor: expected ROS 2 where --ros2 DOMAIN, --ros and --distribution say, all of it")
    box = None if arguments.box is None else _box(arguments.box)
    return RosArm(tuple(arm), ("ros2_sensor", tuple(sensor)) if box is None else ("sensor_rdt", box), graph)


def _checked(
    where: str, service: str, add: Callable[[argparse.ArgumentParser], Any], options: list[str]
) -> argparse.Namespace:
    """Return options of a service, parsed as that service will. Raises CellError for others."""
    parser = Parser(prog=f"treenail up {where}", add_help=False)
    add(parser)
    known, others = parser.parse_known_args(options)
    if others:
        raise CellError(f"{where.split()[-1]}: expected options of `treenail {service}`, got {' '.join(others)[:80]!r}")
    return known


def _box(address: str) -> tuple[str, ...]:
    """Return the options of ``sensor_rdt`` for a box. Raises TreenailError for what is no address."""
    BoxSettings(address)
    return ("--box", address)
