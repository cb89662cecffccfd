"""What a whole cell learnt is rebuilt from its store's file, or over Zenoh while it learns; what is forged is found."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from services.store.database import Database
from services.store.values import Put
from services.wire.codec import decode, encode
from services.wire.messages import JournalEpisode

EPISODES = 24
"""More than there are between two checkpoints."""


@pytest.fixture
def treenail(run_module: Callable[..., Any]) -> Callable[..., tuple[int, Any]]:
    """Runs a command with ``--json`` and returns its exit status and what it says."""

    def ask(*words: str) -> tuple[int, Any]:
        process = run_module("treenail.__main__", *words, "--json")
        status = process.end()
        assert process.err == ""
        return status, json.loads(process.out)

    return ask


def test_store_that_a_cell_left_is_replayed_and_a_forged_copy_is_found_out(
    up: Callable[..., Any],
    treenail: Callable[..., tuple[int, Any]],
    digests_in: Callable[[Path], dict[str, str]],
    tmp_path: Path,
) -> None:
    out = tmp_path / "A"
    process = up(out, EPISODES)
    assert process.end() == 0, process.err
    before = (out / "store.sqlite").read_bytes()
    status, found = treenail("replay", "--store", str(out))
    assert (status, found["equal"], found["episodes"]) == (0, True, EPISODES)
    assert found["digests"] == digests_in(out)
    assert {one["witness"].rpartition(f"{found['run']}/")[2] for one in found["compared"]} == {
        *(f"{service}/{episode}" for service in ("agent", "classifier") for episode in ("00000020", "latest")),
        "latest",
        "summary.json",
    }
    assert found["bounded_episodes"] == 0
    assert (out / "store.sqlite").read_bytes() == before

    forged = tmp_path / "forged.sqlite"
    shutil.copy(out / "store.sqlite", forged)
    place = forge_a_reward(forged, found["run"], 7)
    status, bad = treenail("replay", "--store", str(forged), "--summary", str(out / "summary.json"))
    assert status == 1
    assert (bad["first_mismatch"]["episode"], bad["first_mismatch"]["step"]) == place
    assert bad["first_mismatch"]["field"] == "reward"
    verdicts = {one["part"]: one["equal"] for one in bad["compared"] if one["witness"] == "summary.json"}
    assert verdicts == {"q_table": False, "art2": True, "episodes": True}
    status, parted = treenail("diff", "--store", str(out), "--store-b", str(forged))
    assert (status, parted["parting"]["field"], parted["parting"]["b"]) == (1, "reward", -77.0)
    assert (parted["parting"]["episode"], parted["parting"]["step"]) == place


def forge_a_reward(path: Path, run: str, episode: int) -> tuple[int, int]:
    """Change one reward in a store's file, under a valid digest, and return its episode and step."""
    with Database(path) as database:
        (value,) = database.get(f"treenail/a/journal/{run}/000000/{episode:08d}").values
        entry = decode(JournalEpisode, value.payload, value.encoding)
        first, *others = entry.steps
        payload = encode(replace(entry, steps=(replace(first, reward=-77.0), *others)))
        later = f"{int(value.timestamp[:16], 16) + 1:016x}{value.timestamp[16:]}"
        assert database.apply([Put(value.key, payload, value.encoding, later)]) == 1
    return episode, first.step


def test_cell_that_learns_is_replayed_beside_its_workers(
    up: Callable[..., Any],
    treenail: Callable[..., tuple[int, Any]],
    endpoint_of: Callable[[Path], str],
    after_actions: Callable[[str, int], None],
    tmp_path: Path,
) -> None:
    out = tmp_path / "A"
    process = up(out, 100_000)
    endpoint = endpoint_of(out)
    after_actions(endpoint, 150)
    status, found = treenail("replay", "--connect", endpoint)
    assert status == 0, found
    living = {one["witness"]: one["equal"] for one in found["compared"] if "living" in one["witness"]}
    assert living == {"agent, living": True, "classifier, living": True}
    status, from_file = treenail("replay", "--store", str(out))
    assert status == 0
    assert from_file["episodes"] >= found["episodes"] > 0
    status, then = treenail("replay", found["run"], "--connect", endpoint, "--until", str(found["episodes"]))
    assert (status, then["digests"]) == (0, found["digests"])
    status, both = treenail("diff", found["run"], "--connect", endpoint, "--store-b", str(out))
    assert both["parting"] is None
    assert both["episodes_compared"] >= found["episodes"]
    assert process.popen.poll() is None, process.err
