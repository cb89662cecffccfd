"""A live cell of real processes round a router of its own, and a session in it that is none of theirs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import zenoh

from services.bus.session import open_client
from services.rules.results import episodes_digest
from services.store.database import Database
from services.wire.codec import decode, encoding_of
from services.wire.errors import ContractError
from services.wire.keys import ACTION, CLASSIFIER_STATES, EXPERIMENT, Q_TABLE, Keys
from services.wire.messages import Alive, ClassifierStates, Experiment, JournalEpisode, Message, QTable

LOOP = ("task", "sim", "classifier", "agent")


@dataclass
class LiveCell:
    """Processes of one cell, and ways to ask it."""

    folder: Path
    run_module: Callable[..., Any]
    wait_until: Callable[..., None]
    definition: Path
    keys: Keys = field(default_factory=lambda: Keys("a"))
    processes: dict[str, Any] = field(default_factory=dict)
    _session: zenoh.Session | None = None

    @property
    def endpoint(self) -> str:
        """Return where the router listens."""
        return f"unixsock-stream/{self.folder}/z"

    @property
    def session(self) -> zenoh.Session:
        """Return the test's own session."""
        if self._session is None:
            self._session = open_client([self.endpoint], 30.0)
        return self._session

    def start(self, name: str, *options: str) -> Any:
        """Start a service."""
        where = ("--listen",) if name == "router" else ("--connect",)
        process = self.run_module(f"services.{name}", *where, self.endpoint, *options)
        self.processes[name] = process
        return process

    def start_store(self, *options: str) -> Any:
        """Start the store on the cell's file."""
        return self.start("store", "--file", str(self.folder / "store.sqlite"), *options)

    def edit_store(self, change: Callable[[Database], object]) -> None:
        """Stop the store if it runs, let its file be changed, and start it again."""
        running = self.processes.get("store")
        if running is not None and running.popen.poll() is None:
            running.popen.kill()
            running.end()
        with Database(self.folder / "store.sqlite") as database:
            change(database)
        self.start_store()

    def start_loop(self, episodes: int, *names: str) -> None:
        """Start the services of the learning loop, or those that are named."""
        for name in names or LOOP:
            task = ("--experiment", str(self.definition), "--seed", "1", "--episodes", str(episodes))
            self.start(name, *(task if name == "task" else ()))

    def ask(self, name: str, kind: type[Message], timeout_s: float = 5.0) -> Any:
        """Return the one good answer to a query, or None."""
        found = [reply.ok for reply in self.session.get(self.keys.of(name), timeout=timeout_s) if reply.ok is not None]
        if len(found) != 1:
            return None
        return decode(kind, found[0].payload.to_bytes(), str(found[0].encoding))

    def status(self, name: str) -> Alive | None:
        """Return what a service says of itself."""
        found: Alive | None = self.ask(f"alive/{name}", Alive)
        return found

    def refused(self, name: str) -> dict[str, int]:
        """Return what a service has refused."""
        status = self.status(name)
        return {} if status is None else dict(status.refused)

    def phase(self, name: str) -> str:
        """Return what a service is doing."""
        status = self.status(name)
        return "" if status is None else status.phase

    def experiment(self) -> Experiment | None:
        """Return what runs."""
        found: Experiment | None = self.ask(EXPERIMENT, Experiment)
        return found

    def done(self) -> int:
        """Return how many episodes are done."""
        experiment = self.experiment()
        return 0 if experiment is None else experiment.episodes_done

    def wait_alive(self, *names: str) -> None:
        """Wait until services have said that they are alive."""

        def alive() -> set[str]:
            replies = self.session.liveliness().get(self.keys.alive("*"), timeout=5.0)
            return {str(reply.ok.key_expr).rpartition("/")[2] for reply in replies if reply.ok is not None}

        self.wait_until(f"{', '.join(names)} alive", lambda: alive() >= set(names))

    def wait_actions(self, count: int) -> None:
        """Wait until the agent has acted so often from now on."""
        seen: list[zenoh.Sample] = []
        subscriber = self.session.declare_subscriber(self.keys.of(ACTION), seen.append)
        self.wait_until(f"{count} actions", lambda: len(seen) >= count)
        subscriber.undeclare()  # type: ignore[no-untyped-call]

    def digests(self) -> dict[str, str]:
        """Wait for the end of the run and return what was learnt and logged in it."""
        self.wait_until("the run ends", lambda: self.phase("task") == "finished")
        experiment = self.experiment()
        assert experiment is not None
        found: dict[str, Any] = {}

        def settled() -> bool:
            try:
                found["q"] = self.ask(Q_TABLE, QTable)
                found["art2"] = self.ask(CLASSIFIER_STATES, ClassifierStates)
            except ContractError:
                return False
            learnt = [answer.decisions for answer in found.values() if answer is not None]
            version = experiment.first_policy_version + experiment.decisions
            return learnt == [experiment.decisions] * 2 and found["q"].policy_version == version

        self.wait_until("all is learnt", settled)
        replies = self.session.get(self.keys.of(f"journal/{experiment.run}/*/*"), timeout=10.0)
        samples = sorted((reply.ok for reply in replies if reply.ok is not None), key=lambda ok: str(ok.key_expr))
        entries = [decode(JournalEpisode, ok.payload.to_bytes(), encoding_of(JournalEpisode)) for ok in samples]
        summaries = [entry.summary for entry in entries if entry.summary is not None]
        assert len(summaries) == experiment.episodes
        return {
            "q_table": found["q"].digest,
            "art2": found["art2"].digest,
            "episodes": episodes_digest(summaries),
        }

    def close(self) -> None:
        """Close the test's session."""
        if self._session is not None:
            self._session.close()  # type: ignore[no-untyped-call]


@pytest.fixture
def house(
    short_path: Path, run_module: Callable[..., Any], wait_until: Callable[..., None], small: Path
) -> Iterator[LiveCell]:
    """A cell with a router, and nothing else yet."""
    made = LiveCell(short_path, run_module, wait_until, small)
    made.start("router")
    yield made
    made.close()


@pytest.fixture
def live(house: LiveCell) -> LiveCell:
    """A cell with router and store."""
    house.start_store()
    house.wait_alive("store")
    return house
