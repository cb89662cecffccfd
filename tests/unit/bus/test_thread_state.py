"""Zenoh's threads keep what Python knows of them from message to message."""

from __future__ import annotations

import json
import threading
import time

import zenoh
from zenoh.handlers import Callback

from services.bus.inbox import Inbox
from services.bus.ports import free_port

MESSAGES = 20


def test_what_belongs_to_a_thread_is_still_there_at_its_next_message() -> None:
    inbox, own = Inbox(), threading.local()
    came: list[bool] = []

    def take(sample: zenoh.Sample) -> None:
        came.append(hasattr(own, "came"))
        own.came = True
        inbox.post(lambda _: None, sample, lambda error: None)

    endpoint = f"tcp/127.0.0.1:{free_port()}"
    speaker, hearer = _session(listen=[endpoint], connect=[]), _session(listen=[], connect=[endpoint])
    with speaker, hearer:
        held = hearer.declare_subscriber("here", Callback(take, indirect=False))
        publisher = speaker.declare_publisher("here")
        until = time.monotonic() + 20.0
        while len(came) < MESSAGES and time.monotonic() < until:
            publisher.put(b"")
            time.sleep(0.02)
    assert held
    # It is new to each thread once, and there are fewer threads than messages.
    assert not came[0]
    assert sum(came) > MESSAGES / 2


def _session(**ends: list[str]) -> zenoh.Session:
    settings = {"mode": "peer", "scouting": {"multicast": {"enabled": False}}}
    places = {name: {"endpoints": endpoints} for name, endpoints in ends.items()}
    return zenoh.open(zenoh.Config.from_json5(json.dumps({**settings, **places})))
