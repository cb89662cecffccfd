"""An environment in Rerun, as a cell is seen by its viewer: an address for Rerun and a page for browsers."""

from __future__ import annotations

import sys
import time

from experiments.lab.guided import Reached
from services.sim.cell import truth_of
from services.sim.world import World
from services.viewer.record import Recorder
from services.viewer.stream import Stream
from services.viewer.web import WebServer
from services.wire.definition import Definition
from services.wire.definition_file import definition_sha256, run_id
from services.wire.messages import EpisodeSummary, Experiment, FtPacket, Moved

ADDRESS = "127.0.0.1"
MEMORY = "16MB"
SEND_EVERY_S = 0.1
RUN_EVERY_S = 2.0


class Watched:
    """Serves what an environment does until it is closed; says once, on stderr, where."""

    def __init__(self, definition: Definition) -> None:
        self._definition = definition
        self._page = WebServer(ADDRESS, 0)
        self._stream = Stream(ADDRESS, 0, MEMORY, None)
        self._page.start(ADDRESS, self._stream.port)
        self._recorder = Recorder("gymnasium")
        self._seed: int | None = None
        self._began = time.monotonic_ns()
        self._sent = self._told = 0
        rerun = f"rerun rerun+http://{ADDRESS}:{self._stream.port}/proxy"
        print(f"watch with: {rerun}, or in a browser: http://{ADDRESS}:{self._page.port}", file=sys.stderr)

    def see(self, moved: Moved, packet: FtPacket, world: World, seed: int) -> None:
        """Take a motion, what was felt after it, and where the peg is now."""
        if seed != self._seed:
            self._seed = seed
            self._recorder.experiment(_experiment(self._definition, seed))
            self._stream.begin(f"{self._definition.name}, seed {seed}", self._definition)
        self._recorder.ft(packet)
        self._recorder.truth(truth_of(world, moved))

    def show(self, reached: Reached | None) -> None:
        """Take what came of the motion, and send what there is when it is time."""
        if reached is not None and reached.reward is not None:
            self._recorder.reward(reached.reward)
        over = reached is not None and isinstance(reached.then, EpisodeSummary)
        if reached is not None and isinstance(reached.then, EpisodeSummary):
            self._recorder.episode(reached.then)
        now = time.monotonic_ns() - self._began
        if over or now - self._sent >= SEND_EVERY_S * 1e9:
            for item in self._recorder.flush(self._sent, now):
                self._stream.send(item)
            self._sent = now
        if now - self._told >= RUN_EVERY_S * 1e9:
            self._told = now
            for item in self._recorder.whole_run(now):
                self._stream.send(item)

    def close(self) -> None:
        """End."""
        self._stream.close()
        self._page.stop()


def _experiment(definition: Definition, seed: int) -> Experiment:
    return Experiment(
        run=run_id(definition, seed),
        seed=seed,
        definition=definition,
        definition_sha256=definition_sha256(definition),
        skill_sha256=None,
        first_policy_version=0,
        episodes=definition.episodes,
        episodes_done=0,
        decisions=0,
        phase="running",
    )
