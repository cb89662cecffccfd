"""The store's shell on a real file, and the viewer's with a stream that only notes what it is sent."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import pytest

from services.bus.fake_bus import FakeQuery
from services.bus.testing import FakeService
from services.store.database import Database
from services.store.retention import RetentionSettings
from services.store.service import StoreShell
from services.viewer.service import ViewerShell
from services.viewer.stream import Stream
from services.wire.codec import decode, encode, encoding_of
from services.wire.keys import ACTION, EXPERIMENT, NEWEST_ENTRY, REWARD, RUN, STATE, name_of
from services.wire.messages import JournalEpisode, RunRecord


@pytest.fixture
def store(scene: Any, tmp_path: Path) -> Iterator[tuple[FakeService, StoreShell]]:
    service = scene.service("store", None)
    with Database(tmp_path / "store.sqlite") as database:
        service.claim()
        shell = StoreShell(service, database, RetentionSettings())
        shell.open()
        yield service, shell


def answers(service: FakeService, selector: str) -> FakeQuery:
    query = service.ask(selector)
    service.settle()
    return query


def test_what_is_put_is_given_back_with_its_time_and_the_newest_counts(scene: Any, store: Any) -> None:
    service, _ = store
    latest = name_of(NEWEST_ENTRY, run=scene.run)
    task = scene.sessions["task"]
    service.hear(name_of(RUN, run=scene.run), scene.record(), task)
    for entry in scene.journal[:3]:
        service.hear(latest, entry, task)
    older = service.bus.stored[service.keys.of(latest)]
    query = answers(service, f"journal/{scene.run}/*")
    kept = {str(reply.ok.key_expr): reply.ok for reply in query.replies if reply.ok is not None}
    assert query.final
    assert set(kept) == {scene.keys.run_record(scene.run), scene.keys.journal_latest(scene.run)}
    newest = kept[scene.keys.journal_latest(scene.run)]
    assert decode(JournalEpisode, newest.payload.to_bytes(), str(newest.encoding)) == scene.journal[2]
    assert str(newest.timestamp) == str(older.timestamp)
    assert service.refused == {}


def test_what_does_not_follow_the_contract_is_refused_and_the_rest_is_kept(scene: Any, store: Any) -> None:
    service, shell = store
    task, latest = scene.sessions["task"], name_of(NEWEST_ENTRY, run=scene.run)
    service.hear_raw(latest, b"garbage", encoding_of(JournalEpisode), task)
    service.hear_raw("journal/no/such/key/at/all", encode(scene.record()), encoding_of(RunRecord), task)
    service.hear(latest, scene.journal[0], task)
    service.settle()
    assert len(shell.pending) == 1
    assert sum(service.refused.values()) == 2
    assert len(answers(service, f"journal/{scene.run}/*").replies) == 1


def test_an_unknown_format_is_refused_and_json_is_given(scene: Any, store: Any) -> None:
    service, _ = store
    latest = name_of(NEWEST_ENTRY, run=scene.run)
    service.hear(latest, scene.journal[0], scene.sessions["task"])
    service.settle()
    (refused,) = answers(service, f"{latest}?format=xml").replies
    assert refused.err is not None and b"expected json or msgpack" in refused.err.payload.to_bytes()
    (given,) = answers(service, f"{latest}?format=json").replies
    assert given.ok is not None and given.ok.payload.to_bytes().startswith(b"{")


class Notes:
    """A stream of which all that it is sent is noted."""

    def __init__(self) -> None:
        self.sent: list[object] = []
        self.scenes: list[object] = []

    def send(self, item: object) -> None:
        self.sent.append(item)

    def begin(self, *about: object) -> None:
        self.scenes.append(about)


def test_the_viewer_shows_what_it_hears_and_counts_what_it_cannot_read(scene: Any) -> None:
    viewer, notes = scene.service("viewer"), Notes()
    viewer.claim()
    shell = ViewerShell(viewer, cast(Stream, notes))
    for second in range(2):
        shell.second(second * 10**9)
        shell.step(second * 10**9, (second + 1) * 10**9)
    assert viewer.run == scene.run and len(notes.scenes) == 1
    before = len(notes.sent)
    viewer.hear(STATE, scene.states[0], scene.sessions["classifier"])
    viewer.hear(ACTION, scene.actions[0], scene.sessions["agent"])
    viewer.hear_raw(REWARD, b"\xc1", "text/plain")
    shell.step(2 * 10**9, 3 * 10**9)
    assert len(notes.sent) > before
    assert viewer.refused == {"WrongTypeError": 1}
    viewer.bus.answers.pop(EXPERIMENT)
    shell.second(3 * 10**9)  # nobody answers: nothing happens
    shell.step(3 * 10**9, 4 * 10**9)
