"""``python -m services.sensor_rdt.emulator``: an emulated ATI Net F/T box, until it is stopped."""

from __future__ import annotations

import contextlib
import http.server
import logging
import selectors
import socket
import socketserver
import threading
import time
from collections.abc import Sequence

import zenoh

from services.bus import command
from services.bus.follower import Follower, Load
from services.bus.session import open_client
from services.bus.stop_flag import StopFlag
from services.rules.command_line import Parser, whole
from services.sensor_rdt.emulator.box import FT_RATE_HZ, HELP, Box, press
from services.wire.errors import TreenailError
from services.wire.keys import Keys
from services.wire.text import numbers

LOG = logging.getLogger("rdt-emulator")
_TICK_S = 0.0005


class EmulatorError(TreenailError):
    """The emulator cannot be started like this."""


def main() -> None:
    """Parse the command line and serve."""
    parser = Parser(prog="python -m services.sensor_rdt.emulator", description=__doc__, epilog=f"Lines: {HELP}")
    parser.add_argument("--listen", default="127.0.0.1", metavar="HOST", help="address of all ports")
    parser.add_argument("--port", type=whole(0, 65535), default=49152, help="of the records, UDP; 0 for a free one")
    parser.add_argument("--page-port", type=whole(0, 65535), default=0, help="of the page, 0 for a free one")
    parser.add_argument("--rate-hz", type=whole(1, 8000), default=FT_RATE_HZ, help="records a second")
    parser.add_argument("--load", default="0,0,0,0,0,0", metavar="FX,FY,FZ,MX,MY,MZ", help="a constant one [N, N m]")
    parser.add_argument("--force-unit", choices=("N", "lbf"), default="N", help="that its page tells")
    parser.add_argument("--torque-unit", choices=("N-m", "lbf-in", "lbf-ft"), default="N-m", help="that its page tells")
    parser.add_argument("--follow", metavar="CELL", help="feel what the simulator of that cell publishes on ft")
    command.add_arguments(parser)
    arguments = parser.parse_args()
    try:
        load = numbers(arguments.load, 6)
    except ValueError as error:
        raise EmulatorError(f"--load: {error}") from None
    box = Box(rate_hz=arguments.rate_hz, force_unit=arguments.force_unit, torque_unit=arguments.torque_unit)
    press(box, f"load {','.join(map(str, load))}")
    stop = StopFlag()
    session: zenoh.Session | None = None
    if arguments.follow is not None:
        options = command.options(arguments)
        session = open_client(options.connect, options.connect_timeout_s, stop.is_set, options.certs)

        def feel(felt: Sequence[Load]) -> None:
            box.loads = tuple(felt)

        follower = Follower(session, Keys(arguments.follow), feel, lambda text: LOG.warning("%s", text))
        follower.catch_up(session, Keys(arguments.follow))
    _serve(box, arguments.listen, arguments.port, arguments.page_port, stop)
    if session is not None:
        del follower
        session.close()  # type: ignore[no-untyped-call]


def _serve(box: Box, host: str, port: int, page_port: int, stop: StopFlag) -> None:
    """Serve records, page and panel. Raises EmulatorError when a port is taken."""
    records = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        records.bind((host, port))
        page = http.server.ThreadingHTTPServer((host, page_port), _page_of(box))
    except OSError as error:
        raise EmulatorError(f"--listen {host}: cannot listen on its ports: {error.strerror}") from None
    panel = socketserver.ThreadingTCPServer(("127.0.0.1", 0), _panel_of(box))
    panel.daemon_threads = True
    for server in (page, panel):
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.1}, daemon=True).start()
    records.setblocking(False)
    LOG.info("listening on %s, records %d, page %d", host, records.getsockname()[1], page.server_address[1])
    LOG.info("panel on 127.0.0.1:%d", panel.server_address[1])
    selector = selectors.DefaultSelector()
    selector.register(records, selectors.EVENT_READ)

    def send(data: bytes, peer: tuple[str, int]) -> None:
        with contextlib.suppress(OSError):  # nobody hears it, or the buffer is full: lost, as on a true network
            records.sendto(data, peer)

    while not stop:
        if selector.select(_TICK_S):
            with contextlib.suppress(OSError):  # what came back from a client that is gone
                data, peer = records.recvfrom(64)
                box.receive(data, peer, time.monotonic())
        box.due(time.monotonic(), send)
    for server in (page, panel):
        server.shutdown()
        server.server_close()
    records.close()


def _page_of(box: Box) -> type[http.server.BaseHTTPRequestHandler]:
    class Page(http.server.BaseHTTPRequestHandler):
        """The box's page."""

        def do_GET(self) -> None:
            """Answer the page with the calibration, and nothing else."""
            if self.path != "/netftapi2.xml" or box.faults.pageless:
                self.send_error(404)
                return
            page = box.page
            self.send_response(200)
            self.send_header("Content-Type", "text/xml")
            self.send_header("Content-Length", str(len(page)))
            self.end_headers()
            self.wfile.write(page)

        def log_message(self, format: str, *arguments: object) -> None:
            """Say nothing."""

    return Page


def _panel_of(box: Box) -> type[socketserver.StreamRequestHandler]:
    class Panel(socketserver.StreamRequestHandler):
        """Lines for the panel."""

        def handle(self) -> None:
            """Do what each line says."""
            for line in self.rfile:
                self.wfile.write(press(box, line.decode("utf-8", "replace")).encode() + b"\n")

    return Panel


if __name__ == "__main__":
    command.run("rdt-emulator", main)
