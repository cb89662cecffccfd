"""Who may do what in a cell, by the name in a certificate or by the door; what is not allowed here, the router denies.

``python -m services.bus.access`` prints the table of docs/security.md.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import zenoh

from services.wire.keys import CLIENTS, CONTRACT, GUEST, READERS, ROOT, STORED, Access, people, wild

ROUTER = "router"
NAMES = (ROUTER, *CLIENTS)
"""All names that a certificate may have."""
ACCESS: dict[str, Access] = {**{key: row.access for key, row in CONTRACT.items()}, **STORED}
"""By key of the contract, and what may be asked for with one question."""

FOR_ALL, FOR_THE_CELL = "@treenail/rights/all", "@treenail/rights/cell"
"""What the router itself answers: the first to everybody, the second to who may do everything. No cell's keys."""

ROS_THERE = "@ros2_lv"
"""Under which ROS 2 says who is there. As in all keys that begin so, no wildcard leads to it."""

_IN, _OUT = "ingress", "egress"
_MESSAGES = (
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "reply",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)
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


def by_certificate() -> dict[str, object]:
    """Return Zenoh's configuration for ACCESS by names in certificates: for cells of any name, with all else denied."""
    return _control({name: {"cert_common_names": [name]} for name in CLIENTS})


def by_door(trusted: Sequence[str] = (), ros2: Sequence[int] = ()) -> dict[str, object]:
    """Return Zenoh's configuration for ACCESS without certificates.

    Who comes in by a Unix socket, which its folder guards, or by one of the ``trusted`` network interfaces is of the
    cell and may do everything; whoever else comes is a guest. In the domains ``ros2``, whoever comes may do all that
    a process of ROS 2 does: those have no other rights, and ROS asks nobody who he is.
    """
    control = _control({GUEST: {}})
    everything = {
        "flows": [_IN, _OUT],
        "messages": list(_MESSAGES),
        "key_exprs": ["**", FOR_ALL, FOR_THE_CELL, f"{ROS_THERE}/**"],
    }
    rule = {"id": "everything", "permission": "allow", **everything}
    doors: list[dict[str, object]] = [{"id": "own socket", "link_protocols": ["unixsock-stream"]}]
    if trusted:
        doors.append({"id": "trusted", "interfaces": list(trusted)})
    policies = [{"rules": ["everything"], "subjects": [door["id"] for door in doors]}]
    rules = [rule]
    if ros2:
        keys = [key for domain in ros2 for key in (f"{domain}/**", f"{domain}/**/@adv/**", f"{ROS_THERE}/{domain}/**")]
        rules.append({"id": "ros2", "permission": "allow", **everything, "key_exprs": keys})
        policies.append({"rules": ["ros2"], "subjects": [GUEST]})
    return {
        **control,
        "rules": [*control["rules"], *rules],
        "subjects": [*control["subjects"], *doors],
        "policies": [*control["policies"], *policies],
    }


def may(name: str, verb: str, key: str) -> bool:
    """Return whether a client called ``name`` may do something with a key expression, without the cell in it.

    What is no key expression, nobody may.
    """
    try:
        wanted = zenoh.KeyExpr(key.partition("?")[0])
    except zenoh.ZError:
        return False
    return any(
        zenoh.KeyExpr(wild(pattern.replace("<service>", name) if verb in _OWN else pattern)).includes(wanted)
        for pattern, access in ACCESS.items()
        if name in getattr(access, verb)
    )


def who_may(verb: str, key: str) -> list[str]:
    """Return the names of all clients that may do something with a key."""
    return [name for name in CLIENTS if may(name, verb, key)]


def _control(subjects: Mapping[str, Mapping[str, object]]) -> dict[str, Any]:
    """Return what lets the clients of some names do what ACCESS says, by how each of them is told."""
    rules: list[dict[str, object]] = []
    policies: list[dict[str, object]] = []
    for name in subjects:
        mine: dict[tuple[str, str], set[str]] = {}
        for flow, message, key in _grants(name):
            mine.setdefault((flow, message), set()).add(key)
        named = {f"{name} {flow} {message}": (flow, message, keys) for (flow, message), keys in mine.items()}
        for rule, (flow, message, keys) in named.items():
            what = {"flows": [flow], "messages": [message], "key_exprs": sorted(keys)}
            rules.append({"id": rule, "permission": "allow", **what})
        policies.append({"rules": list(named), "subjects": [name]})
    settings = {"enabled": True, "default_permission": "deny"}
    told = [{"id": name, **how} for name, how in subjects.items()]
    return {**settings, "rules": rules, "subjects": told, "policies": policies}


def _grants(name: str) -> Iterator[tuple[str, str, str]]:
    """Give the flow, message and key expression of all that a client may do."""
    yield _IN, "query", FOR_ALL
    yield _OUT, "reply", FOR_ALL
    # Without hearing who listens, Zenoh does not send.
    yield _OUT, "declare_subscriber", f"{ROOT}/**"
    yield _OUT, "declare_queryable", f"{ROOT}/**"
    if name in READERS:
        yield _IN, "declare_subscriber", f"{ROOT}/**"  # to all at once; what comes is still what they may hear
    for key, access in ACCESS.items():
        own = f"{ROOT}/*/{wild(key.replace('<service>', name))}"
        whole = f"{ROOT}/*/{wild(key)}"
        for verb in (verb for verb, names in access._asdict().items() if name in names):
            for flow, message in _OWN.get(verb, ()):
                yield flow, message, own
            for flow, message in _ANY.get(verb, ()):
                yield flow, message, whole


def table() -> str:
    """Return ACCESS as a table in Markdown."""
    lines = ["| key | " + " | ".join(Access._fields) + " |", "|---" * (1 + len(Access._fields)) + "|"]
    for key, access in ACCESS.items():
        lines.append(f"| `{key}` | " + " | ".join(people(names) for names in access) + " |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(table(), end="")
