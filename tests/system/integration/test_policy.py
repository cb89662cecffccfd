"""The policy for an F/T vector: the agent asks the classifier, learns on meanwhile, and leaves no query open."""

from __future__ import annotations

import json
import queue
import signal
import threading
from collections.abc import Callable
from typing import Any

import pytest
import zenoh

from services.agent.service import CLASSIFIER_WITHIN_S
from services.bus.relay import MAX_WAITING
from services.wire.codec import encode, encoding_of
from services.wire.keys import CLASSIFY, POLICY, Q_TABLE, TASK_STEPS
from services.wire.messages import Classified, JournalEpisode, Message, PolicyAnswer, QTable

EPISODES = 40
FT = "ft=0.2,0,-1.5,0,0.02,0"
CLIENT_WAITS_S = 30.0


@pytest.fixture
def learnt(live: Any) -> Any:
    """A cell whose run is over."""
    live.start_loop(3)
    live.digests()
    return live


@pytest.fixture
def ask(live: Any) -> Callable[[str], tuple[str, Any]]:
    """Ask a selector for JSON; return "ok" or the reason of a refusal, and what was said."""

    def get(selector: str) -> tuple[str, Any]:
        form = f"{live.keys.of(selector)};format=json"
        (reply,) = live.session.get(form, timeout=CLIENT_WAITS_S)
        if reply.ok is not None:
            return "ok", json.loads(reply.ok.payload.to_string())
        said = json.loads(reply.err.payload.to_string())
        return said["reason"], said["message"]

    return get


def test_a_vector_is_answered_with_the_row_of_its_state(learnt: Any, ask: Callable[..., Any]) -> None:
    table = learnt.ask(Q_TABLE, QTable)
    steps = learnt.ask(TASK_STEPS, JournalEpisode).steps
    states = set()
    for step in steps:
        text = ",".join(map(repr, (*step.force_n, *step.torque_nm)))
        _, classified = ask(f"{CLASSIFY}?ft={text}")
        how, said = ask(f"{POLICY}?ft={text}")
        assert how == "ok"
        assert said["state"] == classified["state"] is not None, "all that was felt is known"
        assert said["match"] == classified["match"] > 0.9
        assert tuple(said["values"]) == table.q[said["state"]]
        assert tuple(said["visits"]) == table.visits[said["state"]]
        assert said["best_action"] == table.best_action[said["state"]]
        assert sum(said["probabilities"]) == pytest.approx(1.0)
        states.add(said["state"])
    assert len(states) > 1
    assert learnt.digests()["q_table"] == table.digest, "asking teaches nothing"


def test_a_vector_that_fits_nothing_has_no_state(learnt: Any, ask: Callable[..., Any]) -> None:
    how, classified = ask(f"{CLASSIFY}?ft=0,0,0,-5,7,-3")
    assert (how, classified["state"]) == ("ok", None)
    how, said = ask(f"{POLICY}?ft=0,0,0,-5,7,-3")
    assert how == "ok"
    assert (said["state"], said["known"], set(said["values"])) == (None, False, {0.0})
    assert said["match"] == classified["match"]
    assert said["probabilities"] == pytest.approx([1 / 9] * 9)


NONSENSE = (
    ("", "got neither"),
    ("?state=1;" + FT, "got both"),
    ("?state=", "expected a state number"),
    ("?state=-1", "expected a state number"),
    ("?state=1.0", "expected a state number"),
    ("?ft=", "got none"),
    ("?ft=1,2,3,4,5", "got 5"),
    ("?ft=1,2,3,4,5,6,7", "got 7"),
    ("?ft=1,2,3,4,5,", "got ''"),
    ("?ft=1,2,3,4,5,x", "got 'x'"),
    ("?ft=1,2,3,4,5,nan", "got 'nan'"),
    ("?ft=1,2,inf,4,5,6", "got 'inf'"),
    ("?ft=1,2,3,4,5,1_0", "got '1_0'"),
    ("?ft=1,2,3,4,5,1e6", "from -1e5 to 1e5"),
    ("?ft=1,2,3,4,5,1e999", "got '1e999'"),
    ("?ft=0,0,-0,0,0.0,0e5", "six zeros"),
    ("?ft=1e-200,0,0,0,0,0", "ART2 classifies directions"),
    ("?force=1", "parameter: expected one of state, ft"),
)


def test_what_makes_no_sense_is_refused_and_says_what_was_expected(learnt: Any, ask: Callable[..., Any]) -> None:
    for parameters, expected in NONSENSE:
        how, said = ask(f"{POLICY}{parameters or '?'}")
        assert how == "bad_request", parameters
        assert expected in said, parameters
        assert "expected" in said, parameters
    assert learnt.refused("agent").keys() == {"BadPayloadError", "RefusedError"}, "one of them by the classifier"


def test_thousands_of_questions_change_nothing_of_what_is_learnt(
    live: Any, reference: Callable[..., dict[str, str]], wait_until: Callable[..., None]
) -> None:
    live.start_loop(EPISODES)
    live.wait_alive("agent", "classifier")
    ended, versions = threading.Event(), set()
    selectors = [f"{POLICY}?{FT}", f"{POLICY}?state=1", f"{POLICY}?ft=0.1,1,-2,0.1,0,0", f"{POLICY}?ft=nan"]
    answered: dict[str, int] = dict.fromkeys(selectors, 0)
    room = threading.Semaphore(20)

    def one(selector: str) -> None:
        def on_reply(reply: zenoh.Reply) -> None:
            answered[selector] += 1
            if reply.ok is not None:
                versions.add(json.loads(reply.ok.payload.to_string())["policy_version"])

        handler = zenoh.handlers.Callback(on_reply, room.release, indirect=False)
        live.session.get(live.keys.of(f"{selector};format=json"), handler, timeout=CLIENT_WAITS_S)

    def flood() -> None:
        while not ended.is_set():
            for selector in selectors:
                room.acquire()
                one(selector)

    asking = threading.Thread(target=flood)
    asking.start()
    try:
        wait_until("the run ends", lambda: live.phase("task") == "finished")
    finally:
        ended.set()
        asking.join()
    assert live.digests() == reference(EPISODES)
    assert sum(answered.values()) > 1000
    assert len(versions) > 100, "they were answered all along the run"


def flooded(live: Any, count: int) -> queue.SimpleQueue[Any]:
    """Ask so often at once; what comes back is what was said, or None for a query that ended without a word."""
    said: queue.SimpleQueue[Any] = queue.SimpleQueue()
    for _ in range(count):
        replies: list[Any] = []

        def on_reply(reply: zenoh.Reply, replies: list[Any] = replies) -> None:
            error = reply.err if reply.ok is None else None
            replies.append(json.loads(error.payload.to_string()) if error is not None else "ok")

        def on_end(replies: list[Any] = replies) -> None:
            said.put(replies)

        handler = zenoh.handlers.Callback(on_reply, on_end, indirect=False)
        live.session.get(live.keys.of(f"{POLICY}?{FT};format=json"), handler, timeout=CLIENT_WAITS_S)
    return said


def test_without_a_classifier_the_query_is_refused_and_the_agent_goes_on(learnt: Any, ask: Callable[..., Any]) -> None:
    learnt.processes["classifier"].popen.kill()
    learnt.processes["classifier"].end()
    how, said = ask(f"{POLICY}?{FT}")
    assert how == "not_ready"
    assert CLASSIFY in said
    assert ask(f"{POLICY}?state=0")[0] == "ok"
    learnt.start_loop(3, "classifier")
    learnt.wait_alive("classifier")
    assert ask(f"{POLICY}?{FT}")[0] == "ok"


class SilentClassifier:
    """Stands in for a classifier that keeps queries, until it is told what to say."""

    def __init__(self, live: Any) -> None:
        live.processes["classifier"].popen.kill()
        live.processes["classifier"].end()
        self.key = live.keys.of(CLASSIFY)
        self.kept: queue.SimpleQueue[zenoh.Query] = queue.SimpleQueue()
        self._queryable = live.session.declare_queryable(self.key, zenoh.handlers.Callback(self.kept.put))

    def say(self, payload: bytes, encoding: str, times: int = 1) -> None:
        with self.kept.get(timeout=CLIENT_WAITS_S) as query:
            for _ in range(times):
                query.reply(self.key, payload, encoding=encoding)


def test_a_classifier_that_keeps_silent_delays_nobody_else(learnt: Any, ask: Callable[..., Any]) -> None:
    """Every query gets one answer well before its client gives up, and more than can wait are refused at once."""
    silent = SilentClassifier(learnt)
    assert CLASSIFIER_WITHIN_S < 2.0, "the command waits 2 s"
    said = flooded(learnt, MAX_WAITING + 20)
    for _ in range(MAX_WAITING):
        silent.kept.get(timeout=CLIENT_WAITS_S)
    assert ask(f"{POLICY}?state=0")[0] == "ok", "the agent's loop goes on"
    found = [said.get(timeout=CLIENT_WAITS_S) for _ in range(MAX_WAITING + 20)]
    assert all(len(replies) == 1 for replies in found)
    messages = [replies[0]["message"] for replies in found]
    assert {replies[0]["reason"] for replies in found} == {"not_ready"}
    assert sum("at most 100 queries" in message for message in messages) == 20
    assert sum("expected a good answer within 1 s" in message for message in messages) == MAX_WAITING


def test_an_agent_that_stops_refuses_what_still_waits(learnt: Any) -> None:
    silent = SilentClassifier(learnt)
    said = flooded(learnt, 3)
    kept = [silent.kept.get(timeout=CLIENT_WAITS_S) for _ in range(3)]
    assert learnt.processes["agent"].stop() == 0
    for _ in kept:
        (refusal,) = said.get(timeout=CLIENT_WAITS_S)
        assert refusal["reason"] == "not_ready"
        assert "stopping" in refusal["message"]
    assert learnt.processes["agent"].err == ""


def test_who_asks_may_leave(learnt: Any, ask: Callable[..., Any], wait_until: Callable[..., None]) -> None:
    silent = SilentClassifier(learnt)
    session = zenoh.open(zenoh.Config.from_json5(json.dumps(
        {"mode": "client", "connect": {"endpoints": [learnt.endpoint]}}
    )))  # fmt: skip
    session.get(learnt.keys.of(f"{POLICY}?{FT}"), lambda _: None)
    query = silent.kept.get(timeout=CLIENT_WAITS_S)
    session.close()  # type: ignore[no-untyped-call]
    with query:
        query.reply(silent.key, b"", encoding="text/plain")
    wait_until("it was noticed", lambda: learnt.refused("agent").get("WrongTypeError") == 1)
    assert ask(f"{POLICY}?state=0")[0] == "ok"


def classified(live: Any, **changes: Any) -> Message:
    fields = {"run": live.experiment().run, "decisions": 1, "states": 1, "state": 0, "match": 1.0}
    return Classified(**{**fields, **changes})


@pytest.mark.parametrize("what", ["garbage", "another type", "another run"])
def test_a_bad_answer_of_the_classifier_is_refused_on(learnt: Any, what: str) -> None:
    silent = SilentClassifier(learnt)
    said = flooded(learnt, 1)
    kind: type[Message] = PolicyAnswer if what == "another type" else Classified
    changes = {"run": "other"} if what == "another run" else {}
    silent.say(b"\xc1" if what == "garbage" else encode(classified(learnt, **changes)), encoding_of(kind))
    (refusal,) = said.get(timeout=CLIENT_WAITS_S)
    assert refusal["reason"] == "not_ready"
    assert learnt.processes["agent"].popen.poll() is None


def test_of_two_classifiers_one_is_believed(learnt: Any) -> None:
    silent = SilentClassifier(learnt)
    said = flooded(learnt, 2)
    for _ in range(2):
        silent.say(encode(classified(learnt)), encoding_of(Classified), times=2)
    assert [said.get(timeout=CLIENT_WAITS_S) for _ in range(2)] == [["ok"], ["ok"]]


def test_a_classifier_that_hangs_is_given_up_in_time(learnt: Any, ask: Callable[..., Any]) -> None:
    learnt.processes["classifier"].popen.send_signal(signal.SIGSTOP)
    how, said = ask(f"{POLICY}?{FT}")
    assert (how, CLASSIFY in said) == ("not_ready", True)
    learnt.processes["classifier"].popen.send_signal(signal.SIGCONT)
    learnt.wait_alive("classifier")
    assert ask(f"{POLICY}?{FT}")[0] == "ok"
