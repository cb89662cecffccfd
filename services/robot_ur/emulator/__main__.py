"""``python -m services.robot_ur.emulator``: an emulated controller of a Universal Robots arm, until it is stopped."""

from __future__ import annotations

import argparse

import zenoh

from services.bus import command
from services.bus.emulated_arm import Arm, IdealArm, WorldArm
from services.bus.session import open_client
from services.bus.stop_flag import StopFlag
from services.bus.world import World
from services.robot_ur.emulator.controller import LOG, Behaviour, Controller
from services.robot_ur.emulator.panel import HELP
from services.robot_ur.emulator.server import Server
from services.rules.command_line import Parser, number, whole
from services.wire.errors import TreenailError
from services.wire.keys import Keys
from services.wire.text import numbers

START = "120.3,-431.7,214.6,2.31,-1.94,0.17"
"""X, Y, Z [mm] and rotation vector [rad] of the taught start pose: tool nearly down, nothing upright or square."""


WORLD_S = 20.0
"""How long a motion waits for a simulator that is started again."""


class EmulatorError(TreenailError):
    """The emulator cannot be started like this."""


def main() -> None:
    """Parse the command line and serve."""
    arguments = _parser().parse_args()
    stop = StopFlag()
    x_mm, y_mm, z_mm, *turn = _six("--start", arguments.start)
    start = (x_mm / 1000.0, y_mm / 1000.0, z_mm / 1000.0, *turn)
    session: zenoh.Session | None = None
    arm: Arm = IdealArm(start, _six("--load", arguments.load))
    if arguments.world is not None:
        options = command.options(arguments)
        session = open_client(options.connect, options.connect_timeout_s, stop.is_set, options.certs)
        world = World(session, Keys(options.cell), Keys(arguments.world), 0.0, WORLD_S)
        arm = WorldArm(world, start, arguments.start_height_mm)
    behaviour = Behaviour(
        remote=not arguments.local,
        unlock_after_s=arguments.unlock_after_s,
        motion_s=arguments.motion_s,
        payload_kg=arguments.payload_kg,
        tcp=_six("--tcp", arguments.tcp),
    )
    try:
        server = Server(Controller(arm, behaviour), arguments.listen, arguments.panel_port)
    except OSError as error:
        raise EmulatorError(f"--listen {arguments.listen}: cannot listen on its ports: {error.strerror}") from None
    LOG.info("listening on %s, ports 29999, 30003, 30004", arguments.listen)
    LOG.info("panel on 127.0.0.1:%d", server.panel_port)
    while not stop:
        server.step()
    server.close()
    if session is not None:
        session.close()  # type: ignore[no-untyped-call]


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="python -m services.robot_ur.emulator", description=__doc__, epilog=f"Lines for the panel: {HELP}"
    )
    parser.add_argument(
        "--listen", default="127.0.0.1", metavar="HOST", help="address of the ports (default: 127.0.0.1)"
    )
    parser.add_argument("--panel-port", type=whole(0, 65535), default=0, help="on 127.0.0.1; 0, the usual: a free one")
    parser.add_argument("--start", default=START, metavar="X,Y,Z,RX,RY,RZ", help="the taught start pose [mm, rad]")
    parser.add_argument(
        "--start-height-mm", type=number(0.0, 500.0), default=20.0, help="its tip above the mouth (default: 20)"
    )
    parser.add_argument("--load", default="0,0,0,0,0,0", metavar="FX,FY,FZ,MX,MY,MZ", help="in free space [N, N m]")
    parser.add_argument("--world", metavar="CELL", help="the peg is that of the simulator in this cell")
    parser.add_argument("--motion-s", type=number(0.0, 60.0), default=0.0, help="how long a motion takes (default: 0)")
    parser.add_argument("--unlock-after-s", type=number(0.0, 60.0), default=5.0, help="after a protective stop")
    parser.add_argument("--local", action="store_true", help="begin in local mode")
    parser.add_argument("--payload-kg", type=number(0.0, 50.0), default=0.0, help="that is set (default: 0)")
    parser.add_argument("--tcp", default="0,0,0,0,0,0", metavar="X,Y,Z,RX,RY,RZ", help="tool in the flange [m, rad]")
    command.add_arguments(parser)
    return parser


def _six(option: str, text: str) -> tuple[float, ...]:
    try:
        return tuple(numbers(text, 6))
    except ValueError as error:
        raise EmulatorError(f"{option}: expected six numbers with commas between; {error}") from None


if __name__ == "__main__":
    command.run("ur-emulator", main)
