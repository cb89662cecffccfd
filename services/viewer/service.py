"""The viewer on the bus: it listens to everything and asks a little; nobody waits for it or notices when it is gone."""

from __future__ import annotations

import time
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from services.bus.onlooker import Inlet, Question
from services.bus.service import Options, Service
from services.rules.settings import setting
from services.viewer import record
from services.viewer.address import bracketed
from services.viewer.stream import Stream
from services.viewer.web import WebServer
from services.wire.errors import BadPayloadError
from services.wire.keys import ACTION, EPISODE, EXPERIMENT, FT, Q_TABLE, REWARD, STATE, TRUTH
from services.wire.messages import (
    Action,
    EpisodeSummary,
    Experiment,
    FtPacket,
    QTable,
    Reward,
    State,
    Truth,
)

LOOPBACK = "127.0.0.1"
EVERYWHERE = {"0.0.0.0": LOOPBACK, "::": "::1"}
"""Addresses that stand for all of a machine, and how it calls itself then."""
SEND_EVERY_S = 0.5
"""A browser takes in so many pieces a second, whatever is in them: who attaches late must not fall behind for long."""
ASK_EVERY_S = 2.0


@dataclass(frozen=True)
class Settings:
    """Where the viewer serves, and what it keeps."""

    bind: str = setting(LOOPBACK, "address to listen on", metavar="ADDRESS")
    """Whoever reaches ``port`` may also add to the picture: Rerun asks nobody who he is."""
    port: int = setting(9876, "0 for any free one", within=(0, 65535))
    memory_limit: str = setting("1MB", "how much of the past viewers that attach later get to see", metavar="SIZE")
    """A browser takes it in before the present goes on."""
    save: Path | None = setting(
        None, "record to a .rrd file as well; when it is there, to FILE.1.rrd and so on", type=Path, metavar="FILE"
    )
    web_port: int | None = setting(
        9090, "port of the page for browsers, 0 for any free one", within=(0, 65535), metavar="PORT"
    )
    """None for no page."""


def serve(options: Options, settings: Settings) -> None:
    """Stream a cell to Rerun until stopped."""
    with Service("viewer", options) as service:
        service.claim()
        with ExitStack() as open_now:
            page = None if settings.web_port is None else WebServer(settings.bind, settings.web_port)
            if page is not None:
                open_now.callback(page.stop)
            stream = Stream(settings.bind, settings.port, settings.memory_limit, settings.save)
            open_now.callback(stream.close)
            shell = ViewerShell(service, stream)
            service.ready()
            service.log.info("watch with: %s", invitation("rerun rerun+http", settings.bind, stream.port, "/proxy"))
            if page is not None:
                page.start(EVERYWHERE.get(settings.bind, settings.bind), stream.port)
                service.log.info("or in a browser: %s", invitation("http", settings.bind, page.port))
            if stream.recording is not None:
                service.log.info("recording to %s", stream.recording)
            shell.loop()


def invitation(start: str, bind: str, port: int, end: str = "") -> str:
    """Return an address that can be connected to, between ``start`` and ``end``."""
    if bind not in EVERYWHERE:
        return f"{start}://{bracketed(bind)}:{port}{end}"
    return f"{start}://{LOOPBACK}:{port}{end} (elsewhere with this machine's address for {LOOPBACK})"


class ViewerShell:
    """Moves what comes in to Rerun, a few times a second."""

    def __init__(self, service: Service, stream: Stream) -> None:
        self._service = service
        self._stream = stream
        self._recorder = recorder = record.Recorder(service.keys.cell)
        self._drains = (
            Inlet(service, FT, FtPacket, recorder.ft).drain,
            Inlet(service, STATE, State, recorder.state).drain,
            Inlet(service, ACTION, Action, recorder.action).drain,
            Inlet(service, REWARD, Reward, recorder.reward).drain,
            Inlet(service, EPISODE, EpisodeSummary, recorder.episode).drain,
            Inlet(service, TRUTH, Truth, recorder.truth).drain,
        )
        self._experiment = Question(service, EXPERIMENT, Experiment)
        self._q_table = Question(service, Q_TABLE, QTable)

    def loop(self) -> None:
        """Work until stopped."""
        started = previous = time.monotonic_ns()
        next_second = 0
        while not self._service.stopping:
            self._service.work_until(lambda: False, SEND_EVERY_S)
            now = time.monotonic_ns()
            self.step(previous - started, now - started)
            previous = now
            if now >= next_second:
                next_second = now + round(ASK_EVERY_S * 1e9)
                self.second(now - started)

    def step(self, start_ns: int, end_ns: int) -> None:
        """Send what came between two times since the start."""
        for drain in self._drains:
            drain()
        experiment = self._experiment.answer()
        if experiment is not None and experiment.run != self._service.run:
            self._service.run = experiment.run
            self._recorder.experiment(experiment)
            self._stream.begin(record.name(experiment, self._service.keys.cell), experiment.definition)
        for item in self._recorder.flush(start_ns, end_ns):
            self._stream.send(item)
        self._show_table(end_ns)

    def _show_table(self, now_ns: int) -> None:
        """Send the action values when they have been answered; refuse and count those that are no table."""
        answer = self._q_table.answer()
        try:
            table = None if answer is None else self._recorder.table(answer, now_ns)
        except BadPayloadError as error:
            self._service.refuse(error)
            return
        if table is not None:
            self._stream.send(table)

    def second(self, now_ns: int) -> None:
        """Do what is done every other second: ask, and send the run so far."""
        self._q_table.ask()
        if self._service.run is None or self._service.run != self._recorder.run:
            self._experiment.ask()
        for item in self._recorder.whole_run(now_ns):
            self._stream.send(item)
