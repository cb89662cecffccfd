"""What a cell answers: to any Zenoh client, without a line of Treenail, and to the ``treenail`` command."""

from __future__ import annotations

import json
import os
import pty
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import zenoh

from services.wire.codec import encode, encoding_of
from services.wire.messages import Alive

SERVICES = {"task", "sim", "classifier", "agent", "store"}


@pytest.fixture
def running(live: Any) -> Any:
    live.start_loop(500)
    live.wait_actions(30)
    return live


@pytest.fixture
def plain(running: Any) -> Iterator[zenoh.Session]:
    """A Zenoh client as its documentation shows it."""
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([running.endpoint]))
    with zenoh.open(config) as session:
        yield session


def test_a_plain_zenoh_client_reads_all_as_json(running: Any, plain: zenoh.Session) -> None:
    def get(selector: str) -> Any:
        (reply,) = plain.get(selector)
        assert reply.ok is not None, reply.err and reply.err.payload.to_string()
        assert str(reply.ok.encoding) == "application/json"
        return json.loads(reply.ok.payload.to_string())

    table = get("treenail/a/agent/q_table?format=json")
    assert len(table["actions"]) == 9
    assert len(table["q"]) == len(table["visits"]) == len(table["best_action"]) >= 1
    policy = get("treenail/a/agent/policy?state=0;format=json")
    assert policy["known"] is True
    assert sum(policy["probabilities"]) == pytest.approx(1.0)
    unknown = get("treenail/a/agent/policy?state=999999;format=json")
    assert unknown["known"] is False
    assert set(unknown["values"]) == {0.0}
    experiment = get("treenail/a/experiment?format=json")
    assert experiment["definition"]["name"] == "small"
    assert experiment["run"].endswith("-s1")
    states = get("treenail/a/classifier/states?format=json")
    assert len(states["prototypes"]) == states["states"] >= 1
    record = get(f"treenail/a/journal/{experiment['run']}/run?format=json")
    assert record["definition_sha256"] == experiment["definition_sha256"]
    alive = {str(reply.ok.key_expr): json.loads(reply.ok.payload.to_string())
             for reply in plain.get("treenail/a/alive/*?format=json") if reply.ok is not None}  # fmt: skip
    assert set(alive) == {f"treenail/a/alive/{name}" for name in SERVICES}
    assert len({status["contract_sha256"] for status in alive.values()}) == 1
    tokens = {str(reply.ok.key_expr) for reply in plain.liveliness().get("treenail/a/alive/*") if reply.ok is not None}
    assert tokens == set(alive)


def test_a_refusal_is_json_for_who_asks_for_json(plain: zenoh.Session) -> None:
    (reply,) = plain.get("treenail/a/agent/policy?state=x;format=json")
    assert reply.err is not None
    assert json.loads(reply.err.payload.to_string())["reason"] == "bad_request"


@pytest.fixture
def command(running: Any, run_module: Callable[..., Any]) -> Callable[..., str]:
    """Run a ``treenail`` command on the cell; return what it prints."""

    def run(*words: str) -> str:
        process = run_module("treenail.__main__", *words, "--connect", running.endpoint)
        assert process.end() == 0, process.err
        assert process.err == ""
        return str(process.out)

    return run


def test_the_command_shows_what_a_cell_answers(command: Callable[..., str]) -> None:
    assert json.loads(command("get", "experiment"))["definition"]["name"] == "small"
    assert json.loads(command("get", "agent/policy?state=0", "--compact"))["state"] == 0
    assert set(json.loads(command("get", "alive/*"))) == {f"treenail/a/alive/{name}" for name in SERVICES}
    assert "Q-table of run" in command("q-table")
    assert len(json.loads(command("q-table", "--json"))["actions"]) == 9


def test_status_says_what_runs_and_how_it_goes(command: Callable[..., str]) -> None:
    said = command("status")
    assert all(name in said for name in SERVICES)
    assert "Cell a: small, seed 1, episode" in said
    assert "s ago" in said
    assert "differs" not in said
    found = json.loads(command("status", "--json"))
    assert (found["cell"], found["experiment"], found["seed"], found["episodes"]) == ("a", "small", 1, 500)
    assert found["episodes_done"] >= 1
    rows = {row["service"]: row for row in found["services"]}
    assert set(rows) == SERVICES
    assert rows["agent"]["messages/s"] > 0
    assert all(str(row["phase"]).startswith("running") for row in rows.values()), rows
    assert all(row["contract_matches"] is True and row["contract"] == found["contract"] for row in rows.values())
    assert all(row["heartbeat_age_s"] is not None for row in rows.values())


def test_policy_is_a_table_with_the_best_action_marked(command: Callable[..., str]) -> None:
    said = command("policy", "--state", "0")
    answer = json.loads(command("policy", "--state", "0", "--json"))
    assert "contact state 0\n" in said
    assert f"run {answer['run']}, policy version " in said
    rows = [line for line in said.splitlines() if any(f" {name} " in line for name in answer["actions"])]
    assert len(rows) == 9
    assert sum("best" in row for row in rows) == 1


@pytest.mark.parametrize("words", [("--ft", "-0.2,0,-1.5,0,-0.02,0"), ("--ft=-0.2,0,-1.5,0,-0.02,0",)])
def test_a_vector_may_begin_with_a_minus(command: Callable[..., str], words: tuple[str, ...]) -> None:
    assert 0.0 < json.loads(command("policy", *words, "--json"))["match"] <= 1.0
    assert ", match 0." in command("policy", *words)


def test_a_wildcard_prints_the_good_answers_and_mentions_the_others(running: Any, run_module: Any) -> None:
    process = run_module("treenail.__main__", "get", "agent/*", "--connect", running.endpoint)
    assert process.end() == 0
    assert set(json.loads(process.out)) == {"treenail/a/agent/q_table"}
    (line,) = process.err.splitlines()
    assert "refused (bad_request): policy: expected" in line


def test_top_measures_every_key_and_every_leg(running: Any, command: Callable[..., str]) -> None:
    running.session.put(running.keys.of("state"), b"\xc1", encoding="text/plain")
    found = json.loads(command("top", "--seconds", "3", "--json"))
    assert (found["cell"], found["complete"]) == ("a", True)
    assert found["run"] == running.experiment().run
    assert {"observation", "state", "action", "reward", "ft", "episode", "heartbeat", "journal"} <= set(found["keys"])
    assert all(key["messages_per_s"] > 0 and key["kB_per_s"] > 0 for key in found["keys"].values())
    assert min(found["moves_per_s"], found["episodes_per_min"]) > 0 >= found["return_10"]
    legs = found["latency_us"]
    assert set(legs) == {"classifier", "agent", "robot", "decision"}
    assert all(leg["count"] > 10 and 0 < leg["median"] <= leg["p99"] for leg in legs.values())
    assert legs["decision"]["median"] > max(legs[name]["median"] for name in ("classifier", "agent", "robot"))
    assert set(found["services"]) == SERVICES
    assert found["services"]["agent"]["handled_per_s"] > 0


def test_top_prints_one_table_where_there_is_no_terminal(running: Any, run_module: Callable[..., Any]) -> None:
    process = run_module("treenail.__main__", "top", "--seconds", "1.5", "--connect", running.endpoint)
    running.wait_actions(1)
    running.session.put(running.keys.of("state"), b"\xc1", encoding="text/plain")
    running.processes["agent"].popen.kill()
    running.start("agent")
    assert process.end() == 0, process.err
    assert process.err == ""
    for word in ("messages/s", "observation to state", "classifier", "heartbeat", "moves/s"):
        assert word in process.out


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("get", "nothing/here"), "nobody answered"),
        (("get", "agent/policy?state=x"), "expected a state number"),
        (("get", "agent/nothing"), "nobody answered; alive in this cell: store"),
        (("policy", "--state", "1"), "nobody answered; alive in this cell: store"),
        (("policy", "--state", "1", "--json"), "nobody answered; alive in this cell: store"),
        (("policy", "--state", "x"), "expected a state number"),
        (("policy", "--ft", "-1,2"), "expected six numbers"),
        (("policy",), "--state --ft is required"),
        (("q-table", "--cell", "b"), "cell 'b': nobody is alive; cells here: a"),
        (("q-table", "--cell", "b", "--json"), "cell 'b': nobody is alive; cells here: a"),
        (("policy", "--cell", "b", "--state", "1"), "cell 'b': nobody is alive; cells here: a"),
        (("get", "agent/q_table", "--cell", "b"), "cell 'b': nobody is alive; cells here: a"),
        (("top", "--cell", "b"), "cell 'b': nobody is alive; cells here: a"),
        (("top", "--seconds", "0"), "expected from 0.1 to 86400 seconds"),
        (("status", "--cell", "b"), "cell 'b': nobody is alive; cells here: a"),
        (("status", "--cell", "B"), "cell: expected"),
        (("get", "bad//key"), "bad//key"),
    ],
)
def test_no_answer_is_one_line(
    house: Any, live: Any, run_module: Callable[..., Any], words: Any, expected: str
) -> None:
    if "agent/policy" in words[-1]:
        live.start_loop(3)
        live.wait_alive("agent")
    process = run_module("treenail.__main__", *words, "--connect", house.endpoint)
    assert process.end() == 2, process.out
    (line,) = process.err.splitlines()
    assert expected in line
    assert line.startswith(f"treenail {words[0]}: ")


@pytest.mark.parametrize("words", [("status",), ("top",), ("q-table",), ("policy", "--state", "1"), ("get", "x")])
def test_without_a_router_a_command_ends_in_one_line(
    run_module: Callable[..., Any], short_path: Path, words: tuple[str, ...]
) -> None:
    nobody = ("--connect", f"unixsock-stream/{short_path}/nobody", "--connect-timeout", "0.2")
    process = run_module("treenail.__main__", *words, *nobody)
    assert process.end() == 2
    (line,) = process.err.splitlines()
    assert "router: expected one at" in line


def test_without_anybody_alive_a_command_says_so(house: Any, run_module: Callable[..., Any]) -> None:
    process = run_module("treenail.__main__", "status", "--connect", house.endpoint)
    assert process.end() == 2
    assert "cell 'a': nobody is alive; nor in any other cell of this router" in process.err


class Impostor:
    """Stands in for a service that says what a test wants of it."""

    def __init__(self, house: Any, name: str) -> None:
        self._house = house
        self._declared = [house.session.liveliness().declare_token(house.keys.alive(name))]

    def says(self, name: str, payload: bytes, encoding: str) -> None:
        key = self._house.keys.of(name)

        def answer(query: zenoh.Query) -> None:
            with query:
                query.reply(key, payload, encoding=encoding)

        self._declared.append(self._house.session.declare_queryable(key, answer))

    def keeps_silent(self, name: str) -> None:
        kept: list[zenoh.Query] = []
        self._declared += [kept, self._house.session.declare_queryable(self._house.keys.of(name), kept.append)]


def test_an_answer_of_another_contract_is_named(house: Any, run_module: Callable[..., Any]) -> None:
    Impostor(house, "agent").says("agent/policy", b"\x80", "application/msgpack;treenail.PolicyAnswer.v1")
    process = run_module("treenail.__main__", "policy", "--state", "1", "--connect", house.endpoint)
    assert process.end() == 2
    (line,) = process.err.splitlines()
    assert "PolicyAnswer: expected version 4, got version 1" in line
    assert "another contract" in line


def test_status_marks_who_is_not_as_the_others(
    house: Any, run_module: Callable[..., Any], wait_until: Callable[..., None]
) -> None:
    house.start_store()
    wait_until("the store says who it is", lambda: house.status("store") is not None)
    other = msgspec.structs.replace(house.status("store"), service="agent", contract_sha256="0" * 64)
    impostors = [Impostor(house, name) for name in ("agent", "classifier", "sim")]
    impostors[0].says("alive/agent", encode(other), encoding_of(Alive))
    impostors[1].says("alive/classifier", b"\x80", "application/msgpack;treenail.Alive.v99")
    impostors[2].keeps_silent("alive/sim")
    house.start("task", "--experiment", str(house.definition), "--seed", "1", "--episodes", "3")
    wait_until("the task waits", lambda: "waiting for" in house.phase("task"))
    process = run_module("treenail.__main__", "status", "--json", "--connect", house.endpoint)
    assert process.end() == 0, process.err
    rows = {row["service"]: row for row in json.loads(process.out)["services"]}
    assert {name: row["contract_matches"] for name, row in rows.items()} == {
        "agent": False, "classifier": False, "sim": None, "store": True, "task": True,
    }  # fmt: skip
    assert "speaks another contract" in rows["classifier"]["phase"]
    assert rows["sim"]["phase"] == "hung: here, but not answering"
    assert rows["task"]["phase"].startswith("waiting for")
    assert rows["agent"]["heartbeat_age_s"] is None, "it never beats"
    process = run_module("treenail.__main__", "status", "--connect", house.endpoint)
    assert process.end() == 0, process.err
    assert "(differs)" in process.out
    assert "another contract than this command's" in process.out
    assert "agent, classifier;" in process.out


def test_top_is_live_in_a_terminal_until_ctrl_c(live: Any) -> None:
    primary, secondary = pty.openpty()
    command = [sys.executable, "-m", "treenail.__main__", "top", "--connect", live.endpoint]
    process = subprocess.Popen(command, stdin=secondary, stdout=secondary, stderr=secondary)
    os.close(secondary)
    shown = b""
    try:
        while b"heartbeat" not in shown:
            shown += os.read(primary, 65536)
        process.send_signal(signal.SIGINT)
        while more := _read(primary):
            shown += more
        assert process.wait(60) == 0
    finally:
        process.kill()
        process.wait()
        os.close(primary)
    assert b"Traceback" not in shown
    assert b"store" in shown


def _read(terminal: int) -> bytes:
    """Return what a terminal shows next; nothing when the process at its other end is gone."""
    try:
        return os.read(terminal, 65536)
    except OSError:
        return b""
