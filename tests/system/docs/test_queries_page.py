"""docs/queries.md: a live cell answers every request on it with the fields that it shows; its scripts run as shown."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from services.wire.keys import CONTRACT

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / "docs" / "queries.md").read_text()
SCRIPTS = ("ask_policy", "read_journal", "who_is_there")
EXCHANGE = re.compile(r"^`(treenail/\S+)`\n\n```json\n(.*?)```$", re.MULTILINE | re.DOTALL)
RUN = re.compile(r"[0-9a-f]{16}-s[0-9]+")
OPEN = ("definition", "snapshot", "refused")
"""Fields whose own fields are not all shown."""


def fields(value: Any, name: str = "") -> Any:
    """Return the shape of a JSON value: the names of an object's fields, and of those in them."""
    if isinstance(value, dict):
        return {} if name in OPEN else {key: fields(item, key) for key, item in value.items()}
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return [fields(value[0])]
    return "one"


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory: pytest.TempPathFactory, small: Path, wait_until: Any) -> Iterator[str]:
    """A cell that has learnt for more than twenty episodes, so that there is a checkpoint."""
    out = tmp_path_factory.mktemp("cell") / "run"
    words = ["--experiment", str(small), "--episodes", "100000", "--port", "0", "--no-viewer", "--out", str(out)]
    process = subprocess.Popen(
        [sys.executable, "-m", "treenail.__main__", "up", "sim", *words], stdout=subprocess.DEVNULL
    )
    log = out / "logs" / "router.log"
    try:
        wait_until("the router listens", lambda: log.exists() and "listening on" in log.read_text())
        yield log.read_text().split("listening on ")[1].split()[0]
    finally:
        process.terminate()
        process.wait(60)


@pytest.fixture(scope="module")
def session(endpoint: str, wait_until: Any) -> Iterator[zenoh.Session]:
    """A Zenoh client as its documentation shows it."""
    settings = {"mode": "client", "connect": {"endpoints": [endpoint]}}
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
        wait_until("a checkpoint", lambda: list(session.get("treenail/a/checkpoint/*/agent/latest")))
        yield session


def test_every_key_that_can_be_asked_is_on_the_page() -> None:
    asked = [re.compile(re.sub(r"<[a-z0-9]+>", "[^/?]+", key)) for key, row in CONTRACT.items() if "query" in row.kind]
    named = {selector.removeprefix("treenail/a/").partition("?")[0] for selector, _ in EXCHANGE.findall(PAGE)}
    named |= set(re.findall(r"`([a-z0-9_/<>-]+)`", PAGE))
    missing = [pattern.pattern for pattern in asked if not any(pattern.fullmatch(name) for name in named)]
    assert missing in ([], ["checkpoint/skill/[^/?]+"]), "a skill has no example: there is none yet in a new cell"


@pytest.mark.parametrize(("selector", "shown"), EXCHANGE.findall(PAGE), ids=[one for one, _ in EXCHANGE.findall(PAGE)])
def test_a_request_is_answered_as_the_page_shows(session: zenoh.Session, selector: str, shown: str) -> None:
    (experiment,) = session.get("treenail/a/experiment?format=json")
    assert experiment.ok is not None
    run = json.loads(experiment.ok.payload.to_string())["run"]
    (reply,) = session.get(RUN.sub(run, selector))
    answer = reply.ok if reply.ok is not None else reply.err
    assert answer is not None
    assert str(answer.encoding) == "application/json"
    real, printed = json.loads(answer.payload.to_string()), json.loads(shown)
    assert fields(real).keys() == fields(printed).keys()
    for name, inside in fields(real).items():
        if inside != "one" and printed[name]:
            assert inside == fields(printed)[name]
    if reply.ok is None:
        assert real == printed


@pytest.mark.parametrize("name", SCRIPTS)
def test_the_page_shows_the_scripts_as_they_are(name: str) -> None:
    assert f"```python\n{(ROOT / 'docs' / 'examples' / f'{name}.py').read_text()}```" in PAGE


def test_the_scripts_run(session: zenoh.Session, endpoint: str) -> None:
    def run(name: str, *words: str) -> Any:
        command = [sys.executable, str(ROOT / "docs" / "examples" / f"{name}.py"), endpoint, *words]
        return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)

    said = run("ask_policy", "state=0")
    assert said.returncode == 0, said.stderr
    assert said.stdout.startswith("contact state 0, match None\n+X: ")
    assert run("ask_policy").stdout.startswith("contact state ")
    refused = run("ask_policy", "ft=1,2")
    assert (refused.returncode, json.loads(refused.stderr)["reason"]) == (1, "bad_request")
    journal = run("read_journal")
    assert re.fullmatch(r"run [0-9a-f]{16}-s0, episode \d+: \d+ decisions, [a-z_]+\n", journal.stdout), journal.stderr
    there = run("who_is_there").stdout.splitlines()
    assert sorted(there) == [f"cell a: {name}" for name in ("agent", "classifier", "sim", "store", "task")]


def test_the_commands_on_the_page_are_commands(
    endpoint: str, session: zenoh.Session, run_module: Callable[..., Any]
) -> None:
    block = re.search(r"```\n(treenail status.*?)```", PAGE, re.DOTALL)
    assert block is not None
    for line in block.group(1).splitlines():
        words = [word.strip("'") for word in line.split()[1:]]
        process = run_module(
            "treenail.__main__", *words, *(("--once",) if words == ["top"] else ()), "--connect", endpoint
        )
        assert process.end() == 0, process.err
