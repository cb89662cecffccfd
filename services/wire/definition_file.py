"""Experiment definitions as TOML files: finding, reading, overriding, checking, hashing.

Whatever does not fit is named with file, line, key, what was expected and what came, and raises DefinitionError.
"""

from __future__ import annotations

import difflib
import hashlib
import re
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from importlib.resources import files
from pathlib import Path
from typing import Any, get_args, get_type_hints

import msgspec

from services.wire.definition import Calibration, Continuous, Definition, Drift, Felt, Shaping, Tool
from services.wire.definition_rules import contradiction
from services.wire.errors import DefinitionError, TreenailError
from services.wire.message_base import LONGEST_RUN
from services.wire.randomness import MAX_SEED
from services.wire.text import decode, in_words, one_line

_TABLE = re.compile(r"^\s*\[\[?([A-Za-z0-9_.\s]+)\]")
_KEY = re.compile(r"^\s*([A-Za-z0-9_.]+)\s*=")
_AT = re.compile(r"^(?P<what>.*?)(?: - at `\$\.?(?P<path>[^`]*)`)?$", re.DOTALL)
_UNKNOWN = re.compile(r"Object contains unknown field `(.*)`", re.DOTALL)
_RUN = re.compile(r"[0-9a-f]{16}-s(?P<seed>[0-9]{1,19})(?:-k[0-9a-f]{16})?")
_MAX_FILE_BYTES = 65_536
_LATER: Mapping[str, object] = {
    "limits.truncation": "terminal",
    "changes": (),
    "hole": {"rx_deg": 0.0, "ry_deg": 0.0, "tilt_spread_deg": 0.0},
    "moves.rotation_centre_mm": 0.0,
    "sensor.window": 1,
    "sensor.rate_hz": 0,
    "sensor.filter_hz": 0.0,
    "sensor.tare_samples": 0,
    "sensor.tare_step_n": 1.0,
    "sensor.tare_most_n": 5.0,
    "sensor.contact_sigmas": 0.0,
    "tool": msgspec.to_builtins(Tool()),
    "drift": msgspec.to_builtins(Drift()),
    "calibration": msgspec.to_builtins(Calibration()),
    "parts.peg_breadth_mm": 0.0,
    "start.x_spread_mm": 0.0,
    "start.y_spread_mm": 0.0,
    "start.rx_spread_deg": 0.0,
    "start.ry_spread_deg": 0.0,
    "start.rz_spread_deg": 0.0,
    "start.decimals": 0,
    "wrist.sensor_mount": "given",
    "wrist.sensor_rx_deg": 0.0,
    "wrist.sensor_ry_deg": 0.0,
    "wrist.sensor_rz_deg": 0.0,
    "moves.list": (),
    "moves.continuous": msgspec.to_builtins(Continuous()),
    "learner.trace": 0.0,
    "learner.follow_fade": 0.0,
    "learner.follow_least": 0.0,
    "learner.revisit": 0.0,
    "learner.force_stays": False,
    "learner.caution": 0.0,
    "learner.search_moves": 0,
    "learner.search_cone": 0.35,
    "learner.search_press_n": 1.0,
    "learner.search_turn": 1.0,
    "reward.force_per_n": 0.0,
    "policy.repeat": 0.0,
    "policy.repeat_fade": 0.02,
    "felt": msgspec.to_builtins(Felt()),
    "shaping": msgspec.to_builtins(Shaping()),
    "reward.success": 0.0,
    "reward.back": -3.0,
}
"""Keys and tables that came later, as they are in plain types where all is as it was before there were such keys."""
_USUAL_KINDS = {"classifier": "art2", "learner": "q_learning"}
"""What these tables are when they do not say so."""
_MAX_LINE = 1000
"""Characters of a line. Python's TOML reader takes time with the square of a dotted key's parts."""


def shipped() -> dict[str, Path]:
    """Return the definitions that come with Treenail, by name."""
    folder = Path(str(files("services.wire"))) / "definitions"
    return {path.stem: path for path in sorted(folder.glob("*.toml"))}


def find(name_or_path: str) -> Path:
    """Return the file of a shipped definition's name, or of a user's own file."""
    file_of = shipped()
    if name_or_path in file_of:
        return file_of[name_or_path]
    path = Path(name_or_path)
    with suppress(OSError):  # a name that is too long for a file
        if path.is_file():
            return path
    close = difflib.get_close_matches(name_or_path, file_of, n=1)
    hint = f"did you mean {close[0]!r}?" if close else "`treenail experiment list` shows the names"
    got = f"{one_line(name_or_path)!r}, which is neither; {hint}"
    raise DefinitionError(f"experiment: expected a shipped experiment's name or a TOML file, got {got}")


def load(name_or_path: str, overrides: Iterable[str] = ()) -> Definition:
    """Return the checked definition of a name or file, with overrides such as ``start.x_mm=2.0`` applied."""
    path = find(name_or_path)
    try:
        size = path.stat().st_size
        if size > _MAX_FILE_BYTES:
            raise DefinitionError(f"{path}: expected at most {_MAX_FILE_BYTES} bytes, got {size}")
        return parse(path.read_bytes(), str(path), overrides)
    except OSError as error:
        raise DefinitionError(f"{path}: cannot be read: {error.strerror}") from error


def parse(raw: bytes, source: str, overrides: Iterable[str] = ()) -> Definition:
    """Return the checked definition in the bytes of a TOML file; ``source`` names it in errors."""
    try:
        text = decode(raw)
    except ValueError as error:
        raise DefinitionError(f"{source}: {error}") from error
    fields = _toml(text, source)
    places = {key: f"{source}:{line}" for key, line in _lines(text).items()}
    for override in overrides:
        key = _apply(fields, override)
        for end in _ends(key):
            if key[:end] not in places or end == len(key):
                places[key[:end]] = _option(override)
    return check(fields, places, source)


def with_overrides(fields: dict[str, object], overrides: Iterable[str], source: str) -> Definition:
    """Return the checked definition in ``fields`` after overrides such as ``learner.alpha=0.1``; they are changed.

    ``source`` names it in errors. Raises DefinitionError.
    """
    places = {_apply(fields, override): _option(override) for override in overrides}
    return check(fields, places, source)


def check(fields: Mapping[str, object], places: Mapping[str, str], source: str) -> Definition:
    """Return the definition in ``fields``; ``places`` says where each dotted key stands, for the error."""
    try:
        definition = msgspec.convert(_with_kinds(fields), Definition)
    except msgspec.ValidationError as error:
        raise DefinitionError(one_line(_explain(in_words(str(error)), fields, places, source), 1000)) from None
    if conflict := contradiction(definition):
        key, complaint = conflict
        raise DefinitionError(f"{_place(key, places, source)}: {key}: {complaint}")
    return definition


def _with_kinds(fields: Mapping[str, object]) -> dict[str, object]:
    """Return fields with the kinds that need not be named."""
    tables = dict(fields)
    for table, kind in _USUAL_KINDS.items():
        values = tables.get(table)
        if isinstance(values, dict):
            tables[table] = {"kind": kind, **values}
    return tables


def definition_sha256(definition: Definition) -> str:
    """Return the hash of a definition with all its defaults filled in; equal settings give equal hashes.

    A key that came later is left out where it says what was done before there was one, so that runs keep their names.
    """
    fields = without_later(msgspec.to_builtins(definition))
    return hashlib.sha256(msgspec.json.encode(fields, order="sorted")).hexdigest()


def without_later(fields: dict[str, Any]) -> dict[str, Any]:
    """Leave out of a definition's tables, in plain types, the keys that came later and say what was done before."""
    for path, before in _LATER.items():
        _drop(fields, path.split("."), before)
    return fields


def _drop(fields: dict[str, object], path: Sequence[str], before: object) -> None:
    """Leave a key out where it has the value ``before``; a table that has no such key stays as it is."""
    *tables, last = path
    node: object = fields
    for table in tables:
        node = node.get(table) if isinstance(node, dict) else None
    if isinstance(node, dict) and last in node and node[last] == before:
        del node[last]


def check_run(seed: int, episodes: int) -> None:
    """Raise TreenailError for a seed or a length that no run can have."""
    if not 0 <= seed <= MAX_SEED:
        raise TreenailError(f"--seed: expected 0 to {MAX_SEED}, got {seed}")
    if not 1 <= episodes <= LONGEST_RUN:
        raise TreenailError(f"--episodes: expected 1 to {LONGEST_RUN}, got {episodes}")


def run_id(definition: Definition, seed: int, skill_sha256: str | None = None) -> str:
    """Return the name of the run that a definition, a seed and the skill it begins with determine.

    Starting it again goes on with it.
    """
    return run_id_of(definition_sha256(definition), seed, skill_sha256)


def run_id_of(sha256: str, seed: int, skill_sha256: str | None = None) -> str:
    """Return the name of the run of a definition known by its hash."""
    return f"{sha256[:16]}-s{seed}" + ("" if skill_sha256 is None else f"-k{skill_sha256[:16]}")


def seed_of(run: str) -> int | None:
    """Return the seed of the run of that name; None of a name that ``run_id`` does not give."""
    named = _RUN.fullmatch(run)
    return None if named is None else int(named["seed"])


def _toml(text: str, source: str) -> dict[str, object]:
    """Return what a TOML text says. Raises DefinitionError."""
    longest = max(map(len, text.split("\n")))
    if longest > _MAX_LINE:
        raise DefinitionError(f"{source}: expected lines of at most {_MAX_LINE} characters, got one of {longest}")
    try:
        return tomllib.loads(text)
    except ValueError as error:  # a number with too many digits is no TOMLDecodeError
        raise DefinitionError(f"{source}: not valid TOML: {one_line(str(error))}") from error
    except RecursionError as error:
        raise DefinitionError(f"{source}: not valid TOML: nested too deeply") from error


def _apply(fields: dict[str, object], override: str) -> str:
    """Set one dotted key to a TOML value (or a bare word) and return the key."""
    option = _option(override)
    key, equals, value = override.partition("=")
    key = key.strip()
    if len(override) > _MAX_LINE:
        raise DefinitionError(f"{option}: expected at most {_MAX_LINE} characters, got {len(override)}")
    if not equals or not re.fullmatch(r"[A-Za-z0-9_]+(\.[A-Za-z0-9_]+)*", key):
        raise DefinitionError(f"{option}: expected key=value, such as start.x_mm=2.0")
    try:
        values: dict[str, object] = tomllib.loads(f"value = {value}")
        if len(values) > 1:
            raise DefinitionError(f"{option}: expected one value, got several lines")
        parsed = values["value"]
    except (ValueError, RecursionError):
        parsed = value.strip()
    *tables, last = key.split(".")
    node = fields
    for table in tables:
        child = node.setdefault(table, {})
        if not isinstance(child, dict):
            raise DefinitionError(f"{option}: {table} is a value, not a table")
        node = child
    if last == "kind" and node.get("kind") != parsed:
        node.clear()  # the settings of another kind do not carry over
    node[last] = parsed
    return key


def _option(override: str) -> str:
    """Return what was said on the command line, for errors."""
    return f"--set {one_line(override)}"


def _ends(key: str) -> list[int]:
    """Return where each leading part of a dotted key ends: for a.b.c the lengths of a, a.b and a.b.c."""
    return [*(match.start() for match in re.finditer(r"\.", key)), len(key)]


def _lines(text: str) -> dict[str, int]:
    """Return the line, from 1, of each dotted key of a TOML text (tables and plain ``key =`` lines)."""
    lines: dict[str, int] = {}
    table = ""
    for number, line in enumerate(text.splitlines(), start=1):
        if match := _TABLE.match(line):
            table = match.group(1).strip()
            lines[table] = number
        elif match := _KEY.match(line):
            lines[f"{table}.{match.group(1)}" if table else match.group(1)] = number
    return lines


def _explain(error: str, fields: Mapping[str, object], places: Mapping[str, str], source: str) -> str:
    match = _AT.match(error)
    what, path = (match.group("what"), match.group("path") or "") if match else (error, "")
    if unknown := _UNKNOWN.search(what):
        key = f"{path}.{unknown.group(1)}".lstrip(".")
        keys = _keys_of(path)
        if unknown.group(1) in keys:
            return f"{_place(key, places, source)}: {key}: not a key of this kind of {path}"
        close = difflib.get_close_matches(unknown.group(1), keys, n=1)
        hint = f"; did you mean {close[0]!r}?" if close else f"; expected one of {', '.join(keys)}" if keys else ""
        return f"{_place(key, places, source)}: {key}: unknown key{hint}"
    got = _value(fields, path)
    if what.startswith("Invalid"):
        what = f"expected one of {', '.join(_choices(path))}"
    shown = "" if got is None or ", got" in what else f", got {got!r}"
    name = f"{path}: " if path else ""
    return f"{_place(path, places, source)}: {name}{what[0].lower()}{what[1:]}{shown}"


def _place(key: str, places: Mapping[str, str], source: str) -> str:
    key = re.sub(r"\[[0-9]+\]", "", key)
    while key:
        if key in places:
            return places[key]
        key = key.rpartition(".")[0]
    return source


def _value(fields: Mapping[str, object], path: str) -> object:
    node: object = fields
    for part in path.split(".") if path else ():
        node = node.get(part) if isinstance(node, Mapping) else None
    return node


def _choices(path: str) -> list[str]:
    """Return the values that an enumerated key may have: a Literal's, or the kinds of a table."""
    table, _, key = path.rpartition(".")
    owners = _structs(table)
    if key == "kind" and all(owner.__struct_config__.tag is not None for owner in owners):
        return [repr(owner.__struct_config__.tag) for owner in owners]
    hints = [get_type_hints(owner).get(key) for owner in owners]
    return [repr(value) for hint in hints for value in get_args(hint)]


def _keys_of(path: str) -> list[str]:
    """Return the keys that a table of the definition may have, over all its kinds."""
    return sorted({name for kind in _structs(path) for name in kind.__struct_fields__})


def _structs(path: str) -> list[type[msgspec.Struct]]:
    """Return the types that the table at a dotted path may have."""
    kinds: list[type[msgspec.Struct]] = [Definition]
    for part in path.split(".") if path else ():
        hint = {name: kind for owner in kinds for name, kind in get_type_hints(owner).items()}.get(
            part.partition("[")[0]
        )
        options = get_args(hint) or (hint,)
        kinds = [kind for kind in options if isinstance(kind, type) and issubclass(kind, msgspec.Struct)]
    return kinds
