"""``python -m services.robot_link.emulator``: an emulated VAL II controller with an arm, until it is stopped."""

from __future__ import annotations

import logging
from functools import partial

import zenoh

from services.bus import command
from services.bus.session import open_client
from services.bus.stop_flag import StopFlag
from services.bus.world import World
from services.robot_link.emulator import poses
from services.robot_link.emulator.arm import Arm, IdealArm
from services.robot_link.emulator.controller import Behaviour, Controller
from services.robot_link.emulator.floppy import boot_from
from services.robot_link.emulator.poses import CONVENTIONS, Frame
from services.robot_link.emulator.server import Server, Text
from services.robot_link.emulator.supervisory import SupervisoryController
from services.robot_link.emulator.world_arm import WorldArm
from services.robot_link.serial_line import Line, LineSettings
from services.rules.command_line import Parser, address, number, whole
from services.wire.keys import Keys

LOG = logging.getLogger("robot-emulator")
START = (420.0, 150.0, 80.0, 30.0, 170.0, -20.0)
"""X, Y, Z [mm] and O, A, T [deg, as zyz] of the taught start location: tool nearly down, nothing upright or square."""


def main() -> None:
    """Parse the command line, serve, stop on a signal."""
    parser = Parser(prog="python -m services.robot_link.emulator", description=__doc__)
    usual = Behaviour()
    parser.add_argument(
        "--listen", type=address, default="127.0.0.1:0", metavar="HOST:PORT", help="port 0: a free one, printed"
    )
    parser.add_argument("--pty", action="store_true", help="on a pseudo terminal instead, its name is printed")
    parser.add_argument("--mode", choices=("terminal", "supervisory"), default="terminal", help="default: terminal")
    parser.add_argument("--baud", type=whole(), help="bits per second of the line (default: as fast as it goes)")
    parser.add_argument("--prompt", choices=("started", "arrived"), default=usual.prompt, help="after a motion")
    parser.add_argument("--convention", choices=CONVENTIONS, default=usual.convention, help="of O, A, T (default: zyz)")
    parser.add_argument(
        "--motion-s", type=number(0.0, 600.0), default=usual.motion_s, help="how long a motion takes (default: 0)"
    )
    parser.add_argument("--cold", action="store_true", help="begin with the questions of a cold start")
    parser.add_argument("--floppy", metavar="URL", help="with --cold: the drive that Y at its start loads from")
    parser.add_argument("--power-off", action="store_true", help="begin with the arm power off")
    parser.add_argument("--start", default="TREENAIL", help="name of the taught location (default: TREENAIL)")
    parser.add_argument(
        "--start-height-mm", type=number(0.0, 500.0), default=20.0, help="its tip above the mouth (default: 20)"
    )
    parser.add_argument("--world", metavar="CELL", help="the peg is that of the simulator in this cell")
    parser.add_argument(
        "--sensor-s", type=number(0.0, 60.0), default=0.0, help="an emulated sensor has so long to show a motion"
    )
    command.add_arguments(parser)
    arguments = parser.parse_args()
    host, port = arguments.listen
    stop = StopFlag()
    start = poses.frame(START, "zyz")
    session: zenoh.Session | None = None
    arm: Arm = IdealArm(start.copy())
    if arguments.world is not None:
        options = command.options(arguments)
        session = open_client(options.connect, options.connect_timeout_s, stop.is_set, options.certs)
        world = World(session, Keys(options.cell), Keys(arguments.world), arguments.sensor_s)
        arm = WorldArm(world, start, arguments.start, arguments.start_height_mm)
    behaviour = Behaviour(
        convention=arguments.convention,
        prompt=arguments.prompt,
        echo=arguments.mode == "terminal",
        cold=arguments.cold,
        motion_s=arguments.motion_s,
    )
    locations: dict[str, Frame] = {arguments.start: start}
    controller = Controller(arm, behaviour, locations)
    if arguments.floppy is not None:
        controller.boot = partial(boot_from, Line(arguments.floppy, LineSettings()))
    controller.faults.power = not arguments.power_off
    text: Text = controller
    if arguments.mode == "supervisory":
        text = SupervisoryController(controller)
    server = Server(controller, text, host, port, baud=arguments.baud, pty=arguments.pty)
    if server.pty:
        LOG.info("listening on %s", server.pty)
    else:
        LOG.info("listening on socket://%s:%d", host, server.port)
    LOG.info("panel on %s:%d", host, server.panel_port)
    while not stop:
        server.step(0.1)
    server.close()
    if session is not None:
        session.close()  # type: ignore[no-untyped-call]


if __name__ == "__main__":
    command.run("robot-emulator", main)
