"""Which thread pools a process's sessions get."""

from __future__ import annotations

import os

import pytest

from services.bus import runtime


@pytest.fixture(autouse=True)
def nothing_set(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ZENOH_RUNTIME", "")  # so that it is put back afterwards
    monkeypatch.delenv("ZENOH_RUNTIME")


@pytest.mark.parametrize("pools", [runtime.SERVICE, runtime.ROUTER])
def test_a_process_has_the_pools_of_its_kind(pools: str) -> None:
    runtime.use(pools)
    assert os.environ["ZENOH_RUNTIME"] == pools


def test_a_router_started_by_a_client_has_a_routers_pools() -> None:
    runtime.use(runtime.SERVICE)
    runtime.use(runtime.ROUTER)
    assert os.environ["ZENOH_RUNTIME"] == runtime.ROUTER


def test_what_somebody_has_chosen_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ZENOH_RUNTIME", "(tx: (worker_threads: 2))")
    runtime.use(runtime.ROUTER)
    assert os.environ["ZENOH_RUNTIME"] == "(tx: (worker_threads: 2))"
