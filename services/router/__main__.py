"""``python -m services.router``: Zenoh's own router, hosted by a small process."""

from __future__ import annotations

import signal
import sys
import threading

from services.wire import command
from services.wire.session import DEFAULT_ENDPOINT, open_router


def main() -> None:
    """Route until stopped."""
    parser = command.Parser(prog="treenail router", description=__doc__)
    parser.add_argument(
        "--listen",
        action="append",
        metavar="ENDPOINT",
        help=f"Zenoh endpoint to listen on, may be repeated (default: {DEFAULT_ENDPOINT})",
    )
    arguments = parser.parse_args()
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    listen = arguments.listen or [DEFAULT_ENDPOINT]
    session = open_router(listen)
    print(f"router: listening on {', '.join(listen)}", flush=True)
    # A signal that one of Zenoh's threads takes does not wake this one, so it looks up now and then.
    while not stop.wait(0.5):
        pass
    session.close()  # type: ignore[no-untyped-call]


if __name__ == "__main__":
    sys.exit(command.run("router", main))
