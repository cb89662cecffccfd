"""A live cell that gets what it should not: it refuses, counts, goes on, and ends as one that was left in peace."""

from __future__ import annotations

import math
import queue
from collections.abc import Callable
from typing import Any

import msgpack
import msgspec
import pytest
import zenoh

from services.bus.session import open_client
from services.wire import keys as names
from services.wire.codec import decode, encode, encoding_of
from services.wire.messages import (
    Action,
    Checkpoint,
    EpisodeSummary,
    FtPacket,
    Home,
    JournalEpisode,
    Message,
    Move,
    Observation,
    Refusal,
    Reward,
    RunRecord,
    State,
)

EPISODES = 12
LOOP_KEYS: dict[str, tuple[type[Message], str]] = {
    names.FT: (FtPacket, "task"),
    names.OBSERVATION: (Observation, "classifier"),
    names.STATE: (State, "agent"),
    names.ACTION: (Action, "task"),
    names.REWARD: (Reward, "agent"),
}
GARBAGE = (b"", b"\xc1", b"\x00" * 1000, b"\x93\x01\x02\x03", b"\x81\xa3run\xc0", b"\xdf\xff\xff\xff\xff", b"[" * 5000)


class Rogue:
    """Somebody in the cell who hears all and may say anything."""

    def __init__(self, live: Any) -> None:
        self.live = live
        self.session: zenoh.Session = open_client([live.endpoint])
        self._declared: list[object] = []

    def put(self, name: str, payload: bytes, encoding: str) -> None:
        self.session.put(
            self.live.keys.of(name), payload, encoding=encoding, congestion_control=zenoh.CongestionControl.BLOCK
        )

    def say(self, name: str, message: Message) -> None:
        self.put(name, encode(message), encoding_of(type(message)))

    def say_fields(self, name: str, kind: type[Message], fields: dict[str, object]) -> None:
        self.put(name, msgpack.packb(fields), encoding_of(kind))

    def hear(self, name: str, kind: type[Message]) -> queue.SimpleQueue[Any]:
        heard: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._declared.append(
            self.session.declare_subscriber(
                self.live.keys.of(name),
                lambda sample: heard.put(decode(kind, sample.payload.to_bytes(), str(sample.encoding))),
            )
        )
        return heard

    def query(self, selector: str, payload: bytes = b"", encoding: str = "") -> list[Any]:
        """Return the refusals that a query gets; it must not get anything else."""
        key = self.live.keys.of(selector)
        replies = list(self.session.get(key, payload=payload, encoding=encoding, timeout=10.0))
        assert all(reply.ok is None for reply in replies), selector
        return [
            decode(Refusal, reply.err.payload.to_bytes(), str(reply.err.encoding))
            for reply in replies
            if reply.err is not None
        ]


@pytest.fixture
def rogue(live: Any) -> Any:
    made = Rogue(live)
    yield made
    made.session.close()  # type: ignore[no-untyped-call]


def test_garbage_on_every_key_is_refused_counted_and_changes_nothing(
    live: Any, rogue: Rogue, reference: Callable[..., dict[str, str]], wait_until: Callable[..., None]
) -> None:
    live.start_loop(EPISODES)
    live.wait_actions(20)
    before = {service: sum(live.refused(service).values()) for _, service in LOOP_KEYS.values()}
    counts = dict.fromkeys(before, 0)
    for name, (kind, service) in LOOP_KEYS.items():
        for payload in GARBAGE:
            rogue.put(name, payload, encoding_of(kind))
        rogue.put(name, b"{}", "application/json")
        rogue.put(name, b"", f"{encoding_of(kind)[:-1]}999")
        counts[service] += len(GARBAGE) + 2
    for service, count in counts.items():
        wait_until(
            f"{service} refuses {count}",
            lambda service=service, count=count: sum(live.refused(service).values()) >= before[service] + count,
        )
        assert {"BadPayloadError", "WrongTypeError", "WrongVersionError"} <= set(live.refused(service))
    for name, kind in ((names.MOVE, Move), (names.HOME, Home)):
        for payload in GARBAGE[1:]:
            (refusal,) = rogue.query(name, payload, encoding_of(kind))
            assert refusal.reason == "bad_request"
    assert live.refused("sim")["BadPayloadError"] == 2 * len(GARBAGE[1:])
    assert live.digests() == reference(EPISODES)


def test_well_formed_lies_are_refused_and_change_nothing(
    live: Any, rogue: Rogue, reference: Callable[..., dict[str, str]], wait_until: Callable[..., None]
) -> None:
    """Whoever is not the agent cannot act, even with the right numbers, and so for every role."""
    live.start_loop(EPISODES)
    observations, states = rogue.hear(names.OBSERVATION, Observation), rogue.hear(names.STATE, State)
    replace = msgspec.structs.replace
    for _ in range(60):
        seen, state = observations.get(timeout=60.0), states.get(timeout=60.0)
        step = {"run": seen.run, "episode": seen.episode, "step": seen.step, "decision": seen.decision}
        act = {"state": state.state, "action": seen.decision % 9}
        rogue.say(names.ACTION, Action(**step, **act, policy_version=seen.decision))
        rogue.say(names.STATE, replace(state, state=state.state + 5, states=99, decision=state.decision + 1))
        rogue.say(names.REWARD, Reward(**step, reward=777.0, terminal="inserted"))
        rogue.say(names.OBSERVATION, replace(seen, force_n=(9.0, 9.0, 9.0), decision=seen.decision + 1))
        t_ns = 2**61
        lie = FtPacket(sequence=seen.step, t_ns=t_ns, force_n=((0.0, 0.0, 0.0),), torque_nm=((0.0, 0.0, 0.0),))
        rogue.say(names.FT, lie)
    for service in ("task", "classifier", "agent"):
        wait_until(
            f"{service} counts strangers",
            lambda service=service: live.refused(service).get("StrangerError", 0) >= 60,
        )
    assert live.digests() == reference(EPISODES)


def test_other_runs_repetitions_and_the_future_change_nothing(
    live: Any, rogue: Rogue, reference: Callable[..., dict[str, str]]
) -> None:
    """What a delayed or doubled network would do: true messages of the cell, at the wrong time, and altered ones."""
    live.start_loop(EPISODES)
    kinds = {name: kind for name, (kind, _) in LOOP_KEYS.items() if name != names.FT}
    heard = {name: rogue.hear(name, kind) for name, kind in kinds.items()}
    replace = msgspec.structs.replace
    past: dict[str, list[Any]] = {name: [] for name in kinds}
    for turn in range(40):
        for name in kinds:
            message = heard[name].get(timeout=60.0)
            past[name].append(message)
            rogue.say(name, message)
            rogue.say(name, past[name][turn // 2])
            rogue.say(name, replace(message, run="another-run"))
            rogue.say(name, replace(message, decision=message.decision + 1000, episode=message.episode + 50))
            fields = msgspec.to_builtins(message)
            rogue.say_fields(name, kinds[name], fields | {"decision": -1})
            rogue.say_fields(name, kinds[name], fields | {"reward": math.nan, "match": math.nan})
            rogue.say_fields(name, kinds[name], fields | {"force_n": [math.nan, 0.0, 0.0]})
    assert live.digests() == reference(EPISODES)


def test_motions_of_a_stranger_are_undone(live: Any, rogue: Rogue, reference: Callable[..., dict[str, str]]) -> None:
    live.start_loop(EPISODES)
    live.wait_actions(3)
    experiment = live.experiment()
    run, start = experiment.run, experiment.definition.start
    at = {"x_mm": start.x_mm, "y_mm": start.y_mm, "z_mm": -start.height_mm}
    turned = {"rx_deg": start.rx_deg, "ry_deg": start.ry_deg, "rz_deg": start.rz_deg}
    for turn in range(12):
        live.wait_actions(3)
        home = Home(run=run, episode=turn, **at, **turned)
        request: dict[str, Any] = {"payload": encode(home), "encoding": encoding_of(Home)}
        assert [reply.ok is not None for reply in rogue.session.get(live.keys.of(names.HOME), **request)] == [True]
        elsewhere = msgspec.structs.replace(home, x_mm=5.0, z_mm=1.0)
        (refusal,) = rogue.query("home", encode(elsewhere), encoding_of(Home))
        assert refusal.reason == "guard"
        wild = Move(run=run, episode=turn, step=1, dx_mm=50.0)
        assert all(refusal.reason != "not_ready" for refusal in rogue.query("move", encode(wild), encoding_of(Move)))
    assert live.digests() == reference(EPISODES)


def test_the_store_refuses_what_would_not_load(
    live: Any, rogue: Rogue, reference: Callable[..., dict[str, str]], wait_until: Callable[..., None]
) -> None:
    live.start_loop(EPISODES)
    live.wait_actions(40)
    run = live.experiment().run
    stored = (
        f"journal/{run}/run",
        f"journal/{run}/latest",
        f"journal/{run}/000000/00000000",
        f"checkpoint/{run}/agent/latest",
        f"checkpoint/{run}/classifier/00000000",
    )
    summary = EpisodeSummary(
        run="other",
        episode=3,
        episode_return=0.0,
        moves=1,
        decisions=0,
        mean_force_n=0.0,
        peak_force_n=0.0,
        mean_torque_nm=0.0,
        peak_torque_nm=0.0,
        states=0,
        outcome="inserted",
    )
    foreign = JournalEpisode(run="other", episode=3, first_decision=0, steps=(), summary=summary)
    puts = 0
    for name in stored:
        for payload in GARBAGE:
            for kind in (RunRecord, JournalEpisode, Checkpoint):
                rogue.put(name, payload, encoding_of(kind))
                puts += 1
        rogue.put(name, b"text", "text/plain")
        rogue.say(name, foreign)
        puts += 2
    for wild in ("journal/**", "checkpoint/**", f"journal/{run}/*", f"journal/{run}/000000/*"):
        rogue.put(wild, b"text", "text/plain")
        puts += 1
    wait_until("the store refuses all", lambda: sum(live.refused("store").values()) >= puts)
    for victim in ("agent", "classifier", "task"):  # what they load from now on is what was stored
        live.processes[victim].popen.kill()
        live.processes[victim].end()
    live.start_loop(EPISODES, "task", "classifier", "agent")
    assert live.digests() == reference(EPISODES)


BAD_QUERIES = (
    "agent/policy",
    "agent/policy?state=",
    "agent/policy?state=-1",
    "agent/policy?state=seven",
    "agent/policy?state=99999999999999999999",
    "agent/policy?state=1;colour=red",
    "agent/q_table?format=xml",
    "agent/q_table?fromat=json",
    "classifier/states?state=1",
    "experiment?x",
    "task/steps?format=",
    "alive/task?format=yaml",
    "journal/**?format=xml",
)


def test_bad_queries_get_a_refusal(live: Any, rogue: Rogue) -> None:
    live.start_loop(1)
    live.wait_alive("task", "agent", "classifier")
    for selector in BAD_QUERIES:
        (refusal,) = rogue.query(selector)
        assert refusal.reason == "bad_request", selector
        assert "expected" in refusal.message, selector
