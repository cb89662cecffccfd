"""A learner or classifier that is swapped while a cell learns: every way to run it ends in the same bytes."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from experiments.lab.in_process import InProcessRun
from services.bus.answers import answer_in
from services.rules.results import episodes_digest
from services.rules.swaps import in_force, planned, request_for, spec
from services.wire.codec import encode, encoding_of
from services.wire.definition import QLearning, Softmax
from services.wire.definition_file import load
from services.wire.keys import SWAP, SWAPS, name_of
from services.wire.messages import Refusal, Swap, Swapped, SwapRequest, Swaps

EPISODES = 24
LONG = 60
"""Episodes of a run that is still under way when somebody has been killed, has come back, and has asked."""
SARSA, RHO = "agent:learner=sarsa,alpha=0.2", "classifier:rho=0.97"
FUZZY, GREEDY = "classifier:classifier=fuzzy-art", "agent:policy=greedy"


def in_process(definition: Path, swaps: tuple[Swap, ...], episodes: int = EPISODES) -> dict[str, str]:
    """Return the digests of the run without a bus."""
    run = InProcessRun(load(str(definition)), 1, swaps=swaps)
    log = list(run.episodes(episodes))
    return {
        "q_table": run.agent.learner.digest(),
        "art2": run.classifier.network.digest(),
        "episodes": episodes_digest(log),
    }


class Operator:
    """Somebody who swaps."""

    def __init__(self, live: Any) -> None:
        self.live = live

    def wanted(self, words: str, episode: int | None) -> SwapRequest:
        """Return a request for what stands in words, under a new name."""
        experiment = self.live.experiment()
        now = in_force(experiment.definition, experiment.swaps)
        return request_for(experiment.run, now, spec(f"1:{words}")[1], episode, uuid.uuid4().hex)

    def send(self, payload: bytes, encoding: str = encoding_of(SwapRequest)) -> list[Swapped | Refusal]:
        """Return all answers to a payload on the key."""
        replies = self.live.session.get(self.live.keys.of(SWAP), payload=payload, encoding=encoding, timeout=5.0)
        return [answer for reply in replies if (answer := answer_in(reply, Swapped)) is not None]

    def ask(self, request: SwapRequest) -> Swapped | Refusal:
        """Return the one answer to a request, asked again while none comes or, as the refusal says, while not ready.

        A task that has just come back is alive before every router knows that it answers.
        """
        deadline = time.monotonic() + 30
        while True:
            answers = self.send(encode(request))
            early = not answers or (isinstance(answers[0], Refusal) and answers[0].reason == "not_ready")
            if not early or time.monotonic() > deadline:
                (answer,) = answers
                return answer
            time.sleep(0.2)

    def swap(self, words: str, episode: int | None = None) -> Swap:
        """Return the swap that was made."""
        answer = self.ask(self.wanted(words, episode))
        assert isinstance(answer, Swapped), answer
        return answer.swap


@pytest.fixture
def operator(live: Any) -> Operator:
    return Operator(live)


@pytest.fixture
def waiting(live: Any, wait_until: Callable[..., None]) -> Any:
    """A cell whose task waits for an agent in its first episode."""
    live.start_loop(EPISODES, "task", "sim", "classifier")
    live.wait_alive("task", "sim", "classifier")
    wait_until("the task waits for the agent", lambda: "agent" in live.phase("task"))
    return live


def kill(live: Any, victim: str, episodes: int = EPISODES) -> None:
    """Kill a service and start it again."""
    process = live.processes[victim]
    os.kill(process.popen.pid, signal.SIGKILL)
    process.end()
    if victim == "store":
        live.start_store()
    else:
        live.start_loop(episodes, victim)


@pytest.mark.parametrize(
    "words",
    [(f"8:{SARSA}",), (f"8:{RHO}",), (f"8:{FUZZY}",), (f"5:{SARSA}", f"12:{FUZZY}"), (f"8:{RHO}", f"8:{GREEDY}")],
    ids=lambda words: "+".join(words),
)
def test_a_swap_ends_in_the_same_bytes_with_and_without_a_bus_and_in_the_replay(
    waiting: Any, operator: Operator, run_module: Callable[..., Any], words: tuple[str, ...]
) -> None:
    expected = planned("", load(str(waiting.definition)), words, EPISODES)
    for text in words:
        episode, wish = spec(text)
        made = operator.swap(f"{wish.service}:{','.join(wish.settings)}", episode)
        assert made.episode == episode
    reference = in_process(waiting.definition, expected)
    assert reference != in_process(waiting.definition, ()), "a swap that changes nothing proves nothing"
    waiting.start("agent")
    assert waiting.digests() == reference
    for until in (expected[0].episode, EPISODES):
        words_of_replay = ("--store", str(waiting.folder / "store.sqlite"), "--until", str(until), "--json")
        replay = run_module("experiments.journal.replay_command", *words_of_replay)
        assert replay.end() == 0, replay.out + replay.err
        found = json.loads(replay.out)
        assert found["equal"] and len(found["swaps"]) == len(expected)
    assert found["digests"] == reference


@pytest.mark.parametrize("victim", ["agent", "classifier", "task", "store"])
def test_who_is_killed_after_the_acknowledgement_and_before_the_effect_changes_nothing(
    live: Any, operator: Operator, victim: str
) -> None:
    live.start_loop(LONG)
    live.wait_alive("task", "classifier", "agent")
    live.wait_actions(20)
    first = operator.swap(SARSA)
    kill(live, victim, LONG)
    live.wait_alive("store", "task", "classifier", "agent")
    second = operator.swap(RHO, first.episode + 20)
    live.wait_actions(5)
    kill(live, victim, LONG)
    assert live.digests() == in_process(live.definition, (first, second), LONG)
    assert live.experiment().swaps == (first, second)


def test_a_worker_that_comes_after_the_effect_begins_from_a_checkpoint_with_the_swap(
    live: Any, operator: Operator, wait_until: Callable[..., None]
) -> None:
    live.start_loop(EPISODES)
    live.wait_alive("task", "classifier", "agent")
    made = operator.swap(RHO)
    wait_until("a checkpoint after the swap", lambda: live.done() > 21)
    for victim in ("agent", "classifier"):
        kill(live, victim)
    assert live.digests() == in_process(live.definition, (made,))


def test_a_request_that_is_repeated_swaps_once(waiting: Any, operator: Operator) -> None:
    request = operator.wanted(SARSA, None)
    answers = [operator.ask(request) for _ in range(3)]
    assert answers[0] == answers[1] == answers[2]
    assert isinstance(answers[0], Swapped)
    assert waiting.experiment().swaps == (answers[0].swap,)
    kill(waiting, "task")
    waiting.wait_alive("task")
    assert operator.ask(request) == answers[0], "an earlier process has made it"


def test_two_at_once_are_served_one_after_the_other(waiting: Any, operator: Operator) -> None:
    requests = [operator.wanted(SARSA, 5), operator.wanted(GREEDY, 5)]
    answers: list[Swapped | Refusal] = []
    threads = [threading.Thread(target=lambda one=one: answers.append(operator.ask(one))) for one in requests]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {answer.number for answer in answers if isinstance(answer, Swapped)} == {1, 2}
    swaps = waiting.experiment().swaps
    assert {swap.request for swap in swaps} == {request.request for request in requests}
    waiting.start("agent")
    assert waiting.digests() == in_process(waiting.definition, swaps)


def test_two_clients_at_once_do_not_undo_each_other(waiting: Any, run_module: Callable[..., Any]) -> None:
    words = ("treenail.__main__", "swap", "agent", "--connect", waiting.endpoint, "--at", "5", "--set")
    clients = [run_module(*words, setting) for setting in ("alpha=0.2", "gamma=0.5", "policy.beta=3")]
    for process in clients:
        assert (process.end(), process.err) == (0, "")
    experiment = waiting.experiment()
    now = in_force(experiment.definition, experiment.swaps)
    assert isinstance(now.learner, QLearning) and isinstance(now.policy, Softmax)
    assert (now.learner.alpha, now.learner.gamma, now.policy.beta) == (0.2, 0.5, 3.0)
    assert len(experiment.swaps) == 3


def test_what_cannot_be_is_refused_and_changes_nothing(waiting: Any, operator: Operator) -> None:
    good = operator.wanted(SARSA, 5)
    run, request = good.run, "0" * 32
    settings = in_force(waiting.experiment().definition, ())
    cases = {
        SwapRequest(run="ff-s1", request=request, learner=good.learner): ("foreign_run", "expected run"),
        SwapRequest(run=run, request=request): ("bad_request", "something that changes"),
        SwapRequest(run=run, request=request, learner=settings.learner): ("bad_request", "something that changes"),
        SwapRequest(run=run, request=request, episode=EPISODES, learner=good.learner): ("out_of_order", "1 to 23"),
        SwapRequest(run=run, request=request, after=1, learner=good.learner): ("out_of_order", "the run's 0 swaps"),
    }
    for wrong, (reason, said) in cases.items():
        answer = operator.ask(wrong)
        assert isinstance(answer, Refusal)
        assert (answer.reason, said in answer.message) == (reason, True), answer
    fresh = load(str(waiting.definition), ["learner.kind=plugin", "learner.name=nobody"])
    answer = operator.ask(SwapRequest(run=run, request=request, learner=fresh.learner))
    assert isinstance(answer, Refusal) and "'nobody'" in answer.message
    operator.swap(SARSA, 9)
    answer = operator.ask(operator.wanted(GREEDY, 8))
    assert isinstance(answer, Refusal) and "episode 9 or later" in answer.message
    assert len(waiting.experiment().swaps) == 1


def test_a_finished_run_takes_no_swap(live: Any, operator: Operator) -> None:
    live.start_loop(EPISODES)
    live.wait_alive("task", "agent")
    before = live.digests()
    answer = operator.ask(operator.wanted(SARSA, None))
    assert isinstance(answer, Refusal)
    assert answer.reason == "out_of_order" and "the last has begun" in answer.message
    assert live.digests() == before


def test_hostile_payloads_are_refused_one_by_one(waiting: Any, operator: Operator) -> None:
    good = operator.wanted(SARSA, 5)
    payload = encode(good)
    wrong = [
        b"",
        b"\xc1",
        b"\x80",
        payload[:-1],
        payload + b"\x00",
        b"\xff" * (1 << 14),
        payload.replace(b"sarsa", b"sarsb"),
    ]
    for one in wrong:
        (answer,) = operator.send(one)
        assert isinstance(answer, Refusal), one[:20]
    (answer,) = operator.send(payload, "zenoh/bytes")
    assert isinstance(answer, Refusal)
    assert waiting.experiment().swaps == ()
    assert waiting.ask(name_of(SWAPS, run=good.run), Swaps, 1.0) is None
    assert isinstance(operator.ask(good), Swapped)


def test_a_swap_waits_for_the_store_and_is_not_acknowledged_without_it(
    waiting: Any, operator: Operator, wait_until: Callable[..., None]
) -> None:
    request = operator.wanted(SARSA, 3)
    process = waiting.processes["store"]
    os.kill(process.popen.pid, signal.SIGKILL)
    process.end()
    (answer,) = operator.send(encode(request))
    assert isinstance(answer, Refusal) and answer.reason == "not_ready"
    assert waiting.experiment().swaps == ()
    waiting.start_store()
    waiting.wait_alive("store")
    found = operator.ask(request)
    assert isinstance(found, Swapped) and found.number == 1
    waiting.start("agent")
    assert waiting.digests() == in_process(waiting.definition, (found.swap,))


def test_the_command_says_what_it_does_and_status_shows_it(waiting: Any, run_module: Callable[..., Any]) -> None:
    def treenail(*words: str) -> Any:
        process = run_module("treenail.__main__", *words, "--connect", waiting.endpoint)
        process.status = process.end()
        return process

    done = treenail("swap", "agent", "--learner", "sarsa", "--set", "alpha=0.05", "--at", "4")
    assert (done.status, done.err) == (0, "")
    assert "swap 1, from episode 4: learner sarsa (alpha=0.05, gamma=0.95); keeps all" in done.out
    loud = treenail("swap", "classifier", "--rho", "0.95", "--at", "6", "--json")
    assert json.loads(loud.out)["swap"]["fresh"] == ["classifier", "agent"]
    for words, said in (
        (("agent", "--learner", "sarsaa"), "expected one of q_learning, sarsa"),
        (("agent", "--set", "alpah=1"), "did you mean 'alpha'"),
        (("agent", "--learner", "sarsa"), "something that changes"),
        (("agent", "--set", "alpha=0.1", "--at", "99"), "refused (out_of_order)"),
    ):
        wrong = treenail("swap", *words)
        assert wrong.status == 2 and said in wrong.err, wrong.err
        assert wrong.err.count("\n") == 1
    shown = treenail("status")
    assert "swap from episode 4: learner sarsa" in shown.out
    assert "classifier and agent START FRESH" in shown.out
