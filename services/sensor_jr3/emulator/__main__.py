"""``python -m services.sensor_jr3.emulator``: an emulated JR3 receiver, until it is stopped."""

from __future__ import annotations

import argparse
import logging
import threading
from collections.abc import Callable, Sequence
from pathlib import Path

import zenoh

from services.bus import command
from services.bus.follower import Follower
from services.bus.session import open_client
from services.bus.stop_flag import StopFlag
from services.rules.command_line import Parser, address, number, whole
from services.rules.settings import SettingError
from services.sensor_jr3 import memory_map as jr3
from services.sensor_jr3.emulator.card import EmulatedCard
from services.sensor_jr3.emulator.dsp import Dsp, Sensor
from services.sensor_jr3.emulator.loads import Load, recording
from services.sensor_jr3.settings import whole_numbers
from services.sensor_jr3.word_server import WordServer
from services.wire.keys import Keys
from services.wire.message_base import LARGEST_COMPONENT
from services.wire.text import numbers

LOG = logging.getLogger("jr3-emulator")


def main() -> None:
    """Parse the command line, serve, stop on a signal."""
    arguments = _parser().parse_args()
    host, port = arguments.listen
    load_at: Callable[[float], Load] | None = None
    if arguments.recording is not None:
        load_at = recording(arguments.recording).at
    card = EmulatedCard(Dsp(_sensor(arguments)), load_at)
    if arguments.load is not None:
        card.set_load(constant_load(arguments.load))
    stop = StopFlag()
    session: zenoh.Session | None = None
    if arguments.follow is not None:
        options = command.options(arguments)
        session = open_client(options.connect, options.connect_timeout_s, stop.is_set, options.certs)
        if jr3.SAMPLE_RATE_HZ % arguments.rate_hz:
            raise SettingError(f"--rate-hz: expected a divisor of {jr3.SAMPLE_RATE_HZ}, got {arguments.rate_hz}")

        def feel(felt: Sequence[Load]) -> None:
            card.play(felt, arguments.rate_hz)

        follower = Follower(session, Keys(arguments.follow), feel, lambda text: LOG.warning("%s", text))
        follower.catch_up(session, Keys(arguments.follow))
    with WordServer(card, host, port) as server:
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True).start()
        LOG.info("listening on tcp://%s:%d", host, server.port)
        stop.wait()
        server.shutdown()
    if session is not None:
        del follower
        session.close()  # type: ignore[no-untyped-call]


def _parser() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m services.sensor_jr3.emulator", description=__doc__)
    parser.add_argument(
        "--listen", type=address, default="127.0.0.1:0", metavar="HOST:PORT", help="port 0: a free one, printed"
    )
    felt = parser.add_mutually_exclusive_group()
    felt.add_argument("--load", metavar="FX,FY,FZ,MX,MY,MZ", help="a constant load [N, N m] (default: none)")
    felt.add_argument("--recording", type=Path, metavar="CSV", help="loads over time: t_s,fx_n,...,mz_nm")
    felt.add_argument("--follow", metavar="CELL", help="feel what the simulator of that cell publishes on ft")
    parser.add_argument(
        "--rate-hz",
        type=whole(8, 8000),
        default=1000,
        help="with --follow: how many of a motion's samples are felt a second, as the reader takes (default: 1000)",
    )
    parser.add_argument("--units", type=whole(0, 3), default=Sensor.units, help="unit code of the card, 0 to 3")
    parser.add_argument("--full-scales", help="six numbers in that unit (default: 65,65,130,50,50,50)")
    parser.add_argument("--serial", type=whole(1, 65000), default=Sensor.serial, help="1 to 65000")
    parser.add_argument("--adc-bits", type=whole(8, 16), default=Sensor.adc_bits, help="8 to 16")
    parser.add_argument(
        "--calibration-s", type=number(0.0, 60.0, "s"), default=2.0, help="after plugging in (default: 2)"
    )
    parser.add_argument("--no-auto-zero", action="store_true", help="do not zero the load after plugging in")
    parser.add_argument("--no-filters", action="store_true", help="filters 1 to 6 stand still, which costs less")
    command.add_arguments(parser)
    return parser


def _sensor(arguments: argparse.Namespace) -> Sensor:
    scales = Sensor.full_scales
    if arguments.full_scales is not None:
        scales = whole_numbers("--full-scales", arguments.full_scales, 1, 32767)
    return Sensor(
        units=arguments.units,
        full_scales=scales,
        serial=arguments.serial,
        adc_bits=arguments.adc_bits,
        calibration_steps=int(arguments.calibration_s * 8000),
        zeroes_itself=not arguments.no_auto_zero,
        filters=not arguments.no_filters,
    )


def constant_load(text: str) -> Load:
    """Return the load that a text names. Raises SettingError."""
    try:
        fx, fy, fz, mx, my, mz = load = numbers(text, 6)
    except ValueError as error:
        raise SettingError(f"--load: expected FX,FY,FZ,MX,MY,MZ [N, N m], as in 0,0,-2,0,0.02,0; {error}") from None
    if max(map(abs, load)) > LARGEST_COMPONENT:
        raise SettingError(f"--load: expected numbers from -1e5 to 1e5, got {text[:100]!r}")
    return fx, fy, fz, mx, my, mz


if __name__ == "__main__":
    command.run("jr3-emulator", main)
