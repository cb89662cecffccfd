"""Zenoh's own router, hosted by a small process."""

from __future__ import annotations

from services.bus import command
from services.bus.heartbeat import touch_heartbeat
from services.bus.session import DEFAULT_ENDPOINT, DEFAULT_SECURE_ENDPOINT, open_router
from services.bus.stop_flag import StopFlag
from services.rules.command_line import Parser


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
    command.add_certs(parser)
    arguments = parser.parse_args()
    stop = StopFlag()
    secured = arguments.certs is not None
    listen = arguments.listen or [DEFAULT_SECURE_ENDPOINT if secured else DEFAULT_ENDPOINT]
    session = open_router(listen, arguments.certs)
    checked = " (mutual TLS, access control)" if secured else ""
    print(f"router: listening on {', '.join(listen)}{checked}", flush=True)
    while not stop.wait(0.5):
        touch_heartbeat()
    session.close()  # type: ignore[no-untyped-call]


if __name__ == "__main__":
    command.run("router", main)
