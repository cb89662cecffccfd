"""What a cell answers: to any Zenoh client, without a line of Treenail, and to the ``treenail`` command."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

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
        process = run_module("services.cli.main", *words, "--connect", running.endpoint)
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
    said = command("status")
    assert all(name in said for name in SERVICES)
    rows = {row["service"]: row for row in json.loads(command("status", "--json"))}
    assert set(rows) == SERVICES
    assert rows["agent"]["messages/s"] > 0
    assert all(row["phase"] == "running" for row in rows.values())


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("get", "nothing/here"), "nobody answered"),
        (("get", "agent/policy?state=x"), "expected a state number"),
        (("q-table", "--cell", "b"), "expected one answer, got 0"),
        (("status", "--cell", "b"), "nobody is alive"),
        (("status", "--cell", "B"), "cell: expected"),
        (("get", "bad//key"), "bad//key"),
    ],
)
def test_no_answer_is_one_line(
    house: Any, live: Any, run_module: Callable[..., Any], words: Any, expected: str
) -> None:
    if "policy" in words[-1]:
        live.start_loop(3)
        live.wait_alive("agent")
    process = run_module("services.cli.main", *words, "--connect", house.endpoint)
    assert process.end() == 2, process.out
    (line,) = process.err.splitlines()
    assert expected in line
    assert line.startswith(f"treenail {words[0]}: ")


def test_without_a_router_a_command_ends_in_one_line(run_module: Callable[..., Any], short_path: Path) -> None:
    process = run_module("services.cli.main", "status", "--connect", f"unixsock-stream/{short_path}/nobody")
    assert process.end() == 2
    (line,) = process.err.splitlines()
    assert "router: expected one at" in line
