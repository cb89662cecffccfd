"""Zenoh's own router, hosted by a small process."""

from __future__ import annotations

from services.bus import command, own_socket
from services.bus.heartbeat import touch_heartbeat
from services.bus.interfaces import interface_of
from services.bus.routing import open_router
from services.bus.session import DEFAULT_ENDPOINT, DEFAULT_SECURE_ENDPOINT
from services.bus.stop_flag import StopFlag
from services.rules.command_line import Parser, whole
from services.wire.errors import CellError


def main() -> None:
    """Route until stopped."""
    parser = Parser(prog="treenail router", description=__doc__)
    parser.add_argument(
        "--listen",
        action="append",
        metavar="ENDPOINT",
        help="Zenoh endpoint to listen on, may be repeated "
        f"(default: {DEFAULT_ENDPOINT}, with --certs {DEFAULT_SECURE_ENDPOINT})",
    )
    parser.add_argument(
        "--trust",
        action="append",
        default=[],
        metavar="INTERFACE",
        help="network interface, by name or address, by which only the cell's own come in; may be repeated. "
        "Without certificates, who comes in by others may read and ask, no more (default: none)",
    )
    parser.add_argument(
        "--ros2",
        action="append",
        default=[],
        type=whole(0, 232),
        metavar="DOMAIN",
        help="let processes of ROS 2 (rmw_zenoh) in that domain publish and hear here, whoever they are; "
        "may be repeated",
    )
    command.add_certs(parser)
    arguments = parser.parse_args()
    stop = StopFlag()
    secured = arguments.certs is not None
    if secured and arguments.ros2:
        raise CellError("--ros2: expected none with --certs: ROS 2 has no certificates of ours, give it its own router")
    listen = arguments.listen or [DEFAULT_SECURE_ENDPOINT if secured else DEFAULT_ENDPOINT]
    # First of all, so that whoever finds the port open finds this open too.
    doors = () if secured else (own_socket.listening(endpoint) for endpoint in listen)
    own = list(dict.fromkeys(door for door in doors if door is not None))
    trusted = [interface_of(name) for name in arguments.trust]
    session = open_router([*own, *listen], arguments.certs, trusted, arguments.ros2)
    print(f"router: listening on {', '.join(listen)} {_rights(secured, bool(own), trusted)}".rstrip(), flush=True)
    while not stop.wait(0.5):
        touch_heartbeat()
    session.close()  # type: ignore[no-untyped-call]


def _rights(secured: bool, own: bool, trusted: list[str]) -> str:
    """Return in words who may do what."""
    if secured:
        return "(mutual TLS, access control)"
    doors = [*(["by this user on this machine"] if own else []), *(f"by {interface}" for interface in trusted)]
    return f"(who comes in {' or '.join(doors)} may do everything, others read)" if own or trusted else ""


if __name__ == "__main__":
    command.run("router", main)
