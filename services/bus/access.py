"""Who may do what in a cell, by the name in a certificate; what is not allowed here, the router denies.

``python -m services.bus.access`` prints the table of docs/security.md.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import NamedTuple

from services.wire.keys import (
    ACTION,
    CLASSIFIER_STATES,
    CLASSIFY,
    EPISODE,
    EXPERIMENT,
    FT,
    HOME,
    MOVE,
    OBSERVATION,
    POLICY,
    Q_TABLE,
    REWARD,
    ROOT,
    SKILL,
    STATE,
    SWAP,
    SWAPS,
    TASK_STEPS,
    TRUTH,
)

ROUTER = "router"
SERVICES = ("sim", "sensor_jr3", "robot_link", "task", "classifier", "agent", "store", "viewer")
OPERATOR, GUEST = "operator", "guest"
CLIENTS = (*SERVICES, OPERATOR, GUEST)
NAMES = (ROUTER, *CLIENTS)
"""All names that a certificate may have."""

READERS = ("viewer", OPERATOR, GUEST)
WORKERS = ("classifier", "agent")
ROBOTS = ("sim", "robot_link")


class Access(NamedTuple):
    """Who may do what with a key."""

    put: tuple[str, ...] = ()
    delete: tuple[str, ...] = ()
    hear: tuple[str, ...] = ()
    """Subscribe, and get what is put."""
    ask: tuple[str, ...] = ()
    answer: tuple[str, ...] = ()
    be: tuple[str, ...] = ()
    """Hold a liveliness token."""
    watch: tuple[str, ...] = ()
    """See the liveliness tokens of others."""


ACCESS: dict[str, Access] = {
    FT: Access(put=("sim", "sensor_jr3"), hear=("task", "robot_link", *READERS)),
    OBSERVATION: Access(put=("task",), hear=("classifier", *READERS)),
    STATE: Access(put=("classifier",), hear=("agent", *READERS)),
    ACTION: Access(put=("agent",), hear=("task", *READERS)),
    REWARD: Access(put=("task",), hear=("agent", *READERS)),
    EPISODE: Access(put=("task",), hear=CLIENTS),
    TRUTH: Access(put=("sim",), hear=READERS),
    MOVE: Access(ask=("task",), answer=ROBOTS),
    HOME: Access(ask=("task",), answer=ROBOTS),
    EXPERIMENT: Access(ask=CLIENTS, answer=("task",)),
    SWAP: Access(ask=(OPERATOR,), answer=("task",)),
    TASK_STEPS: Access(ask=WORKERS, answer=("task",)),
    Q_TABLE: Access(ask=CLIENTS, answer=("agent",)),
    POLICY: Access(ask=CLIENTS, answer=("agent",)),
    CLASSIFIER_STATES: Access(ask=CLIENTS, answer=("classifier",)),
    CLASSIFY: Access(ask=CLIENTS, answer=("classifier",)),
    "journal/**": Access(hear=("store", *READERS), ask=("task", *WORKERS, *READERS), answer=("store",)),
    "journal/<run>/run": Access(put=("task",)),
    "journal/<run>/<block>/<episode>": Access(put=("task",)),
    f"journal/<run>/{SWAPS}": Access(put=("task",)),
    "journal/<run>/latest": Access(put=("task",)),
    "checkpoint/**": Access(hear=("store", *READERS), ask=READERS, answer=("store",)),
    "checkpoint/<run>/<service>/<episode>": Access(put=WORKERS, ask=WORKERS),
    "checkpoint/<run>/<service>/latest": Access(put=WORKERS, ask=WORKERS),
    f"{SKILL}/<sha256>": Access(put=("task", OPERATOR), delete=(OPERATOR,), ask=("task", *WORKERS)),
    f"{SKILL}/latest": Access(put=("task", OPERATOR), delete=(OPERATOR,), hear=("task",), ask=("task", *WORKERS)),
    "alive/<service>": Access(ask=CLIENTS, answer=SERVICES, be=SERVICES, watch=CLIENTS),
    "claim/<service>/<instance>": Access(be=SERVICES, watch=CLIENTS),
    "heartbeat/<service>": Access(put=SERVICES, hear=CLIENTS),
}
"""By key of the contract. Under a key with ``<service>`` in it, a service speaks with its own name there only.

The two keys that end in ``**`` are what the store serves, and what may be asked for with one question.
"""

_IN, _OUT = "ingress", "egress"
_OWN: dict[str, tuple[tuple[str, str], ...]] = {
    "put": ((_IN, "put"),),
    "delete": ((_IN, "delete"),),
    "answer": ((_IN, "declare_queryable"), (_IN, "reply")),
    "be": ((_IN, "liveliness_token"),),
}
"""What a permission means in Zenoh's terms, on keys with one's own name; the router's view: ingress comes from us."""
_ANY: dict[str, tuple[tuple[str, str], ...]] = {
    "hear": ((_IN, "declare_subscriber"), (_OUT, "put"), (_OUT, "delete")),
    "ask": ((_IN, "query"), (_OUT, "reply")),
    # A question may be put to several at once, as in alive/*.
    "answer": ((_OUT, "query"),),
    "watch": ((_IN, "declare_liveliness_subscriber"), (_IN, "liveliness_query"), (_OUT, "liveliness_token")),
}
"""The same, on keys with any name."""


def access_control() -> dict[str, object]:
    """Return Zenoh's configuration for ACCESS: for the cells of any name, with all else denied."""
    rules: list[dict[str, object]] = []
    policies: list[dict[str, object]] = []
    for name in CLIENTS:
        mine: dict[tuple[str, str], set[str]] = {}
        for flow, message, key in _grants(name):
            mine.setdefault((flow, message), set()).add(key)
        named = {f"{name} {flow} {message}": (flow, message, keys) for (flow, message), keys in mine.items()}
        for rule, (flow, message, keys) in named.items():
            what = {"flows": [flow], "messages": [message], "key_exprs": sorted(keys)}
            rules.append({"id": rule, "permission": "allow", **what})
        policies.append({"rules": list(named), "subjects": [name]})
    subjects = [{"id": name, "cert_common_names": [name]} for name in CLIENTS]
    settings = {"enabled": True, "default_permission": "deny"}
    return {**settings, "rules": rules, "subjects": subjects, "policies": policies}


def _grants(name: str) -> Iterator[tuple[str, str, str]]:
    """Give the flow, message and key expression of all that a client may do."""
    # Without hearing who listens, Zenoh does not send.
    yield _OUT, "declare_subscriber", f"{ROOT}/**"
    yield _OUT, "declare_queryable", f"{ROOT}/**"
    if name in READERS:
        yield _IN, "declare_subscriber", f"{ROOT}/**"  # to all at once; what comes is still what they may hear
    for key, access in ACCESS.items():
        own = f"{ROOT}/*/{_wild(key.replace('<service>', name))}"
        whole = f"{ROOT}/*/{_wild(key)}"
        for verb in (verb for verb, names in access._asdict().items() if name in names):
            for flow, message in _OWN.get(verb, ()):
                yield flow, message, own
            for flow, message in _ANY.get(verb, ()):
                yield flow, message, whole


def _wild(key: str) -> str:
    """Return a key of the contract as a key expression."""
    return re.sub(r"<\w+>", "*", key)


def table() -> str:
    """Return ACCESS as a table in Markdown."""
    lines = ["| key | " + " | ".join(Access._fields) + " |", "|---" * (1 + len(Access._fields)) + "|"]
    for key, access in ACCESS.items():
        lines.append(f"| `{key}` | " + " | ".join(_words(names) for names in access) + " |")
    return "\n".join(lines) + "\n"


def _words(names: tuple[str, ...]) -> str:
    """Return some names, with a word for the groups that occur often."""
    for group, word in ((CLIENTS, "everyone"), (SERVICES, "each service"), (READERS, "readers")):
        if set(group) <= set(names):
            return ", ".join([*(name for name in names if name not in group), word])
    return ", ".join(names)


if __name__ == "__main__":
    print(table(), end="")
