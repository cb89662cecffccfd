"""The options of ``treenail up``, and the plan that they make."""

from __future__ import annotations

import argparse
from pathlib import Path

from services.cell.plan import Plan, make_plan, viewer_at
from services.cell.ros2 import Graph, RosArm
from services.ros2.distributions import DISTRIBUTIONS, MOST_DOMAIN
from services.ros2.distributions import USUAL as ROS_USUAL
from services.rules.command_line import whole
from services.rules.shipped_skill import BUILTIN
from services.rules.swaps import SPEC, SPEC_HELP
from services.wire.errors import CellError
from services.wire.message_base import LONGEST_RUN
from services.wire.randomness import MAX_SEED
from treenail.commands import up_hardware

PROFILES = ("sim", "hil", "ur", "ros2")
WEB_PORT = 9090
USUAL, USUAL_EPISODES = "suite-round", 200
"""What is learnt where nothing is said: a peg from random starts."""
OLD_IRON = "chamfered-q-softmax"
"""The same with the thesis's own hardware, emulated: the thesis's own task, whose start is always the same."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``treenail up``."""
    parser.add_argument(
        "profile",
        choices=PROFILES,
        help="sim: the simulator in place of robot and sensor; hil: "
        "emulated old hardware; ur: an arm of Universal Robots; ros2: an arm behind topics of ROS 2",
    )
    parser.add_argument(
        "--experiment",
        help=f"name or TOML file of the definition (default: {USUAL}, {USUAL_EPISODES} episodes; hil: {OLD_IRON})",
    )
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="override a key of it")
    parser.add_argument("--episodes", type=whole(1, LONGEST_RUN), help="length of the run (default: the definition's)")
    parser.add_argument("--seed", type=whole(0, MAX_SEED), default=0, help="seed of the run, from 0 (default: 0)")
    parser.add_argument(
        "--skill",
        metavar="FILE",
        help=f"begin with what `treenail checkpoint export` wrote; {BUILTIN} is the skill that comes with Treenail",
    )
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
    parser.add_argument(
        "--together",
        action="store_true",
        help="task, classifier, agent and simulator in one process: faster; they die and come back as one",
    )
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
    up_hardware.add_arguments(parser)


def plan_of(arguments: argparse.Namespace) -> Plan:
    """Return what parsed arguments ask for, checked. Raises TreenailError."""
    web_port = arguments.web_port
    if web_port is None:  # who asks for any port for one asks for any port for the other
        web_port = WEB_PORT if arguments.viewer_port else 0
    graph = Graph(arguments.ros2 or 0, arguments.distribution, arguments.ros)
    hardware = up_hardware.hardware_of(arguments, graph)
    seen = arguments.ros2 is not None or (isinstance(hardware, RosArm) and not hardware.emulated)
    if not seen and (arguments.ros is not None or arguments.distribution is not None):
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
        ros2=graph if seen else None,
        fresh=arguments.fresh,
        together=arguments.together,
    )
