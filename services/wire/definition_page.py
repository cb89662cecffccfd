"""Every key of a definition with unit, range, default and meaning: docs/definition.md, and a file to begin with.

``python -m services.wire.definition_page`` prints the page. The meanings are what stands under the fields in
``definition*.py``, read from their source, so that they are there without docstrings too.
"""

from __future__ import annotations

import ast
import itertools
import json
from collections.abc import Iterator
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple, get_args, get_origin

import msgspec
from msgspec import NODEFAULT, Struct

from services.wire.contract import describe, hints_of
from services.wire.definition import Definition

_UNITS = (
    ("_n_per_mm", "N/mm"),
    ("_nm_per_rad", "N m/rad"),
    ("_per_m", "1/m"),
    ("_dnm", "0.1 N m"),
    ("_nm", "N m"),
    ("_mm", "mm"),
    ("_deg", "deg"),
    ("_n", "N"),
)
_FOR_NAMES = "abcdefghijklmnopqrstuvwxyz0123456789-"


class Key(NamedTuple):
    """One key of a definition."""

    name: str
    unit: str
    kind: str
    bounds: str
    default: object
    """NODEFAULT for one that has to be given."""
    meaning: str


def page() -> str:
    """Return docs/definition.md."""
    return "\n".join(_lines()) + "\n"


def template(name: str) -> str:
    """Return a TOML file with all keys and their defaults, each with what it means, for an experiment of a name."""
    allowed = "".join(letter if letter in _FOR_NAMES else "-" for letter in name.lower()).strip("-")[:64]
    lines = ["# An experiment for Treenail. Every key may be left out but the name; docs/definition.md says more.", ""]
    lines += _toml(Definition, {"name": allowed or "experiment"})
    for table, kinds in tables():
        first, *others = kinds
        lines += ["", f"[{table}]  # {_doc(first).splitlines()[0]}"]
        if first.__struct_config__.tag is not None:
            choices = ", ".join(str(kind.__struct_config__.tag) for kind in kinds)
            lines.append(f"kind = {json.dumps(first.__struct_config__.tag)}  # one of {choices}" if others else "")
        lines += _toml(first, {})
    return "\n".join(lines) + "\n"


def _lines() -> Iterator[str]:
    yield "# The definition of an experiment"
    yield ""
    yield "Generated from `services/wire/definition*.py` by `make docs`; a test holds it to that."
    yield "`treenail experiment new my.toml` writes a file with all of it to begin with; `--set start.x_mm=2.0`"
    yield "changes one key of any definition."
    yield "Units stand in the names. What contradicts something else in the file is refused, too, with the reason."
    yield ""
    yield from _table(Definition)
    for table, kinds in tables():
        for kind in kinds:
            tag = kind.__struct_config__.tag
            yield ""
            yield f"## {table}" + (f", kind = {json.dumps(tag)}" if tag is not None else "")
            yield ""
            yield _doc(kind)
            yield ""
            yield from _table(kind)
            for name, item in _lists(kind):
                yield from ("", f"## [[{table}.{name}]]", "", _doc(item), "", *_table(item))
    for name, item in _lists(Definition):
        yield from ("", f"## [[{name}]]", "", _doc(item), "", *_table(item))


def _table(kind: type[Struct]) -> Iterator[str]:
    yield "| key | unit | type | range | default | meaning |"
    yield "|---|---|---|---|---|---|"
    for key in keys(kind):
        default = "to be given" if key.default is NODEFAULT else f"`{_value(key.default)}`"
        yield f"| `{key.name}` | {key.unit} | {key.kind} | {key.bounds} | {default} | {key.meaning} |"


def keys(kind: type[Struct]) -> list[Key]:
    """Return the keys of one table, without the tables in it."""
    hints, meanings = hints_of(kind), _meanings(kind)
    defaults = {field.name: field.default for field in msgspec.structs.fields(kind)}
    defaults |= {field.name: field.default_factory() for field in msgspec.structs.fields(kind) if _has_factory(field)}
    return [
        Key(name, _unit(name), *describe(hints[name]), defaults[name], meanings.get(name, ""))
        for name in kind.__struct_fields__
        if not _structs(hints[name])
    ]


def _lists(kind: type[Struct]) -> Iterator[tuple[str, type[Struct]]]:
    """Give the keys of a table that are lists of tables, with what stands in these."""
    for name, hint in hints_of(kind).items():
        if list_type := next((part for part in get_args(hint) if get_origin(part) is tuple), None):
            yield from ((name, item) for item in _structs(list_type))


def _has_factory(field: msgspec.structs.FieldInfo) -> bool:
    return field.default_factory is not NODEFAULT


def _toml(kind: type[Struct], given: dict[str, str]) -> Iterator[str]:
    for key in keys(kind):
        about = ", ".join(part for part in (key.bounds, key.unit) if part)
        comment = " ".join(part for part in (f"[{about}]" if about else "", key.meaning) if part)
        default = given.get(key.name, key.default)
        yield f"{key.name} = {_value(default)}" + (f"  # {comment}" if comment else "")


def tables() -> list[tuple[str, list[type[Struct]]]]:
    """Return the tables of a definition by their dotted names, each with the kinds that it may be of, the usual first.

    A table that is within another follows it.
    """
    return list(_tables(Definition, ""))


def _tables(owner: type[Struct], prefix: str) -> Iterator[tuple[str, list[type[Struct]]]]:
    usual = {field.name: type(field.default) for field in msgspec.structs.fields(owner)}
    for name, hint in hints_of(owner).items():
        kinds = sorted(_structs(hint), key=lambda kind: kind is not usual[name])
        if kinds:
            yield f"{prefix}{name}", kinds
        for kind in kinds:
            yield from _tables(kind, f"{prefix}{name}.")


def _structs(hint: object) -> list[type[Struct]]:
    options: tuple[Any, ...] = get_args(hint) or (hint,)
    return [option for option in options if isinstance(option, type) and issubclass(option, Struct)]


def _value(value: object) -> str:
    return "{}" if value == {} else json.dumps(value)


def _unit(name: str) -> str:
    return next((unit for ending, unit in _UNITS if name.endswith(ending)), "")


@cache
def _classes() -> dict[str, ast.ClassDef]:
    kinds = {kind for _, kinds in tables() for kind in kinds} | {Definition}
    modules = {kind.__module__.rpartition(".")[2] for kind in kinds}
    sources = [(files("services.wire") / f"{name}.py").read_text(encoding="utf-8") for name in modules]
    return {node.name: node for source in sources for node in ast.parse(source).body if isinstance(node, ast.ClassDef)}


def _doc(kind: type[Struct]) -> str:
    return ast.get_docstring(_classes()[kind.__name__]) or ""


def _meanings(kind: type[Struct]) -> dict[str, str]:
    """Return what stands under each field of a class and of those that it is made from."""
    bodies = [_classes()[base.__name__].body for base in kind.__mro__ if base.__name__ in _classes()]
    meanings = {}
    for field, after in itertools.chain.from_iterable(map(itertools.pairwise, bodies)):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(after, ast.Expr):
            text = ast.literal_eval(after.value)
            meanings[field.target.id] = " ".join(text.split())
    return meanings


if __name__ == "__main__":
    print(page(), end="")
