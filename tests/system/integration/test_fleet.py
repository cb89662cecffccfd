"""A fleet: services that take the first cell without one, a store for all of them, and no cross-talk."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any

import pytest

from services.bus import roles
from services.bus.session import open_client
from services.wire.keys import Keys

CELLS = 2
EPISODES = 24
SEED = 3


@pytest.fixture
def fleet(house: Any) -> list[Any]:
    """The cells, each with its workers; their processes are not in any order."""
    house.start_store("--fleet", str(CELLS))
    run = ("--experiment", str(house.definition), "--seed", str(SEED), "--episodes", str(EPISODES))
    for _ in range(CELLS):
        for name in ("task", "sim", "classifier", "agent"):
            house.start(name, "--fleet", str(CELLS), *(run if name == "task" else ()))
    return [replace(house, keys=Keys(str(place + 1))) for place in range(CELLS)]


def test_each_cell_of_a_fleet_ends_as_a_single_run_though_workers_die(
    fleet: list[Any], house: Any, reference: Callable[..., dict[str, str]], wait_until: Callable[..., None]
) -> None:
    fleet[0].wait_actions(60)
    for name in ("agent", "task"):
        house.processes[name].popen.kill()
        more = ("--experiment", str(house.definition), "--seed", str(SEED), "--episodes", str(EPISODES))
        house.start(name, "--fleet", str(CELLS), *(more if name == "task" else ()))
    for place, cell in enumerate(fleet):
        assert cell.digests() == reference(EPISODES, SEED + place)


def test_a_service_without_a_free_cell_says_so(fleet: list[Any], house: Any, wait_until: Callable[..., None]) -> None:
    for cell in fleet:
        cell.wait_alive("store", "task", "sim", "classifier", "agent")
    process = house.start("agent", "--fleet", str(CELLS))
    line = "waiting: agent: expected one of the 2 cells 1 to 2 to be without one, all have theirs"
    wait_until("it says so", lambda: line in process.out)


def test_what_is_refused_is_counted_in_the_cell_that_it_came_to(
    fleet: list[Any], house: Any, wait_until: Callable[..., None]
) -> None:
    for cell in fleet:
        cell.wait_alive("store")
    house.session.put(Keys("2").checkpoint_latest("x", "agent"), b"garbage")
    wait_until("it is counted", lambda: fleet[1].refused("store"))
    assert fleet[0].refused("store") == {}


def test_who_claims_a_cell_just_before_an_earlier_claim_is_seen_takes_the_next(
    house: Any, wait_until: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(roles, "SETTLE_S", 5.0)  # or a busy machine takes longer to see the claim than it is unsettled
    cells = [Keys("1"), Keys("2")]
    earlier = house.session.liveliness()
    claims = Keys("1").of("claim/agent/*")

    def held() -> set[str]:
        replies = earlier.get(claims, timeout=1.0)  # Zenoh may give a session its own token twice
        return {str(reply.ok.key_expr) for reply in replies if reply.ok is not None}

    with open_client([house.endpoint]) as session, ThreadPoolExecutor() as pool:
        taking = pool.submit(roles.take_role, session, cells, "agent", lambda: False, lambda _: None)
        wait_until("the claim is there", held)
        first = Keys("1").of(f"claim/agent/{1:020d}-{house.session.zid()}")
        token = earlier.declare_token(first)
        taken = taking.result(30.0)
        assert taken is not None and taken.keys.cell == "2"
        wait_until("its own claim is gone", lambda: held() == {first})
        token.undeclare()


@pytest.mark.parametrize("number", ["0", "-1", "1001", "x"])
def test_a_fleet_of_no_size_is_one_line(run_module: Callable[..., Any], number: str) -> None:
    process = run_module("services.agent", f"--fleet={number}")
    assert process.end() == 2
    (line,) = process.err.splitlines()
    assert "--fleet" in line
