"""A cell in which something is missing waits, says for what, and goes on when it comes."""

from __future__ import annotations

import itertools
import signal
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import pytest

from services.store.database import Database
from services.store.sqlite_file import StoreFullError
from services.store.values import Put, StoredValue
from services.wire.codec import decode, encode, encoding_of
from services.wire.keys import ACTION, OBSERVATION, TASK_STEPS
from services.wire.messages import Action, Checkpoint, JournalEpisode, Message, Observation, RunRecord

EPISODES = 12
Reference = Callable[..., dict[str, str]]


def test_without_a_store_all_wait_and_say_so(house: Any, wait_until: Callable[..., None], reference: Reference) -> None:
    house.start_loop(EPISODES)
    wait_until("the task says so", lambda: house.phase("task").startswith("waiting for store"))
    for name in ("classifier", "agent"):
        wait_until(f"the {name} says so", lambda name=name: house.phase(name).startswith("waiting for"))
    assert "waiting for store" in house.processes["task"].out
    assert house.done() == 0
    house.start_store()
    assert house.digests() == reference(EPISODES)


@pytest.mark.parametrize("missing", ["sim", "classifier", "agent"])
def test_whoever_is_missing_is_waited_for(live: Any, wait_until: Callable[..., None], missing: str) -> None:
    others = [name for name in ("task", "sim", "classifier", "agent") if name != missing]
    live.start_loop(3, *others)
    name = {"sim": "robot"}.get(missing, missing)
    wait_until(f"it waits for the {name}", lambda: f"waiting for {name}" in live.phase("task"))
    live.start_loop(3, missing)
    wait_until("it ends", lambda: live.phase("task") == "finished")


def test_a_store_that_dies_and_comes_back_loses_nothing(
    live: Any, wait_until: Callable[..., None], reference: Reference
) -> None:
    live.start_loop(EPISODES)
    for _ in range(3):
        live.wait_actions(20)
        live.processes["store"].popen.kill()
        live.processes["store"].end()
        wait_until("the task misses it", lambda: live.phase("task").startswith("waiting for store"))
        live.start_store()
        live.wait_alive("store")
    assert live.digests() == reference(EPISODES)


def test_a_worker_that_starts_while_the_store_is_away_waits_for_it(
    live: Any, wait_until: Callable[..., None], reference: Reference
) -> None:
    live.start_loop(EPISODES)
    live.wait_actions(60)
    for name in ("store", "agent", "classifier", "task"):
        live.processes[name].popen.kill()
        live.processes[name].end()
    live.start_loop(EPISODES, "task", "agent", "classifier")
    wait_until("the task waits", lambda: live.phase("task").startswith("waiting for store"))
    for name in ("agent", "classifier"):
        wait_until(f"the {name} waits", lambda name=name: live.phase(name).startswith("waiting for"))
    live.start_store()
    assert live.digests() == reference(EPISODES)


def fill(house: Any) -> None:
    """Put large and ever smaller values into a store's file until nothing fits any more."""
    with Database(house.folder / "store.sqlite", max_bytes=1 << 20) as database:
        for size in (64 * 1024, 8 * 1024, 1024, 100):
            with suppress(StoreFullError):
                for number in itertools.count():
                    key = house.keys.of(f"journal/ballast/{size}/{number}")
                    database.apply([Put(key, bytes(size), "zenoh/bytes", f"{1:016x}/{'01' * 16}")])


def test_a_full_store_stops_the_run_until_there_is_room(
    house: Any, wait_until: Callable[..., None], reference: Reference
) -> None:
    fill(house)
    store = house.start_store("--max-bytes", str(1 << 20))
    house.wait_alive("store")
    house.start_loop(EPISODES)
    wait_until("the run waits", lambda: house.phase("task").startswith("waiting for store"))
    wait_until("the store says why", lambda: house.phase("store").startswith("cannot write"))
    assert "not stored" in store.out
    assert store.stop(signal.SIGTERM) == 0
    house.start_store("--max-bytes", str(64 << 20))
    assert house.digests() == reference(EPISODES)


def test_a_file_that_is_deleted_under_a_living_store_holds_the_cell_and_is_saved(
    live: Any, wait_until: Callable[..., None], reference: Reference
) -> None:
    live.start_loop(EPISODES)
    live.wait_actions(40)
    file = live.folder / "store.sqlite"
    file.unlink()
    wait_until("the store says so", lambda: live.phase("store").startswith(f"cannot write: {file}"))
    wait_until("the run waits", lambda: live.phase("task").startswith(f"waiting for store ({file}: expected the file"))
    at = live.done()
    rescued = file.with_name("store.sqlite.rescued")
    wait_until("it is saved", rescued.exists)
    live.processes["store"].popen.kill()
    live.processes["store"].end()
    live.start_store()  # with an empty file: not the run's
    wait_until("the run waits for its own", lambda: "it has lost run" in live.phase("task"))
    assert live.done() == at
    live.processes["store"].popen.kill()
    live.processes["store"].end()
    for path in live.folder.glob("store.sqlite-*"):
        path.unlink()
    rescued.rename(file)
    live.start_store()
    assert live.digests() == reference(EPISODES)


def test_a_file_that_is_no_store_is_one_line(house: Any) -> None:
    (house.folder / "store.sqlite").write_bytes(b"SQLite format 3\0" + bytes(2000))
    process = house.start_store()
    assert process.end() == 2
    (line,) = process.err.splitlines()
    assert line.startswith("treenail store: store: ")


def test_a_router_that_starts_again_brings_all_back(live: Any, reference: Reference) -> None:
    live.start_loop(EPISODES)
    for _ in range(3):
        live.wait_actions(15)
        live.processes["router"].popen.kill()
        live.processes["router"].end()
        (live.folder / "z").unlink(missing_ok=True)  # what a killed router leaves of a socket in the file system
        live.start("router")
        live.wait_alive("task", "sim", "classifier", "agent", "store")
    assert live.digests() == reference(EPISODES)


def test_a_run_recorded_with_another_contract_is_refused(live: Any, wait_until: Callable[..., None]) -> None:
    live.start_loop(1)
    live.digests()
    run = live.experiment().run
    assert live.processes["task"].stop() == 0
    ours, key = live.status("agent").contract_sha256.encode(), live.keys.run_record(run)

    def age(store: Database) -> None:
        (record,) = store.get(key).values
        store.prune([key])
        store.apply([Put(*record._replace(payload=record.payload.replace(ours, b"0" * 64)))])

    live.edit_store(age)

    def aged() -> bool:
        record = live.ask(f"journal/{run}/run", RunRecord)
        return record is not None and record.contract_sha256 == "0" * 64

    wait_until("the store has it", aged)
    live.start_loop(1, "task")
    assert live.processes["task"].end() == 2
    (line,) = live.processes["task"].err.splitlines()
    assert "was recorded with contract 000000000000" in line


def test_a_worker_asks_the_task_for_what_it_missed(live: Any, reference: Reference) -> None:
    """The steps of the episode under way are nowhere but in the task: whoever starts in its middle gets them there."""
    live.start_loop(EPISODES)
    live.wait_actions(30)
    under_way = live.ask(TASK_STEPS, JournalEpisode)
    assert encode(under_way)
    for name in ("agent", "classifier"):
        live.processes[name].popen.kill()
    live.start_loop(EPISODES, "classifier", "agent")
    assert live.digests() == reference(EPISODES)


# -- never on a blank memory ---------------------------------------------------------------------------------------


def kill(live: Any, *services: str) -> None:
    for name in services:
        live.processes[name].popen.kill()
        live.processes[name].end()


def put(live: Any, key: str, message: Message) -> None:
    live.session.put(key, encode(message), encoding=encoding_of(type(message)))


def test_without_an_answer_from_the_store_a_worker_waits_and_the_task_says_that_it_has_no_memory(
    live: Any, wait_until: Callable[..., None], reference: Reference
) -> None:
    live.start_loop(EPISODES)
    live.wait_actions(30)
    kill(live, "agent", "classifier")
    wait_until("the task misses them", lambda: live.phase("task") == "waiting for agent and classifier")
    kill(live, "store")
    live.start_loop(EPISODES, "agent")
    wait_until("it says why", lambda: live.phase("task") == "waiting for agent (no checkpoint) and classifier")
    assert live.phase("agent") == "waiting for store (it does not answer)"
    live.start_loop(EPISODES, "classifier")
    both = "waiting for agent (no checkpoint) and classifier (no checkpoint)"
    wait_until("it says so of both", lambda: live.phase("task") == both)
    live.start_store()
    assert live.digests() == reference(EPISODES)


def test_a_checkpoint_that_cannot_be_gone_on_with_is_passed_over(
    live: Any, wait_until: Callable[..., None], reference: Reference
) -> None:
    name = "classifier"  # the agent's: tests/unit/shells
    live.start_loop(EPISODES)
    live.wait_actions(60)
    kill(live, name)
    run, key = live.experiment().run, live.keys.checkpoint_latest(live.experiment().run, name)
    useless = Checkpoint(
        run=run,
        service=name,
        episode=1,
        decisions=5,
        contract_sha256=live.status("task").contract_sha256,
        snapshot={"q": b"\xff" * 7, "states": 3},
    )
    stamp = f"{2**63:016x}/{'01' * 16}"
    live.edit_store(lambda store: store.apply([Put(key, encode(useless), encoding_of(Checkpoint), stamp)]))
    live.start_loop(EPISODES, name)
    assert live.digests() == reference(EPISODES)
    assert "checkpoint before episode 1 is passed over" in live.processes[name].out


def test_without_checkpoint_and_with_a_journal_that_has_lost_its_beginning_a_worker_waits(
    live: Any, wait_until: Callable[..., None], reference: Reference
) -> None:
    live.start_loop(EPISODES)
    wait_until("some episodes are done", lambda: live.done() >= 3)
    kill(live, "agent")
    key = live.keys.journal(live.experiment().run, 0)
    lost: list[StoredValue] = []

    def lose(store: Database) -> None:
        lost.extend(store.get(key).values)
        store.prune([key])

    live.edit_store(lose)
    live.start_loop(EPISODES, "agent")
    wait_until("the task says so", lambda: live.phase("task") == "waiting for agent (no checkpoint)")
    wait_until("it says why", lambda: "neither checkpoint nor journal has decisions" in live.phase("agent"))
    live.edit_store(lambda store: store.apply([Put(*value) for value in lost]))
    assert live.digests() == reference(EPISODES)


def test_an_agent_that_knows_less_than_the_run_has_seen_is_refused(live: Any, wait_until: Callable[..., None]) -> None:
    """The test is the agent here, first with a policy of some age, then with a blank one, also towards a new task."""
    live.start_loop(EPISODES, "task", "sim", "classifier")
    asked: list[Observation] = []
    declared = live.session.declare_subscriber(
        live.keys.of(OBSERVATION),
        lambda sample: asked.append(decode(Observation, sample.payload.to_bytes(), str(sample.encoding))),
    )

    def act(seen: Observation, version: int) -> None:
        place: dict[str, Any] = {"run": seen.run, "episode": seen.episode, "step": seen.step, "decision": seen.decision}
        put(live, live.keys.of(ACTION), Action(**place, state=0, action=seen.decision % 4, policy_version=version))

    def decide_until(holds: Callable[[Observation], bool]) -> Observation:
        """Act with an up-to-date policy on whatever is asked, until something is asked that ends it."""
        while True:
            wait_until("something is asked", lambda: bool(asked))
            newest = asked[-1]
            if holds(newest):
                return newest
            act(newest, newest.decision)
            wait_until("it goes on", lambda newest=newest: asked[-1].decision > newest.decision)

    seen = decide_until(lambda newest: newest.decision >= 8)
    for old in (0, seen.decision - 2):
        refused = live.refused("task").get("DivergedError", 0)
        act(seen, old)
        wait_until("it is refused", lambda refused=refused: live.refused("task").get("DivergedError", 0) > refused)
        assert asked[-1].decision == seen.decision
    assert "expected a policy of version 7 to 8, got 0" in live.processes["task"].out

    # What the journal has seen, another process of the task has seen: begin an episode, and start that task anew.
    first = decide_until(lambda newest: newest.episode > seen.episode)
    kill(live, "task")
    asked.clear()
    live.start_loop(EPISODES, "task")
    wait_until("the new task asks", lambda: bool(asked))
    assert asked[-1].decision == first.decision
    act(asked[-1], 0)
    wait_until("it is refused again", lambda: live.refused("task").get("DivergedError", 0) > 0)
    assert asked[-1].decision == first.decision
    act(asked[-1], first.decision)
    wait_until("it goes on", lambda: asked[-1].decision > first.decision)
    declared.undeclare()
