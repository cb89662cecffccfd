"""A living cell under hostile payloads on every key and in every query of the contract: it refuses, counts, goes on.

TREENAIL_FUZZ_CELL is how many inputs are thrown at it; ``make fuzz`` throws more than the tests do.
"""

from __future__ import annotations

import json
import os
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from typing import Any

import pytest
import zenoh

from experiments.fuzz.mutate import TEXTS, Node, mutate_payload, mutate_text
from experiments.fuzz.sound import small_run
from services.bus.session import open_client
from services.store.contents import check
from services.wire import keys as names
from services.wire.codec import ENCODING_PREFIX, decode, encode, encoding_of
from services.wire.errors import ContractError
from services.wire.keys import CONTRACT
from services.wire.messages import MESSAGES, Alive, Message, Refusal, SwapRequest

INPUTS = int(os.environ.get("TREENAIL_FUZZ_CELL", "2000"))
BATCHES = 40
EPISODES = 40 if INPUTS <= 2000 else 120
SERVICES = ("task", "sim", "classifier", "agent", "store", "viewer")
HEARD_BY = {
    names.FT: "task",
    names.OBSERVATION: "classifier",
    names.STATE: "agent",
    names.ACTION: "task",
    names.REWARD: "agent",
}
"""Who hears a key and lets nobody but its role's holder speak there. The viewer hears everybody, and may drop some."""
STORED = ("journal/", "checkpoint/")
OTHER_RUNS = 8
LARGE = 24_000_000
"""Bytes of a large payload: more than any message may have."""
MOST_GROWTH_BYTES = 48_000_000
PARAMETERS = (
    "",
    "format=json",
    "state=7",
    "ft=0.2,0,-1.5,0,0.02,0",
    "ft=0.2,0,-1.5,0,0.02,0;format=json",
    "_time=[now(-1h)..]",
)
WORDS = ("=", ";", ",", "format=", "state=", "ft=", "xml", "nan", "1e999", "9" * 400, "\u0667", *TEXTS)


def expanded(key: str, run: str, rng: Random) -> str:
    """Return a key of the contract with something in its blanks."""
    return names.name_of(
        key,
        run=run,
        service=rng.choice(SERVICES),
        episode=rng.randrange(EPISODES),
        sha256="0f" * 32,
        instance="00000000000000000001-0f",
    )


def first_type(row: names.Row) -> type[Message]:
    """Return what a key is put or asked with."""
    return row.types[0] if row.types else Alive


@dataclass
class Enemy:
    """Somebody in the cell who may say and ask anything, and keeps count of what has to be refused."""

    live: Any
    run: str
    rng: Random
    session: zenoh.Session
    refused: Counter[str] = field(default_factory=Counter)
    """By service: inputs that it has to have counted as refused."""
    sent: Counter[str] = field(default_factory=Counter)
    """By key of the contract: puts and queries."""
    answers: Counter[str] = field(default_factory=Counter)

    def __post_init__(self) -> None:
        found = small_run().trees
        self.trees = {kind: [self._of_this_run(tree) for tree in trees] for kind, trees in found.items()}

    def _of_this_run(self, tree: Node) -> Node:
        return {**tree, "run": self.run} if isinstance(tree, dict) and "run" in tree else tree

    def act(self) -> None:
        """Do one hostile thing."""
        key, row = self.rng.choice(list(CONTRACT.items()))
        kinds, kind = row.kind, first_type(row)
        self.sent[key] += 1
        if "query" in kinds and ("put" not in kinds or self.rng.random() < 0.5):
            self.ask(expanded(key, self.run, self.rng), kind)
        elif key.startswith(STORED):
            self.store(key, kind)
        else:
            self.say(expanded(key, self.run, self.rng), *self.payload(kind))

    def payload(self, kind: type[Message]) -> tuple[bytes, str]:
        """Return a hostile payload of a kind and its encoding."""
        encoding = encoding_of(kind)
        if self.rng.random() < 0.1:
            # Zenoh panics, in who sends, at an encoding of more than 255 bytes.
            wrong = ("", "application/json", f"{encoding[:-1]}99", f"{ENCODING_PREFIX}State.v", "x" * 250)
            encoding = self.rng.choice((*wrong, encoding_of(self.rng.choice(MESSAGES))))
        return mutate_payload(self.rng, self.trees[kind]), encoding

    def say(self, name: str, payload: bytes, encoding: str) -> None:
        """Put something on a key, where whoever hears it has to refuse it: nobody here holds a role."""
        self.session.put(
            self.live.keys.of(name), payload, encoding=encoding, congestion_control=zenoh.CongestionControl.BLOCK
        )
        if name in HEARD_BY:
            self.refused[HEARD_BY[name]] += 1

    def store(self, key: str, kind: type[Message]) -> None:
        """Put something where the store keeps it: of this run what it has to refuse, of others anything."""
        payload, encoding = self.payload(kind)
        name = expanded(key, self.run, self.rng)
        if self.rng.random() < 0.3:
            name = expanded(key, f"enemy-{self.rng.randrange(OTHER_RUNS)}", self.rng)
        try:
            check(name, payload, encoding)
        except ContractError:
            self.refused["store"] += 1
        else:
            if self.run in name or name.startswith("checkpoint/skill/"):
                return  # that would be a good one, and overwrite what is there
        self.say(name, payload, encoding)

    def ask(self, name: str, kind: type[Message]) -> None:
        """Ask a key with hostile parameters or a hostile payload: it has to be answered, or refused and counted."""
        parameters = self.rng.choice(PARAMETERS)
        if self.rng.random() < 0.7:
            parameters = mutate_text(self.rng, parameters, WORDS)
        payload, encoding = self.payload(kind) if self.rng.random() < 0.6 else (b"", "")
        if name == names.SWAP and self._sound(payload, encoding):
            payload = payload[:-1]  # a good one would swap
        try:
            selector = zenoh.Selector(self.live.keys.of(name), parameters)
            replies = list(self.session.get(selector, payload=payload, encoding=encoding, timeout=20.0))
        except zenoh.ZError:  # Zenoh itself does not send that
            self.answers["not sent"] += 1
            return
        owner = name.rpartition("/")[2] if name.startswith("alive/") else self._owner(name)
        for reply in replies:
            self._note(reply, owner, f"{name}?{parameters}")
        if owner != "store":
            assert len(replies) == 1, f"{name}?{parameters}: expected one answer, got {len(replies)}"

    def _note(self, reply: zenoh.Reply, owner: str, what: str) -> None:
        if reply.ok is not None:
            self.answers["answered"] += 1
            return
        assert reply.err is not None
        payload, encoding = reply.err.payload.to_bytes(), str(reply.err.encoding)
        if encoding == "application/json":
            reason = json.loads(payload)["reason"]
        else:
            reason = decode(Refusal, payload, encoding).reason
        assert reason in ("bad_request", "foreign_run", "out_of_order", "guard", "not_ready"), what
        self.answers[f"refused: {reason}"] += 1
        self.refused[owner] += 1

    def _sound(self, payload: bytes, encoding: str) -> bool:
        try:
            decode(SwapRequest, payload, encoding)
        except ContractError:
            return False
        return True

    def _owner(self, name: str) -> str:
        if name.startswith(STORED):
            return "store"
        first = name.partition("/")[0]
        return {"move": "sim", "home": "sim", "resume": "sim", "experiment": "task", "swap": "task"}.get(first, first)


@pytest.fixture
def whole(live: Any) -> Any:
    """A cell with everything that there is."""
    live.start("viewer", "--bind", "127.0.0.1", "--port", "0", "--no-web")
    live.start_loop(EPISODES)
    live.wait_alive("viewer")
    live.wait_actions(20)
    return live


@pytest.fixture
def enemy(whole: Any) -> Iterator[Enemy]:
    session = open_client([whole.endpoint])
    yield Enemy(whole, whole.experiment().run, Random(int(os.environ.get("TREENAIL_FUZZ_SEED", "1"))), session)
    session.close()  # type: ignore[no-untyped-call]


def instances(live: Any) -> dict[str, object]:
    """Return which process is which, as the processes themselves say."""
    found = {name: live.status(name) for name in SERVICES}
    return {name: (status.pid, status.instance, status.started_t_ns) for name, status in found.items()}


def resident_bytes(live: Any) -> dict[str, int]:
    """Return how much memory each process has, the router among them."""
    pages = {
        name: int(Path(f"/proc/{process.popen.pid}/statm").read_text().split()[1])
        for name, process in live.processes.items()
    }
    return {name: count * 4096 for name, count in pages.items()}


def unharmed(live: Any, before: dict[str, object]) -> None:
    """Check that every process is the one that it was, and has not complained beyond its log."""
    assert instances(live) == before
    for name, process in live.processes.items():
        assert process.popen.poll() is None, f"{name} ended"
        assert process.err == "", name
        assert "Traceback" not in process.out, name


def shown_as_refused(live: Any, run_module: Callable[..., Any]) -> dict[str, int]:
    """Return what ``treenail status`` says that each service has refused."""
    process = run_module("treenail.__main__", "status", "--json", "--connect", live.endpoint)
    assert process.end() == 0, process.err
    return {row["service"]: row["refused"] for row in json.loads(process.out)["services"]}


def test_hostile_input_on_every_key_and_in_every_query_changes_nothing(
    whole: Any,
    enemy: Enemy,
    run_module: Callable[..., Any],
    reference: Callable[..., dict[str, str]],
    wait_until: Callable[..., None],
) -> None:
    before = instances(whole)
    acted: list[object] = []
    subscriber = enemy.session.declare_subscriber(whole.keys.of(names.ACTION), acted.append)
    middle: dict[str, int] = {}
    for batch in range(BATCHES):
        if batch == BATCHES // 2:
            middle = resident_bytes(whole)
        for _ in range(-(-INPUTS // BATCHES)):
            enemy.act()
        count = len(acted)
        wait_until("the cell goes on", lambda count=count: len(acted) > count or whole.phase("task") == "finished")
    subscriber.undeclare()  # type: ignore[no-untyped-call]
    assert whole.digests() == reference(EPISODES)
    unharmed(whole, before)
    assert set(enemy.sent) == set(CONTRACT)
    wait_until(
        "all refusals are counted",
        lambda: all(sum(whole.refused(name).values()) >= count for name, count in enemy.refused.items()),
    )
    shown = shown_as_refused(whole, run_module)
    assert set(enemy.refused) == set(SERVICES)
    for name, count in enemy.refused.items():
        assert shown[name] >= count > 0, name
    after = resident_bytes(whole)
    grown = {name: size - middle[name] for name, size in after.items()}
    print(f"\n{enemy.sent.total()} inputs on {len(enemy.sent)} keys; queries: {dict(sorted(enemy.answers.items()))}")
    for name in SERVICES:
        counts = ", ".join(f"{count} {error}" for error, count in sorted(whole.refused(name).items()))
        print(f"{name:<10}  {after[name] / 1e6:6.1f} MB, {grown[name] / 1e6:+5.1f} since half-way; refused: {counts}")
    assert max(grown.values()) < MOST_GROWTH_BYTES, grown


def answered(live: Any, enemy: Enemy, name: str, payload: bytes) -> bool:
    """Ask up to three times, as our clients do: who takes long to read so much may lose his connection meanwhile."""
    for _ in range(3):
        replies = list(enemy.session.get(live.keys.of(name), payload=payload, encoding="x/y", timeout=30.0))
        if len(replies) == 1:
            return True
        time.sleep(1.0)
    return False


def throw_large(live: Any, enemy: Enemy) -> None:
    """Put something far too large on every key, and into every query; ask what is far too long."""
    large = b"\x81\xa3run\xdd" + LARGE.to_bytes(4, "big") + b"\x90" * LARGE
    for key, row in CONTRACT.items():
        kinds, kind, name = row.kind, first_type(row), expanded(key, enemy.run, enemy.rng)
        if "query" not in kinds or key.startswith(STORED):
            # Not counted: so much may find no room on its way, and is then lost (decision 3).
            enemy.session.put(live.keys.of(name), large, encoding=encoding_of(kind))
        if "query" in kinds and not key.startswith(STORED):
            assert answered(live, enemy, name, large), name
    for long in ("ft=" + "1" * 50_000, "state=1;" * 7000 + "x"):
        (reply,) = enemy.session.get(live.keys.of(f"{names.POLICY}?{long}"), timeout=30.0)
        assert reply.ok is None
        enemy.refused["agent"] += 1
    assert list(enemy.session.get(live.keys.of("journal/" + "x" * 50_000), timeout=30.0)) == []


def test_what_is_far_too_large_is_refused_and_not_kept(
    whole: Any, enemy: Enemy, reference: Callable[..., dict[str, str]], wait_until: Callable[..., None]
) -> None:
    """What the C library keeps of the first time, it uses for the second."""
    before = instances(whole)
    throw_large(whole, enemy)
    first = resident_bytes(whole)
    throw_large(whole, enemy)
    wait_until(
        "all refusals are counted",
        lambda: all(sum(whole.refused(name).values()) >= count for name, count in enemy.refused.items()),
    )
    assert whole.digests() == reference(EPISODES)
    unharmed(whole, before)
    grown = {name: size - first[name] for name, size in resident_bytes(whole).items()}
    assert max(grown.values()) < MOST_GROWTH_BYTES, grown


@pytest.mark.parametrize("seconds", [1, 2**31, 2**32 - 1], ids=["1970", "2038", "2106"])
def test_a_message_from_another_time_stops_nobody(
    whole: Any, enemy: Enemy, reference: Callable[..., dict[str, str]], seconds: int
) -> None:
    """Zenoh's clocks follow the timestamps that they see, and its time ends in 2106."""
    before = instances(whole)
    stamp = zenoh.Timestamp(zenoh.NTP64(seconds, 999_999_999), bytes([7] * 8))
    for name in (*HEARD_BY, "journal/enemy/run", "heartbeat/task"):
        enemy.session.put(whole.keys.of(name), b"x", encoding="text/plain", timestamp=stamp)
    assert whole.digests() == reference(EPISODES)
    unharmed(whole, before)


LIES = (
    (True, b"\xc1", encoding_of(Alive)),
    (True, b"{}", "application/json"),
    (True, b"", ""),
    (False, b"[]", "application/json"),
    (False, b"{", "application/json"),
    (False, b"[" * 100_000, "application/json"),
    (False, b"\xc1", encoding_of(Refusal)),
    (False, encode(Refusal(reason="guard", message="\x1b[2J\nnothing to see")), encoding_of(Refusal)),
    (False, b"\x1b[2J\xff", "text/plain"),
)
"""Answers that nobody of ours gives: a good one or an error, payload, encoding."""


def test_status_shows_a_cell_in_which_somebody_answers_with_rubbish(
    whole: Any, enemy: Enemy, run_module: Callable[..., Any]
) -> None:
    declared: list[object] = []
    for number, lie in enumerate(LIES):
        key = whole.keys.alive(f"liar-{number}")

        def answer(query: zenoh.Query, key: str = key, lie: tuple[bool, bytes, str] = lie) -> None:
            good, payload, encoding = lie
            with query:
                if good:
                    query.reply(key, payload, encoding=encoding)
                else:
                    query.reply_err(payload, encoding=encoding)

        declared.append(enemy.session.declare_queryable(key, answer))
    for words in (("status",), ("status", "--json")):
        process = run_module("treenail.__main__", *words, "--connect", whole.endpoint)
        assert process.end() == 0, process.err
        assert process.err == ""
        assert all(name in process.out for name in SERVICES)
        assert "\x1b[2J" not in process.out
