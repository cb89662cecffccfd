"""``python -m services.sensor_jr3.card_server isa:0x260 --listen 0.0.0.0:7460``: a card of this machine for another.

Whoever can connect can command the card: keep it on a network of its own. It holds the card while it runs: what was a
``tcp://`` card and broke stays broken until the server is started again.
"""

from __future__ import annotations

import logging
import threading

from services.bus import command
from services.bus.stop_flag import StopFlag
from services.rules.command_line import Parser, address
from services.sensor_jr3.transports import open_card
from services.sensor_jr3.word_server import WordServer


def main() -> None:
    """Parse the command line, serve, stop on a signal."""
    parser = Parser(prog="python -m services.sensor_jr3.card_server", description=__doc__)
    parser.add_argument("url", help="the card, such as isa:0x260")
    parser.add_argument("--listen", type=address, default="127.0.0.1:7460", metavar="HOST:PORT", help="where")
    arguments = parser.parse_args()
    host, port = arguments.listen
    stop = StopFlag()
    card = open_card(arguments.url)
    with WordServer(card, host, port) as server:
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()
        logging.getLogger("card_server").info("listening on tcp://%s:%d", host, server.port)
        stop.wait()
        server.shutdown()
    card.close()


if __name__ == "__main__":
    command.run("card_server", main)
