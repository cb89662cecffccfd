"""The task never takes silence for an empty store: nothing is put before the store has said what it has."""

from __future__ import annotations

from typing import Any

import pytest
from msgspec.structs import replace

from services.bus.fake_bus import FakeBus
from services.bus.testing import FakeService
from services.task.service import work
from services.wire.codec import decode, encoding_of
from services.wire.errors import CellError
from services.wire.keys import RUN, name_of
from services.wire.messages import RunRecord

SEED = 3


def record_in(bus: FakeBus, scene: Any) -> RunRecord:
    sample = bus.stored[scene.keys.run_record(scene.run)]
    return decode(RunRecord, sample.payload.to_bytes(), encoding_of(RunRecord))


@pytest.mark.parametrize("store_first", [True, False])
def test_a_run_of_another_contract_is_refused_in_either_order_and_nothing_is_overwritten(
    scene: Any, store_first: bool
) -> None:
    bus = FakeBus()
    other = replace(scene.record(), contract_sha256="bb" * 32)
    FakeService("store", bus, zid="5e").store(scene.keys.run_record(scene.run), other)
    bus.store_answers = store_first
    before = len(bus.published)
    task = scene.service("task", bus)
    task.later(3.0, lambda: setattr(bus, "store_answers", True))
    with pytest.raises(CellError, match=f"run {scene.run} was recorded with contract bbbbbbbbbbbb, this is"):
        task.run_for(lambda service: work(service, scene.definition, SEED, 5), 10.0)
    assert record_in(bus, scene) == other
    assert not [key for key, *_ in bus.published[before:] if "/journal/" in key or "/checkpoint/" in key]
    assert (task.clock.now() >= 1003.0) == (not store_first)


def test_a_task_without_a_store_puts_nothing_and_says_so(scene: Any) -> None:
    bus = FakeBus()
    bus.store_answers = False
    task = scene.service("task", bus)
    phases: list[str] = []
    task.later(2.0, lambda: phases.append(task.phase))
    task.run_for(lambda service: work(service, scene.definition, SEED, 5), 5.0)
    assert phases == ["waiting for store (it does not answer)"]
    assert not [key for key, *_ in bus.published if "/journal/" in key or "/checkpoint/" in key]


def test_a_store_that_has_nothing_gets_the_run(scene: Any) -> None:
    bus = FakeBus()
    task = scene.service("task", bus)
    task.run_for(lambda service: work(service, scene.definition, SEED, 5), 2.0)
    assert list(bus.stored) == [task.keys.of(name_of(RUN, run=scene.run))]
    assert record_in(bus, scene) == scene.record()
