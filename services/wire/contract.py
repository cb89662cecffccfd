"""Writes docs/contract.md from the messages and keys: ``python -m services.wire.contract``."""

from __future__ import annotations

import inspect
import typing
from collections.abc import Iterator

from msgspec import Struct

from services.wire.codec import contract_sha256, encoding_of
from services.wire.keys import CONTRACT, JOURNAL_BLOCK, ROOT
from services.wire.messages import MESSAGES, JournalStep, Message, Swap


def page() -> str:
    """Return the whole page as Markdown."""
    return "\n".join(_lines()) + "\n"


def _lines() -> Iterator[str]:
    yield "# The contract"
    yield ""
    yield "Generated from `services/wire` by `make docs`; a test holds it to that."
    yield ""
    yield f"Contract hash: `{contract_sha256()}`. Peers that show another one do not understand each other."
    yield ""
    yield f"All keys live under `{ROOT}/<cell>/`. Payloads are MessagePack maps; the Zenoh encoding names type and"
    yield f"version, for example `{encoding_of(MESSAGES[0])}`. Any query takes `?format=json`"
    yield "and then answers in JSON. A request that is refused gets an error reply of type `Refusal`."
    yield f"A journal block holds {JOURNAL_BLOCK} episodes: `<block>` is six digits, `<episode>` eight."
    yield ""
    yield "| key | kind | from, to | type | what |"
    yield "|---|---|---|---|---|"
    for key, row in CONTRACT.items():
        types = " -> ".join(kind.__name__ for kind in row.types) or "-"
        yield f"| `{key}` | {row.kind} | {row.route} | {types} | {row.what} |"
    yield ""
    yield "## Types"
    kinds: tuple[type[Message] | type[JournalStep] | type[Swap], ...] = (*MESSAGES, JournalStep, Swap)
    for kind in kinds:
        yield from _type(kind)


def _type(kind: type[Message] | type[JournalStep] | type[Swap]) -> Iterator[str]:
    version = getattr(kind, "VERSION", None)
    yield ""
    yield f"### {kind.__name__}" + ("" if version is None else f" (version {version})")
    yield ""
    yield inspect.cleandoc(kind.__doc__ or "")
    yield ""
    yield "| field | type | range |"
    yield "|---|---|---|"
    hints = hints_of(kind)
    for name in kind.__struct_fields__:
        text, bounds = describe(hints[name])
        yield f"| `{name}` | {text} | {bounds} |"


def hints_of(kind: type[Struct]) -> dict[str, object]:
    """Return the types of a message's or table's fields, with their ranges."""
    return typing.get_type_hints(kind, include_extras=True)


def describe(hint: object) -> tuple[str, str]:
    """Return a type in words, and its range."""
    bounds: list[str] = []
    while typing.get_origin(hint) is typing.Annotated:
        hint, *extras = typing.get_args(hint)
        for meta in extras:
            bounds += [f"{name} {value}" for name, value in _limits(meta) if value is not None]
    if typing.get_origin(hint) is typing.Literal:
        return "one of " + ", ".join(f"`{value}`" for value in typing.get_args(hint)), ""
    if isinstance(hint, type) and not typing.get_args(hint):
        return hint.__name__, ", ".join(bounds)
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    inside = [describe(part) for part in arguments if part not in (Ellipsis, type(None))]
    words = [word for word, _ in inside]
    inner = dict.fromkeys(limit for _, limit in inside if limit)
    limits = ", ".join([*bounds, *inner])
    if origin is tuple:
        return (f"list of {words[0]}" if Ellipsis in arguments else f"({', '.join(words)})"), limits
    if origin is dict:
        return f"map of {words[0]} to {words[1]}", limits
    return " or ".join(words) + (" or none" if type(None) in arguments else ""), limits


def _limits(meta: object) -> list[tuple[str, object]]:
    names = (("at least", "ge"), ("at most", "le"), ("above", "gt"), ("below", "lt"), ("matches", "pattern"))
    sizes = (("length at least", "min_length"), ("length at most", "max_length"))
    return [(word, getattr(meta, name, None)) for word, name in (*names, *sizes)]


if __name__ == "__main__":
    print(page(), end="")
