"""What a service says of itself, for tests of who reads it."""

from __future__ import annotations

from services.wire.messages import Alive


def alive(service: str, **changed: object) -> Alive:
    """Return a sound heartbeat; what matters to a test it says by name."""
    fields: dict[str, object] = {
        "service": service,
        "instance": "1",
        "host": "here",
        "pid": 1,
        "version": "0",
        "contract_sha256": "0" * 64,
        "started_t_ns": 0,
        "beat": 1,
        "handled": 0,
        "refused": {},
        "run": None,
        "phase": "running",
        **changed,
    }
    return Alive(**fields)  # type: ignore[arg-type]
