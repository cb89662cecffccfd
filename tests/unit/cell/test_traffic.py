"""Traffic: rates, latencies and pace are those of the messages, whatever else arrives; memory is bounded."""

from __future__ import annotations

import itertools
import random
from typing import Any

import pytest

from services.cell.traffic import LEGS, MAX_NAMES, MAX_OPEN, MAX_TIMED, OTHERS, Published, Traffic
from services.wire.codec import encode, encoding_of
from services.wire.keys import ACTION, EPISODE, OBSERVATION, REWARD, STATE
from services.wire.messages import (
    Action,
    Alive,
    EpisodeSummary,
    LoopMessage,
    Message,
    Observation,
    Reward,
    State,
)
from tests.unit.heartbeats import alive

RUN = "r-s0"
SENT_US = {OBSERVATION: 0, STATE: 300, ACTION: 500, REWARD: 1700}
EXPECTED_US = {"classifier": 300, "agent": 200, "robot": 1200, "decision": 1700}


def loop(name: str, decision: int, episode: int = 0, step: int = 0, run: str = RUN) -> LoopMessage:
    place: dict[str, Any] = {"run": run, "episode": episode, "step": step, "decision": decision}
    match name:
        case "observation":
            return Observation(force_n=(0.0, 0.0, -1.0), torque_nm=(0.0, 0.0, 0.0), **place)
        case "state":
            return State(state=0, states=1, match=1.0, **place)
        case "action":
            return Action(state=0, action=1, policy_version=decision, **place)
        case _:
            return Reward(reward=-1.0, terminal=None, **place)


def published(name: str, message: Message, sent_ns: int | None = None) -> Published:
    return Published(name, encode(message), encoding_of(type(message)), sent_ns)


def summary(episode: int, moves: int, gain: float = -5.0, run: str = RUN) -> EpisodeSummary:
    return EpisodeSummary(
        run=run, episode=episode, episode_return=gain, moves=moves, decisions=1, mean_force_n=1.0, peak_force_n=1.0,
        mean_torque_nm=0.1, peak_torque_nm=0.1, states=1, outcome="inserted",
    )  # fmt: skip


def of_agent(handled: int, instance: str = "x", **refused: int) -> Alive:
    return alive("agent", handled=handled, instance=instance, refused=refused)


@pytest.fixture
def traffic() -> Traffic:
    return Traffic(100.0, marks=1)


def decide(traffic: Traffic, decision: int, order: tuple[str, ...] = tuple(SENT_US), began_ns: int = 10**18) -> None:
    for name in order:
        traffic.take(published(name, loop(name, decision), began_ns + 1000 * SENT_US[name]), 101.0)


def medians(traffic: Traffic) -> dict[str, float | None]:
    return {leg: None if found is None else found[1] for leg, found in traffic.latency_us().items()}


@pytest.mark.parametrize("order", list(itertools.permutations(SENT_US)))
def test_legs_are_timed_in_whatever_order_messages_come(traffic: Traffic, order: tuple[str, ...]) -> None:
    decide(traffic, 7, order)
    assert medians(traffic) == EXPECTED_US


def test_a_decision_that_lacks_a_message_is_not_timed(traffic: Traffic) -> None:
    for left_out in SENT_US:
        decide(traffic, 7, tuple(name for name in SENT_US if name != left_out))
        traffic = Traffic(100.0, marks=1)
    assert medians(traffic) == dict.fromkeys(LEGS)


def test_a_message_that_is_repeated_counts_as_first_sent(traffic: Traffic) -> None:
    traffic.take(published(OBSERVATION, loop(OBSERVATION, 7), 10**18), 101.0)
    decide(traffic, 7, began_ns=10**18 + 10**9)
    found = medians(traffic)
    assert found["decision"] == pytest.approx(1e6 + EXPECTED_US["decision"])
    assert found["agent"] == EXPECTED_US["agent"]


def test_messages_without_a_time_are_counted_but_not_timed(traffic: Traffic) -> None:
    for name in SENT_US:
        traffic.take(published(name, loop(name, 1)), 101.0)
    assert medians(traffic) == dict.fromkeys(LEGS)
    assert traffic.counts[STATE].messages == 1


def test_percentiles_are_those_of_all_decisions(traffic: Traffic) -> None:
    for decision in range(100):
        late = 10**6 if decision == 50 else 0
        for name, sent_us in SENT_US.items():
            slow = late if name == REWARD else 0
            traffic.take(published(name, loop(name, decision), 10**18 + 1000 * (sent_us + slow)), 101.0)
    count, median, p99 = traffic.latency_us()["robot"] or (0, 0.0, 0.0)
    assert (count, median, p99) == (100, EXPECTED_US["robot"], EXPECTED_US["robot"])


def test_rates_are_measured_from_the_oldest_mark() -> None:
    traffic = Traffic(0.0, marks=3)
    for second in range(10):
        for _ in range(second):
            traffic.take(published(STATE, loop(STATE, 0)), second + 0.5)
        traffic.mark(second + 1.0)
    size_kb = len(encode(loop(STATE, 0))) / 1000
    rate, kb_per_s = traffic.rates(10.0)[STATE]
    assert rate == pytest.approx((8 + 9) / 2)
    assert kb_per_s == pytest.approx(size_kb * rate)


def test_journal_checkpoints_and_heartbeats_are_one_row_each(traffic: Traffic) -> None:
    for name in ("journal/r/000000/00000001", "journal/r/run", "checkpoint/r/agent/latest", "heartbeat/agent", "a/b"):
        traffic.take(Published(name, b"", "", None), 101.0)
    assert set(traffic.counts) == {"journal", "checkpoint", "heartbeat", "a/b"}
    assert traffic.counts["journal"].messages == 2


def test_garbage_is_counted_and_stops_nothing(traffic: Traffic) -> None:
    noise = random.Random(0)
    names = (*SENT_US, EPISODE, "heartbeat/agent", "heartbeat/", "", "ft", "unknown")
    for _ in range(2000):
        payload = noise.randbytes(noise.randrange(40))
        encoding = noise.choice(["", "text/plain", encoding_of(State), encoding_of(Alive), encoding_of(Reward)])
        traffic.take(Published(noise.choice(names), payload, encoding, noise.choice([None, 0, 2**63])), 101.0)
    assert sum(count.bad for count in traffic.counts.values()) > 500
    assert medians(traffic) == dict.fromkeys(LEGS)
    decide(traffic, 7)
    assert medians(traffic) == EXPECTED_US


def test_memory_is_bounded(traffic: Traffic) -> None:
    for number in range(MAX_TIMED + MAX_OPEN + 10):
        decide(traffic, number)
        traffic.take(published(STATE, loop(STATE, 10**9 + number), 10**18), 101.0)
        traffic.take(Published(f"stranger/{number}", b"", "", None), 101.0)
        traffic.take(published(f"heartbeat/s{number}", of_agent(1)), 101.0)
    assert len(traffic.latencies.timed["agent"]) == MAX_TIMED
    assert len(traffic.latencies._open) <= MAX_OPEN
    assert len(traffic.counts) == MAX_NAMES + 1
    assert traffic.counts[OTHERS].messages > MAX_TIMED
    assert len(traffic.hearts) == MAX_NAMES


def test_moves_are_counted_within_and_across_episodes(traffic: Traffic) -> None:
    for episode, step in ((0, 5), (0, 8)):
        traffic.take(published(OBSERVATION, loop(OBSERVATION, 0, episode, step)), 101.0)
    assert traffic.pace.moves == 3, "what was before the first message was not seen"
    traffic.take(published(OBSERVATION, loop(OBSERVATION, 0, 0, 6)), 101.0)
    assert traffic.pace.moves == 3, "an old one again"
    traffic.take(published(EPISODE, summary(0, 10)), 101.0)
    assert traffic.pace.moves == 5
    traffic.take(published(OBSERVATION, loop(OBSERVATION, 0, 1, 4)), 101.0)
    traffic.take(published(EPISODE, summary(0, 10)), 101.0)
    assert traffic.pace.moves == 9, "an old summary again"
    traffic.take(published(EPISODE, summary(1, 20)), 101.0)
    traffic.take(published(EPISODE, summary(2, 30)), 101.0)
    assert traffic.pace.moves == 25 + 30
    assert traffic.moves_per_s(110.0) == pytest.approx(55 / 10)
    assert traffic.episodes_per_min(110.0) == pytest.approx(60 * 3 / 10)


def test_the_return_is_that_of_the_last_ten_episodes_of_this_run(traffic: Traffic) -> None:
    for episode in range(12):
        traffic.take(published(EPISODE, summary(episode, 1, float(episode))), 101.0)
    assert list(traffic.pace.returns) == [float(episode) for episode in range(2, 12)]
    traffic.take(published(EPISODE, summary(0, 1, -1.0, run="other")), 101.0)
    assert list(traffic.pace.returns) == [-1.0]
    assert traffic.pace.run == "other"


def test_a_service_that_started_again_has_no_rate_yet(traffic: Traffic) -> None:
    traffic.take(published("heartbeat/agent", of_agent(100)), 101.0)
    assert traffic.hearts["agent"].handled_per_s is None
    traffic.take(published("heartbeat/agent", of_agent(150, GapError=2)), 103.0)
    assert traffic.hearts["agent"].handled_per_s == 25.0
    assert traffic.hearts["agent"].last.refused == {"GapError": 2}
    traffic.take(published("heartbeat/agent", of_agent(3, instance="y")), 104.0)
    assert traffic.hearts["agent"].handled_per_s is None
