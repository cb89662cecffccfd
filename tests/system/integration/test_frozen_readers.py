"""Nobody who watches can hold up those who work: a reader that stops, or is slow, loses messages or its connection."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import pytest
import zenoh

from services.bus.ports import free_port
from services.bus.session import open_client
from services.wire.keys import ACTION, FT, Keys

KEYS = Keys("a")
BLOCK = zenoh.CongestionControl.BLOCK
READER = """
import json, sys, time, zenoh
from zenoh.handlers import Callback
lease = {"transport": {"link": {"tx": {"lease": 1000000}}}}
common = {"mode": "client", "connect": {"endpoints": [sys.argv[1]]}, "scouting": {"multicast": {"enabled": False}}}
session = zenoh.open(zenoh.Config.from_json5(json.dumps({**common, **lease})))
pause_s = 0.2 if sys.argv[2] == "slow" else 0.0
held = session.declare_subscriber("treenail/**", Callback(lambda sample: time.sleep(pause_s), indirect=False))
print("ready", flush=True)
if sys.argv[2] == "asks":
    sys.stdin.readline()
    for number in range(4):
        session.get(f"treenail/a/journal/{number}", Callback(lambda reply: time.sleep(5), indirect=False), timeout=60)
    print("asked", flush=True)
time.sleep(1000)
"""
STORE = """
import sys, time
from services.bus.session import open_client
session = open_client([sys.argv[1]], 30.0)
def answer(query):
    with query:
        for _ in range(100):
            query.reply(query.key_expr, bytes(200_000))
held = session.declare_queryable("treenail/a/journal/**", answer)
print("ready", flush=True)
time.sleep(1000)
"""
LONGEST_GAP_S = 1.0
"""A busy machine has pauses of its own; what this test is about lasted 5 to 10 s."""
WATCHED_S = 6.0


@pytest.mark.parametrize("kinds", [("stopped",), ("stopped", "stopped", "stopped", "slow"), ("asks",) * 4])
def test_a_reader_that_does_not_read_delays_nobody(
    run_module: Callable[..., Any], wait_until: Callable[..., None], kinds: tuple[str, ...]
) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    run_module("services.router", "--listen", endpoint)
    heard: list[float] = []
    with open_client([endpoint], 30.0) as speaker, open_client([endpoint], 30.0) as hearer:
        held = hearer.declare_subscriber(KEYS.of(ACTION), lambda _: heard.append(time.monotonic()))
        action, ft = (speaker.declare_publisher(KEYS.of(name), congestion_control=BLOCK) for name in (ACTION, FT))

        def speak(seconds: float) -> None:
            until = time.monotonic() + seconds
            while time.monotonic() < until:
                ft.put(bytes(20000))
                action.put(bytes(100))
                time.sleep(0.001)

        codes = [(READER, kind) for kind in kinds] + [(STORE, "store")]
        readers = [
            subprocess.Popen([sys.executable, "-c", *of, endpoint, kind], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
            for *of, kind in codes
        ]
        try:
            for reader in readers:
                assert reader.stdout is not None and reader.stdout.readline() == b"ready\n"
            speak(0.5)
            wait_until("it is heard", lambda: heard)
            heard.clear()
            began = time.monotonic()
            for reader, kind in zip(readers, kinds, strict=False):
                if kind == "asks":
                    assert reader.stdin is not None and reader.stdout is not None
                    reader.stdin.write(b"\n")
                    reader.stdin.flush()
                    assert reader.stdout.readline() == b"asked\n"
                if kind != "slow":
                    reader.send_signal(signal.SIGSTOP)
            speak(WATCHED_S)
            wait_until("what was said last is heard", lambda: heard and heard[-1] > began + WATCHED_S - 0.1)
        finally:
            for reader in readers:
                reader.kill()
                reader.communicate()
        gaps = [later - earlier for earlier, later in zip([began, *heard], heard, strict=False)]
        assert max(gaps) < LONGEST_GAP_S
        assert held
