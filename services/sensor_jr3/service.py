"""The sensor on the bus: samples as packets, troubles as status, and a card that went away brought back.

One loop does it all: it collects, publishes, and answers queries in between. Nothing here waits for long: a card that
does not answer is a card lost, said at once in the status of a packet of its own, so that no robot moves.
"""

from __future__ import annotations

import time

from services.bus.opening import Opening
from services.bus.service import Options, Service
from services.sensor_jr3 import memory_map as jr3
from services.sensor_jr3.card import Card, CardError, ChangedError, NoCardError, NoSensorError
from services.sensor_jr3.driver import Driver
from services.sensor_jr3.settings import Settings
from services.sensor_jr3.status import CHANGED, LOST, NOT_ZEROED, USELESS, troubles
from services.sensor_jr3.stream import Stream, pace_of
from services.sensor_jr3.transports import open_card
from services.wire.keys import FT
from services.wire.messages import Force, FtPacket, Torque

COLLECT_S = 0.005
"""How long is waited for samples before queries have their turn."""
CHECK_S = 1.0
"""How often it is looked whether the card is still as it was set up."""
SILENT_S = 0.05
"""How long no sample may come."""
RETRY_S = (0.05, 2.0)
"""Shortest and longest pause before a card is tried again; each is twice the one before."""
_EVENTS = 32
_OPENING_S = 0.01
_NO_CARD = 0xFFFF
_NOTHING: tuple[Force, Torque] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


def serve(options: Options, settings: Settings) -> None:
    """Run the sensor until it is stopped. Raises SettingError for settings that cannot be used here."""
    with Service("sensor_jr3", options) as service:
        service.claim()
        SensorShell(service, settings).run()


class SensorShell:
    """Keeps a card in use."""

    def __init__(self, service: Service, settings: Settings) -> None:
        self._service, self._settings = service, settings
        self._pace = pace_of(settings.rate_hz)
        self._publish = service.series_publisher(FT, FtPacket)
        # The time of day, but never set back and without jumps.
        self._ahead_ns = time.time_ns() - time.monotonic_ns()
        self._sequence = 0
        self._t_ns = 0
        self._loads = _NOTHING
        self._lost = 0
        self._ready = False
        self._retry_s = RETRY_S[0]

    def run(self) -> None:
        """Set the card up and publish; from the start again whenever something goes wrong."""
        while not self._service.stopping:
            card: Card | None = None
            try:
                card = self._open()
                if card is not None:
                    self._use(card)
            except CardError as error:
                self._on_failure(error)
            finally:
                if card is not None:
                    card.close()

    def _open(self) -> Card | None:
        """Open the card, working meanwhile: who does not answer may take seconds. None when stopped before."""
        opening = Opening(lambda: open_card(self._settings.url), lambda card: card.close())
        while not self._service.stopping:
            if opening.done:
                return opening.result()
            self._service.work(_OPENING_S)
        opening.abandon()
        return None

    def _use(self, card: Card) -> None:
        """Publish until stopped; raises CardError."""
        service, driver = self._service, Driver(card, self._settings.setup)
        service.phase = "setting the card up"
        self._say(NOT_ZEROED)
        for wait_s in driver.start():
            service.work_until(lambda: False, wait_s)
            if service.stopping:
                return
        first = max(self._sequence, self._now_ns() // self._pace.period_ns)
        settings = self._settings
        stream = Stream(driver.scale, settings.mount, self._pace, settings.samples_a_packet, first, self._t_ns)
        service.log.info("card set up: %s", driver.scale)
        self._retry_s = RETRY_S[0]
        self._show_phase()
        if not self._ready:
            self._ready = True
            service.ready()
            self._show_phase()
        try:
            self._follow(card, driver, stream)
        finally:
            # What is told of a lost sensor comes after all that was felt.
            self._publish(stream.flush())
            self._sequence, self._t_ns, self._loads = stream.sequence, stream.t_ns, stream.loads

    def _follow(self, card: Card, driver: Driver, stream: Stream) -> None:
        counter, data = jr3.counter_address(self._pace.counter), jr3.filter_address(self._settings.filter)
        soon_s = 3e-9 * self._pace.step_ns
        silent_s = max(SILENT_S, soon_s)
        checked = heard = time.monotonic()
        while not self._service.stopping:
            began_ns = self._now_ns()
            collected = card.collect(counter, data, COLLECT_S)
            if any(sample.errors == _NO_CARD for sample in collected.samples):
                driver.check()
                raise NoCardError("card: expected samples, got FFFF, which is what an empty bus reads")
            taken, lost = stream.taken, stream.lost
            self._publish(stream.take(collected, began_ns))
            self._count(stream.taken - taken, stream.lost - lost)
            now = time.monotonic()
            if collected.samples:
                heard = now
                _complain_of(collected.samples[-1].errors)
            elif now - heard > silent_s:
                driver.check()  # it may know why
                raise NoSensorError(f"sensor: expected a sample every {self._pace.period_ns / 1e6:g} ms, got none")
            if now - checked > CHECK_S or now - heard > soon_s:
                checked = now
                driver.check()
            self._serve_others()

    def _serve_others(self) -> None:
        for _ in range(_EVENTS):
            if not self._service.work(0.0):
                return

    def _count(self, taken: int, lost: int) -> None:
        self._service.handled += taken
        if lost:
            self._lost += lost
            self._service.refused["LostSamples"] += lost
            self._service.complain(f"{lost} samples lost, {self._lost} since the start", topic="lost")
            self._show_phase()

    def _show_phase(self) -> None:
        self._service.phase = f"running, {self._lost} samples lost" if self._lost else "running"

    def _on_failure(self, error: CardError) -> None:
        """Say what is wrong, to the robot first, and wait before the next attempt."""
        self._say(CHANGED if isinstance(error, ChangedError) else LOST)
        service = self._service
        service.refuse(error)
        service.phase = f"sensor lost, trying again: {error}"[:200]
        service.work_until(lambda: False, self._retry_s)
        self._retry_s = min(RETRY_S[1], 2.0 * self._retry_s)

    def _say(self, status: int) -> None:
        """Publish a status without a sample: the load is the one felt last."""
        now_ns = self._now_ns()
        self._sequence = max(self._sequence + 1, now_ns // self._pace.period_ns)
        self._t_ns = max(self._t_ns + 1, now_ns)
        force_n, torque_nm = self._loads
        packet = FtPacket(
            sequence=self._sequence, t_ns=self._t_ns, status=status, force_n=(force_n,), torque_nm=(torque_nm,)
        )
        self._publish((packet,))

    def _now_ns(self) -> int:
        return time.monotonic_ns() + self._ahead_ns


def _complain_of(errors: int) -> None:
    """Raise what the newest sample's error bits say; the packet with its status is on its way already."""
    if errors & USELESS:
        raise NoSensorError(f"sensor: expected one that works, got: {troubles(errors)}")
    if errors & jr3.SENSOR_CHANGED:
        raise ChangedError("sensor: expected the one that was set up, got another one (the card's change bit)")
