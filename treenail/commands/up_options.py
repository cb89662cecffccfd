"""The options of ``treenail up``, and the plan that they make."""

from __future__ import annotations

import argparse
from pathlib import Path

from services.cell import hil
from services.cell.hil import LINKS, Hil, emulated
from services.cell.plan import Plan, make_plan, viewer_at
from services.cell.ros2 import Graph, RosArm
from services.cell.ur import EMULATED, Ur, arm
from services.robot_ur import settings as robot_ur
from services.ros2.distributions import DISTRIBUTIONS, MOST_DOMAIN
from services.ros2.distributions import USUAL as ROS_USUAL
from services.rules.command_line import Parser, whole
from services.rules.swaps import SPEC, SPEC_HELP
from services.sensor_rdt.settings import Settings as BoxSettings
from services.wire.errors import CellError
from services.wire.message_base import LONGEST_RUN
from services.wire.randomness import MAX_SEED

PROFILES = ("sim", "hil", "ur", "ros2")
WEB_PORT = 9090
USUAL, USUAL_EPISODES = "suite-round", 200
"""What is learnt where nothing is said: a peg from random starts."""
OLD_IRON = "chamfered-q-softmax"
"""The same with the thesis's own hardware, emulated: the thesis's own task, whose start is always the same."""
_ARM_HELP = "ur: an option of `treenail robot_ur`: --arm start=120,-430,215,2.3,-1.9,0.2 --arm unlock-protective-stop"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``treenail up``."""
    parser.add_argument(
        "profile",
        choices=PROFILES,
        help="sim: the simulator in place of robot and sensor; hil: "
        "emulated old hardware; ur: an arm of Universal Robots; ros2: an emulated arm behind topics of ROS 2",
    )
    parser.add_argument(
        "--experiment",
        help=f"name or TOML file of the definition (default: {USUAL}, {USUAL_EPISODES} episodes; hil: {OLD_IRON})",
    )
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="override a key of it")
    parser.add_argument("--episodes", type=whole(1, LONGEST_RUN), help="length of the run (default: the definition's)")
    parser.add_argument("--seed", type=whole(0, MAX_SEED), default=0, help="seed of the run, from 0 (default: 0)")
    parser.add_argument("--skill", type=Path, metavar="FILE", help="begin with what `treenail checkpoint export` wrote")
    parser.add_argument("--swap", action="append", default=[], metavar=SPEC, help=SPEC_HELP)
    parser.add_argument(
        "--out", type=Path, help="run directory (default: runs/<experiment>-<hash>-s<seed>[-k<skill>][-w<swaps>])"
    )
    parser.add_argument("--fresh", action="store_true", help="forget what the run directory knows of earlier runs")
    parser.add_argument("--stay", action="store_true", help="keep the finished cell for questions until Ctrl-C")
    parser.add_argument("--cell", default="a", help="name of the cell (default: a)")
    parser.add_argument(
        "--certs", type=Path, metavar="FOLDER", help="what `treenail certs` made: with mutual TLS and access control"
    )
    parser.add_argument(
        "--port", type=whole(0, 65535), default=7447, help="the router's port on 127.0.0.1, 0 for a free one"
    )
    parser.add_argument(
        "--viewer-port", type=whole(0, 65535), default=9876, help="port for Rerun viewers, 0 for a free one"
    )
    parser.add_argument(
        "--viewer-bind",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="address to watch at (default: 127.0.0.1, this machine only; 0.0.0.0 lets others watch, and draw)",
    )
    parser.add_argument(
        "--web-port",
        type=whole(0, 65535),
        help="port of the page for browsers, 0 for a free one (default: 9090, or a free one with --viewer-port 0)",
    )
    parser.add_argument("--no-web", action="store_true", help="serve no page for browsers")
    parser.add_argument("--no-viewer", action="store_true", help="run without the viewer service")
    parser.add_argument("--save", type=Path, metavar="FILE.rrd", help="let the viewer service record as well")
    parser.add_argument(
        "--ros2",
        nargs="?",
        const=0,
        type=whole(0, MOST_DOMAIN),
        metavar="DOMAIN",
        help="publish to ROS 2 (rmw_zenoh) what the cell feels and does, in that domain (without a number: 0)",
    )
    parser.add_argument("--ros", metavar="ENDPOINT", help="of ROS's own router, rmw_zenohd (default: the cell's)")
    parser.add_argument("--distribution", choices=tuple(DISTRIBUTIONS), help=f"of ROS 2 (default: {ROS_USUAL})")
    parser.add_argument(
        "--link", choices=LINKS, help="hil: how the controller is spoken to (default: terminal); supervisory is DDCMP"
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
        "--box",
        metavar="ADDRESS",
        help="ur: of a Net F/T, Axia or HEX beside a real arm, instead of its wrist",
    )
    parser.add_argument("--arm", action="append", default=[], metavar="OPTION[=VALUE]", help=_ARM_HELP)


def plan_of(arguments: argparse.Namespace) -> Plan:
    """Return what parsed arguments ask for, checked. Raises TreenailError."""
    if arguments.profile != "hil" and (arguments.link is not None or arguments.thesis_speed):
        raise CellError("--link, --thesis-speed: expected with `treenail up hil` only: the simulator has no line")
    web_port = arguments.web_port
    if web_port is None:  # who asks for any port for one asks for any port for the other
        web_port = WEB_PORT if arguments.viewer_port else 0
    hardware: Hil | RosArm | Ur | None = None
    robots = arguments.robot not in (None, *((EMULATED,) if arguments.profile == "ros2" else ()))
    if arguments.profile != "ur" and (robots or arguments.arm or arguments.box):
        raise CellError("--robot, --arm, --box: expected with `treenail up ur` only")
    if arguments.profile == "hil":
        hardware = emulated(arguments.link or LINKS[0], thesis_speed=arguments.thesis_speed)
    elif arguments.profile == "ros2":
        hardware = RosArm()
    elif arguments.profile == "ur":
        robot = arguments.robot or EMULATED
        if robot == EMULATED and arguments.box is not None:
            raise CellError(
                "--box: expected with --robot ADDRESS only: the emulated arm has a wrist that feels its peg"
            )
        hardware = arm(
            robot, _arm_options(robot, arguments.arm), None if arguments.box is None else _box(arguments.box)
        )
    if arguments.ros2 is None and (arguments.ros is not None or arguments.distribution is not None):
        raise CellError("--ros, --distribution: expected with --ros2 only")
    viewer = None
    if not arguments.no_viewer:
        web_port = None if arguments.no_web else web_port
        viewer = viewer_at(arguments.viewer_bind, arguments.viewer_port, web_port, arguments.save)
    experiment, episodes = arguments.experiment, arguments.episodes
    if experiment is None and arguments.profile != "hil":
        experiment, episodes = USUAL, episodes or USUAL_EPISODES
    return make_plan(
        experiment or OLD_IRON,
        overrides=arguments.set,
        seed=arguments.seed,
        episodes=episodes,
        swaps=arguments.swap,
        skill=arguments.skill,
        cell=arguments.cell,
        out=arguments.out,
        port=arguments.port,
        certs=arguments.certs,
        hardware=hardware,
        viewer=viewer,
        ros2=None if arguments.ros2 is None else Graph(arguments.ros2, arguments.distribution, arguments.ros),
        fresh=arguments.fresh,
    )


def _arm_options(robot: str, words: list[str]) -> list[str]:
    """Return options of ``robot_ur``, checked as that service will. Raises TreenailError."""
    options = [f"--{word.lstrip('-')}" for word in words]
    parser = Parser(prog="treenail up ur: --arm", add_help=False)
    robot_ur.add_arguments(parser)
    known, others = parser.parse_known_args(["--robot", robot, *options])
    if others:
        raise CellError(f"--arm: expected options of `treenail robot_ur`, got {' '.join(others)[:80]!r}")
    robot_ur.settings(known)
    return options


def _box(address: str) -> tuple[str, ...]:
    """Return the options of ``sensor_rdt`` for a box. Raises TreenailError for what is no address."""
    BoxSettings(address)
    return ("--box", address)
