"""The store over Zenoh: to a client it is one of Zenoh's own storages."""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Any

import pytest
import zenoh

KEY = "treenail/a/checkpoint/notes/"


def contents(live: Any, selector: str = KEY + "**") -> dict[str, str]:
    """Return what the store answers, by key."""
    return {
        str(reply.ok.key_expr): reply.ok.payload.to_string()
        for reply in live.session.get(selector, timeout=5.0)
        if reply.ok is not None
    }


@pytest.fixture
def put(live: Any, wait_until: Callable[..., None]) -> Callable[..., None]:
    """Put text and read it back: the only proof that there is."""

    def store(name: str, text: str) -> None:
        live.session.put(KEY + name, text, encoding="text/plain")
        wait_until(f"{name} is stored", lambda: contents(live, KEY + name) == {KEY + name: text})

    return store


def test_the_newest_value_of_each_key_is_given_back(live: Any, put: Callable[..., None]) -> None:
    put("a", "1")
    put("b/c", "2")
    put("a", "3")
    assert contents(live) == {KEY + "a": "3", KEY + "b/c": "2"}
    assert contents(live, KEY + "*") == {KEY + "a": "3"}
    assert contents(live, KEY + "*/c") == {KEY + "b/c": "2"}
    assert contents(live, KEY + "nothing") == {}
    (reply,) = live.session.get(KEY + "a")
    assert str(reply.ok.encoding) == "text/plain"


def test_versions_are_numbered_keys(live: Any, put: Callable[..., None]) -> None:
    for number in range(5):
        put(f"weights/{number:04d}", f"version {number}")
    assert contents(live, KEY + "weights/0003") == {KEY + "weights/0003": "version 3"}
    assert sorted(contents(live, KEY + "weights/*").values()) == [f"version {number}" for number in range(5)]


def test_deletes_take_one_key_or_many(live: Any, put: Callable[..., None], wait_until: Callable[..., None]) -> None:
    for name in ("a", "b", "c/d", "c/e", "f"):
        put(name, name)
    live.session.delete(KEY + "a")
    wait_until("one is gone", lambda: set(contents(live).values()) == {"b", "c/d", "c/e", "f"})
    live.session.delete(KEY + "c/**")
    wait_until("two are gone", lambda: set(contents(live).values()) == {"b", "f"})


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_store_that_starts_again_has_it_all(live: Any, put: Callable[..., None], number: signal.Signals) -> None:
    for index in range(20):
        put(f"{index:08d}", f"value {index}")
    before = contents(live)
    live.processes["store"].stop(number)
    assert contents(live) == {}
    live.start_store()
    live.wait_alive("store")
    assert contents(live) == before


def test_an_older_value_is_passed_over(live: Any, put: Callable[..., None], wait_until: Callable[..., None]) -> None:
    earlier: zenoh.Timestamp = live.session.new_timestamp()
    put("a", "new")
    live.session.put(KEY + "a", "old", encoding="text/plain", timestamp=earlier)
    live.session.put(KEY + "b", "old, but the first", encoding="text/plain", timestamp=earlier)
    wait_until("both have arrived", lambda: len(contents(live)) == 2)
    assert contents(live) == {KEY + "a": "new", KEY + "b": "old, but the first"}
    live.session.delete(KEY + "a", timestamp=earlier)
    put("c", "later")
    assert contents(live, KEY + "a") == {KEY + "a": "new"}


def test_a_value_for_many_keys_at_once_is_refused(
    live: Any, put: Callable[..., None], wait_until: Callable[..., None]
) -> None:
    put("a", "1")
    put("b", "2")
    live.session.put(KEY + "*", "all", encoding="text/plain")
    wait_until("it is refused", lambda: live.refused("store").get("BadPayloadError") == 1)
    assert contents(live) == {KEY + "a": "1", KEY + "b": "2"}
