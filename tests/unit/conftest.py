"""Values of any wire type, made from its annotations alone: one sample, random ones, and broken ones."""

from __future__ import annotations

import copy
import math
import types
import typing
from collections.abc import Callable, Iterator
from typing import Any

import msgspec
import pytest
from hypothesis import strategies as st

from services.wire.definition import Definition
from services.wire.definition_rules import contradiction

Broken = tuple[str, object]
"""Where and how a payload was broken, and the broken payload."""


def split(hint: Any) -> tuple[Any, dict[str, Any]]:
    """Take the limits off an annotated type."""
    limits: dict[str, Any] = {}
    while typing.get_origin(hint) is typing.Annotated:
        hint, *extras = typing.get_args(hint)
        for meta in extras:
            names = ("ge", "le", "gt", "lt", "pattern", "min_length", "max_length")
            limits |= {name: getattr(meta, name) for name in names if getattr(meta, name) is not None}
    return hint, limits


def fields_of(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """Types of the fields of a struct."""
    hints = typing.get_type_hints(kind, include_extras=True)
    return {name: hints[name] for name in kind.__struct_fields__}


def is_struct(hint: Any) -> bool:
    return isinstance(hint, type) and issubclass(hint, msgspec.Struct)


def usable(definition: Definition) -> Definition:
    """Return a definition with defaults in place of the sections that contradict others, as few as it takes."""
    usual = Definition(name="usual")
    found = contradiction(definition)
    named = () if found is None else (found[0].partition(".")[0],)
    for section in (
        *named,
        "limits",
        "hole",
        "start",
        "parts",
        "contact",
        "moves",
        "wrist",
        "noise",
        "sensor",
        "calibration",
        "tool",
        "classifier",
        "changes",
        "policy",
        "learner",
        "shaping",
        "felt",
    ):
        if contradiction(definition):
            definition = msgspec.structs.replace(definition, **{section: getattr(usual, section)})
    return definition


def strategy(hint: Any) -> st.SearchStrategy[Any]:
    """Values of a type over its whole range."""
    hint, limits = split(hint)
    if hint is Definition:
        return st.builds(hint, **{name: strategy(part) for name, part in fields_of(hint).items()}).map(usable)
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if is_struct(hint):
        return st.builds(hint, **{name: strategy(part) for name, part in fields_of(hint).items()})
    if origin is typing.Literal:
        return st.sampled_from(arguments)
    if origin in (typing.Union, types.UnionType):
        return st.one_of([strategy(part) for part in arguments])
    if origin is tuple and Ellipsis in arguments:
        low, high = limits.get("min_length", 0), min(limits.get("max_length", 3), 3)
        return st.lists(strategy(arguments[0]), min_size=low, max_size=high).map(tuple)
    if origin is tuple:
        return st.tuples(*(strategy(part) for part in arguments))
    if origin is dict:
        return st.dictionaries(*(strategy(part) for part in arguments), max_size=3)
    return scalar_strategy(hint, limits)


def scalar_strategy(hint: Any, limits: dict[str, Any]) -> st.SearchStrategy[Any]:
    if hint is float:
        return st.floats(
            min_value=limits.get("ge", limits.get("gt")),
            max_value=limits.get("le", limits.get("lt")),
            exclude_min="gt" in limits,
            exclude_max="lt" in limits,
        )
    if hint is int:
        return st.integers(limits.get("ge", -(2**63)), limits.get("le", 2**63 - 1))
    if hint is str and "pattern" in limits:
        return st.from_regex(limits["pattern"], alphabet=st.characters(codec="ascii"))
    if hint is str:
        return st.text(st.characters(codec="utf-8"), max_size=min(limits.get("max_length", 20), 20))
    plain = {bool: st.booleans(), bytes: st.binary(max_size=20), type(None): st.none()}
    return plain[hint]


def sample(hint: Any) -> Any:
    """One value of a type with nothing left out: no empty list or map, no None."""
    hint, limits = split(hint)
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if is_struct(hint):
        made = hint(**{name: sample(part) for name, part in fields_of(hint).items()})
        return usable(made) if isinstance(made, Definition) else made
    if origin is typing.Literal or origin in (typing.Union, types.UnionType):
        first = next(part for part in arguments if part is not type(None))
        return first if origin is typing.Literal else sample(first)
    if origin is tuple and Ellipsis in arguments:
        return (sample(arguments[0]),) * max(1, limits.get("min_length", 0))
    if origin is tuple:
        return tuple(sample(part) for part in arguments)
    if origin is dict:
        return {sample(arguments[0]): sample(arguments[1])}
    if hint is float:
        return limits["ge"] if "ge" in limits else limits.get("gt", 0.0) + 0.125
    if hint is str and "pattern" in limits:
        return "a" * next((size for size in (32, 64) if f"{{{size}}}" in limits["pattern"]), 1)
    plain: dict[Any, Any] = {int: limits.get("ge", 3), str: "text", bool: True, bytes: b"\x00\xff"}
    return plain[hint]


def spots(hint: Any, value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[tuple[Any, ...], Any]]:
    """Where each part of a value stands, with the part's type."""
    bare, _ = split(hint)
    origin, arguments = typing.get_origin(bare), typing.get_args(bare)
    if origin in (typing.Union, types.UnionType) and is_struct(type(value)):
        bare = type(value)
    yield path, hint
    if is_struct(bare):
        for name, part in fields_of(bare).items():
            yield from spots(part, getattr(value, name), (*path, name))
    elif origin is tuple:
        for index, item in enumerate(value):
            part = arguments[0] if Ellipsis in arguments else arguments[index]
            yield from spots(part, item, (*path, index))
    elif origin is dict:
        for key, item in value.items():
            yield from spots(arguments[1], item, (*path, key))


def wrong_values(hint: Any, value: Any) -> list[Any]:
    """Values that a type must refuse in place of ``value``."""
    bare, limits = split(hint)
    origin, arguments = typing.get_origin(bare), typing.get_args(bare)
    if origin in (typing.Union, types.UnionType):
        options = [part for part in arguments if part is not type(None)]
        wrong: list[Any] = [[], 1.5]
        if len(options) == len(arguments):
            wrong.append(None)
        if len(options) == 1:
            wrong = [item for item in wrong_values(options[0], value) if item is not None]
        return wrong
    if is_struct(bare):
        return [None, [], "text", 1]
    if origin is typing.Literal:
        return [None, "nonsense", 12345, 1.5, True, []]
    if origin is tuple:
        return [None, "text", {}, 1, *wrong_lengths(arguments, limits, value)]
    if origin is dict:
        return [None, [], "text", 1, {b"a1": value[next(iter(value))]}]
    return wrong_scalars(bare, limits)


def wrong_lengths(arguments: tuple[Any, ...], limits: dict[str, Any], value: Any) -> list[Any]:
    items = [msgspec.to_builtins(item, builtin_types=(bytes,)) for item in value]
    if Ellipsis not in arguments:
        return [items[:-1], [*items, items[0]], []]
    short: list[list[Any]] = [[]] if limits.get("min_length") else []
    long = [items[:1] * (limits["max_length"] + 1)] if "max_length" in limits and items else []
    return [*short, *long]


def wrong_scalars(bare: Any, limits: dict[str, Any]) -> list[Any]:
    if bare is float:
        low: Any = limits.get("ge", limits.get("gt"))
        high: Any = limits.get("le", limits.get("lt"))
        outside = [math.nextafter(low, -math.inf), math.nextafter(high, math.inf), high + 1, low - 1, 2**64 - 1]
        outside += [low] if "gt" in limits else []
        outside += [high] if "lt" in limits else []
        return [math.nan, math.inf, -math.inf, None, True, "1.0", b"1.0", [], {}, *outside]
    if bare is int:
        outside = [limits["ge"] - 1] if "ge" in limits else []
        outside += [limits["le"] + 1] if "le" in limits else []
        return [None, True, 1.0, 1.5, math.nan, "1", b"1", [], {}, *outside]
    if bare is bool:
        return [None, 1, 0, "true", b"", 1.0]
    too_long = ["x" * (limits["max_length"] + 1)] if "max_length" in limits else []
    outside = ["", "A", "a\n", "a" * 200, "a/b", "*"] if "pattern" in limits else []
    return [None, 1, 1.0, True, b"text", [], {}, *too_long, *outside]


def replaced(fields: Any, path: tuple[Any, ...], value: object) -> Any:
    """Return a payload with one part of it replaced."""
    if not path:
        return value
    changed = copy.deepcopy(fields)
    node = changed
    for part in path[:-1]:
        node = node[part]
    node[path[-1]] = value
    return changed


def plain(value: Any) -> Any:
    """Return a message as maps and lists that can be changed."""
    built = msgspec.to_builtins(value, builtin_types=(bytes,))
    return thawed(built)


def thawed(node: Any) -> Any:
    if isinstance(node, dict):
        return {key: thawed(item) for key, item in node.items()}
    return [thawed(item) for item in node] if isinstance(node, list | tuple) else node


def broken(kind: type[msgspec.Struct]) -> list[Broken]:
    """Return payloads of a type with one part replaced by what does not fit there."""
    value = sample(kind)
    fields = plain(value)
    found: list[Broken] = []
    for path, hint in spots(kind, value):
        node = value
        for part in path:
            node = getattr(node, part) if isinstance(part, str) and is_struct(type(node)) else node[part]
        found += [(f"{path} = {wrong!r:.60}", replaced(fields, path, wrong)) for wrong in wrong_values(hint, node)]
        if is_struct(type(node)):
            found.append((f"{path}: unknown field", replaced(fields, (*path, "unknown"), 1)))
    return found


@pytest.fixture(scope="session")
def strategy_of() -> Callable[[Any], st.SearchStrategy[Any]]:
    return strategy


@pytest.fixture(scope="session")
def sample_of() -> Callable[[Any], Any]:
    return sample


@pytest.fixture(scope="session")
def plain_of() -> Callable[[Any], Any]:
    return plain


@pytest.fixture(scope="session")
def broken_payloads() -> Callable[[type[msgspec.Struct]], list[Broken]]:
    return broken
