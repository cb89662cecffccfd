"""One real cell of each kind, each a few seconds: what ``make test`` runs of all that starts processes."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from services.cell.certificates import certify

EPISODES = 24
"""More than there are between two checkpoints."""
DISTURBED = 40
"""Episodes of the run in which every process is killed in turn."""
SERVICES = ("router", "store", "task", "sim", "classifier", "agent")
SCRIPT = Path(__file__).parents[3] / "docs" / "examples" / "ask_q_table.py"

Digests = dict[str, str]


def test_a_cell_ends_as_the_run_in_one_process(
    up: Callable[..., Any], reference: Callable[..., Digests], digests_in: Callable[[Path], Digests], tmp_path: Path
) -> None:
    process = up(tmp_path / "A", EPISODES)
    assert process.end() == 0, process.err
    assert process.err == ""
    assert digests_in(tmp_path / "A") == reference(EPISODES)
    assert "\x1b" not in process.out, "plain lines where there is no terminal"
    assert f"episode {EPISODES}/{EPISODES}" in process.out
    summary = json.loads((tmp_path / "A" / "summary.json").read_text())
    assert set(summary) == {"experiment", "definition_sha256", "runs"}


def test_killing_every_process_in_turn_changes_nothing(
    up: Callable[..., Any],
    reference: Callable[..., Digests],
    digests_in: Callable[[Path], Digests],
    endpoint_of: Callable[[Path], str],
    kill_after: Callable[..., None],
    tmp_path: Path,
) -> None:
    draw = random.Random(10)
    process = up(tmp_path / "A", DISTURBED)
    endpoint = endpoint_of(tmp_path / "A")
    for victim in draw.sample(SERVICES, len(SERVICES)):
        kill_after(process, endpoint, victim, draw.randrange(1, 25))
    assert process.end() == 0, process.err
    assert process.err == ""
    assert digests_in(tmp_path / "A") == reference(DISTURBED)
    for victim in SERVICES:
        assert f"{victim} was killed by SIGKILL; starting it again" in process.out


def test_a_cell_whose_services_are_one_process_ends_the_same_however_often_that_is_killed(
    up: Callable[..., Any],
    reference: Callable[..., Digests],
    digests_in: Callable[[Path], Digests],
    endpoint_of: Callable[[Path], str],
    kill_after: Callable[..., None],
    tmp_path: Path,
) -> None:
    process = up(tmp_path / "A", DISTURBED, "--together")
    endpoint = endpoint_of(tmp_path / "A")
    assert not {"task", "sim", "classifier", "agent"} & set(process.children())
    for victim, actions in (("together", 7), ("router", 30), ("together", 150), ("store", 20)):
        kill_after(process, endpoint, victim, actions)
    assert process.end() == 0, process.err
    assert process.err == ""
    assert digests_in(tmp_path / "A") == reference(DISTURBED)
    assert process.out.count("together was killed by SIGKILL; starting it again") == 2


def test_a_script_from_outside_reads_the_q_table_of_a_living_cell(
    up: Callable[..., Any], endpoint_of: Callable[[Path], str], wait_until: Callable[..., None], tmp_path: Path
) -> None:
    up(tmp_path / "A", 100_000)
    endpoint = endpoint_of(tmp_path / "A")
    answer: list[str] = []

    def learnt() -> bool:
        done = subprocess.run([sys.executable, str(SCRIPT), endpoint], capture_output=True, text=True, timeout=60)
        answer[:] = done.stdout.splitlines()
        return len(answer) > 1

    wait_until("the agent has learnt something", learnt)
    assert [line.split(":")[0] for line in answer] == [f"state {number}" for number in range(len(answer))]


def test_a_secured_cell_ends_as_the_run_in_one_process(
    up: Callable[..., Any],
    reference: Callable[..., Digests],
    digests_in: Callable[[Path], Digests],
    endpoint_of: Callable[[Path], str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    certs, out = tmp_path / "certs", tmp_path / "A"
    certify(certs, [], 365)
    # What says who we are in this terminal is not for the services.
    monkeypatch.setenv("TREENAIL_CERTS", str(certs / "guest"))
    process = up(out, EPISODES, "--certs", str(certs))
    endpoint = endpoint_of(out)
    assert process.end() == 0, process.err
    assert process.err == ""
    assert digests_in(out) == reference(EPISODES)
    assert f"listening on {endpoint} (mutual TLS, access control)" in (out / "logs" / "router.log").read_text()
    assert endpoint.startswith("tls/127.0.0.1:")


def test_through_emulated_hardware_a_run_ends_as_the_one_in_one_process(
    run_module: Callable[..., Any],
    small: Path,
    reference: Callable[..., Digests],
    digests_in: Callable[[Path], Digests],
    tmp_path: Path,
) -> None:
    """And a sensor that is read in counts already is left as it is."""
    coarse = ("sensor.full_scale_n=65", "sensor.full_scale_dnm=50")
    settings = (word for item in coarse for word in ("--set", item))
    length = ("--experiment", str(small), "--episodes", "4", "--seed", "1", "--out", str(tmp_path / "A"))
    process = run_module("treenail.__main__", "up", "hil", *length, "--port", "0", "--no-viewer", *settings)
    assert process.end() == 0, process.err
    assert process.err == ""
    assert "the sensor is read in counts" not in process.out
    assert digests_in(tmp_path / "A") == reference(4, 1, *coarse)
