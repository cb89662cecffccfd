"""Who may do what in a cell, by the name in a certificate; what is not allowed here, the router denies.

``python -m services.bus.access`` prints the table of docs/security.md.
"""

from __future__ import annotations

from collections.abc import Iterator

from services.wire.keys import CLIENTS, CONTRACT, READERS, ROOT, STORED, Access, people, wild

ROUTER = "router"
NAMES = (ROUTER, *CLIENTS)
"""All names that a certificate may have."""
ACCESS: dict[str, Access] = {**{key: row.access for key, row in CONTRACT.items()}, **STORED}
"""By key of the contract, and what may be asked for with one question."""

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
