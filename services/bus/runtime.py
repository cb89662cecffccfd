"""Zenoh's thread pools in a process: fewer of them mean fewer wake-ups and so less latency.

Zenoh reads ``ZENOH_RUNTIME`` once per process, before its first session; what somebody has set there himself stays. See
docs/decisions/0003-zenoh-runtime.md.
"""

from __future__ import annotations

import os

_NAME = "ZENOH_RUNTIME"
_TOGETHER = "rx: (handover: app), net: (handover: app), acc: (handover: app)"
SERVICE = f"(app: (worker_threads: 2), {_TOGETHER}, tx: (handover: app))"
"""One pool for all. In a service no thread of it ever waits for room to send: our own loop does."""
ROUTER = "(rx: (worker_threads: 16), tx: (worker_threads: 2))"
"""Receiving has threads to spare: one that passes on an answer to who takes nothing may be lost for seconds. And it
shares none with the rest: a router that reads 24 MB in one pool for all loses who is to be given them."""


def use(pools: str) -> None:
    """Have the sessions of this process run by these pools, unless somebody chose others or a session is open."""
    if os.environ.get(_NAME) in (None, SERVICE, ROUTER):  # a child of ours inherits what its parent has set
        os.environ[_NAME] = pools
