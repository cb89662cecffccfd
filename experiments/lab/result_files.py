"""The folder of an experiment's results: ``definition.toml``, ``episodes.csv``, figures, skills, ``summary.json``.

``summary.json`` is written last and in one stroke: where it is, everything else is there and belongs to it.
"""

from __future__ import annotations

import csv
import itertools
import json
import os
import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
from msgspec.structs import replace

from services.rules.results import RunResult, Summary
from services.rules.skill import NamedSkill, file_bytes
from services.wire.definition import Definition
from services.wire.definition_file import run_id_of
from services.wire.errors import TreenailError
from services.wire.messages import EpisodeSummary
from services.wire.randomness import MAX_SEED
from services.wire.text import decode, whole

SUMMARY = "summary.json"
EPISODES = "episodes.csv"
DEFINITION = "definition.toml"
SKILL = "seed{}.skill"
COLUMNS = {
    "episode": "episode",
    "outcome": "outcome",
    "return": "episode_return",
    "moves": "moves",
    "decisions": "decisions",
    "mean_force_n": "mean_force_n",
    "peak_force_n": "peak_force_n",
    "mean_torque_nm": "mean_torque_nm",
    "peak_torque_nm": "peak_torque_nm",
    "states": "states",
}
"""Columns of ``episodes.csv`` after ``seed``, and the fields of EpisodeSummary that they hold."""

_NUMBERS = re.compile(r"\[([\s\d,]+)\]")


class ResultsError(TreenailError):
    """A folder of results that cannot be used."""


@dataclass(frozen=True)
class EpisodeTable:
    """What ``episodes.csv`` holds: all episodes of each seed, every seed as long as the others."""

    experiment: str
    definition_sha256: str
    episodes: Mapping[int, tuple[EpisodeSummary, ...]]


def definition_toml(definition: Definition) -> str:
    """Return a definition with all its defaults as a TOML file that loads to an equal definition."""
    fields: dict[str, object] = msgspec.to_builtins(definition)
    lines = [f"{key} = {_toml_value(value)}" for key, value in fields.items() if not isinstance(value, dict)]
    for table, values in fields.items():
        if isinstance(values, dict):
            lines += ["", f"[{table}]", *(f"{key} = {_toml_value(value)}" for key, value in values.items())]
    return "\n".join(lines) + "\n"


def prepare(folder: Path, definition_sha256: str, force: bool = False) -> None:
    """Make the folder ready for results of a definition, before anything runs.

    Raises ResultsError when it cannot be made or written to, or when it holds results of another definition and
    ``force`` is not set.
    """
    path = folder / SUMMARY
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
        before = path.read_bytes() if path.exists() else None
    except OSError as error:
        raise ResultsError(f"{folder}: cannot hold results: {error.strerror}") from error
    if before is None or force:
        return
    hash_before = _hash_in(before)
    if hash_before != definition_sha256:
        raise ResultsError(
            f"{path}: expected results of definition {definition_sha256[:8]}, got {hash_before[:8] or 'no hash'};"
            " choose another --out, or --force to replace them"
        )


def write(
    folder: Path,
    definition: Definition,
    summary: Summary,
    runs: Sequence[RunResult],
    figures: Mapping[str, bytes],
    skills: Mapping[int, NamedSkill] | None = None,
) -> None:
    """Write definition, episodes, figures by file name, skills by seed, and summary over what is there.

    An old ``summary.json`` goes first, so that it never stands beside episodes that are not its own. The definition
    that is written is as long as the longest run. Raises ResultsError.
    """
    ran = replace(definition, episodes=max(len(run.episodes) for run in runs))
    try:
        (folder / SUMMARY).unlink(missing_ok=True)
        episodes = episodes_csv(runs)
        text = json.dumps(summary, indent=2, allow_nan=False)
        text = _NUMBERS.sub(lambda match: "[" + " ".join(match[1].split()) + "]", text) + "\n"
        _replace(folder / DEFINITION, definition_toml(ran).encode())
        _replace(folder / EPISODES, episodes.encode())
        _replace_all(folder, figures)
        for old in folder.glob(SKILL.format("*")):
            old.unlink()
        _replace_all(folder, {SKILL.format(seed): file_bytes(skill) for seed, skill in (skills or {}).items()})
        _replace(folder / SUMMARY, text.encode())
    except OSError as error:
        raise ResultsError(f"{folder}: results cannot be written: {error.strerror}") from error


def write_figures(folder: Path, figures: Mapping[str, bytes]) -> None:
    """Write figures, by file name, over what is there. Raises ResultsError when that fails."""
    try:
        _replace_all(folder, figures)
    except OSError as error:
        raise ResultsError(f"{folder}: figures cannot be written: {error.strerror}") from error


def rows_of(runs: Sequence[RunResult]) -> Iterator[dict[str, str | int | float]]:
    """Yield what ``episodes.csv`` holds: one row a seed and episode, by column.

    Forces [N] and torques [N m] are mean and peak of the magnitudes after each motion of an episode.
    """
    for run in runs:
        for summary in run.episodes:
            yield {"seed": run.seed, **{column: getattr(summary, field) for column, field in COLUMNS.items()}}


def episodes_csv(runs: Sequence[RunResult]) -> str:
    """Return the text of ``episodes.csv``: names of columns, then one row a seed and episode, in full precision."""
    rows = [",".join(map(str, row.values())) for row in rows_of(runs)]
    return "\n".join([",".join(("seed", *COLUMNS)), *rows]) + "\n"


def in_step(episodes: Mapping[int, tuple[EpisodeSummary, ...]]) -> dict[int, tuple[EpisodeSummary, ...]]:
    """Return as many episodes of every seed as the shortest has: all of them, unless the runs were interrupted."""
    shortest = min(map(len, episodes.values()))
    return {seed: of_seed[:shortest] for seed, of_seed in episodes.items()}


def read_episodes(path: Path) -> EpisodeTable:
    """Read an ``episodes.csv`` and what the ``summary.json`` beside it says of all its rows.

    Files of old have that in comments at their top. Raises ResultsError with file and line for what does not fit.
    """
    try:
        lines = decode(path.read_bytes()).splitlines()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ResultsError(f"{path}: cannot be read: {reason}") from error
    head = list(itertools.takewhile(lambda line: line.startswith("#"), lines))
    told = dict(line.removeprefix("# ").split(": ", 1) for line in head if ": " in line) or _summary_beside(path)
    for key in ("experiment", "definition_sha256"):
        if not isinstance(told.get(key), str):
            where = "a comment at the top" if head else f"{SUMMARY} beside it"
            raise ResultsError(f"{path}: expected {where} that says the {key}, got none")
    rows = csv.reader(lines[len(head) :])
    columns = next(rows, [])
    if columns != ["seed", *COLUMNS]:
        expected, got = ",".join(("seed", *COLUMNS)), ",".join(columns)
        raise ResultsError(f"{path}:{len(head) + 1}: expected columns {expected}, got {got or 'none'}")
    episodes: dict[int, list[EpisodeSummary]] = {}
    for row in rows:
        if not row:
            continue  # a blank line, as at the end of what an editor has saved
        try:
            seed, summary = _from_row(row, told["definition_sha256"])
        except ValueError as error:
            raise ResultsError(f"{path}:{len(head) + rows.line_num}: {error}") from error
        episodes.setdefault(seed, []).append(summary)
    if len({len(of_seed) for of_seed in episodes.values()}) != 1 and not (episodes and "interrupted" in told):
        counts = ", ".join(f"seed {seed} {len(of_seed)}" for seed, of_seed in episodes.items())
        raise ResultsError(f"{path}: expected equally many episodes of every seed, got {counts or 'none'}")
    by_seed = {seed: tuple(of_seed) for seed, of_seed in episodes.items()}
    return EpisodeTable(told["experiment"], told["definition_sha256"], by_seed)


def _from_row(row: Sequence[str], definition_sha256: str) -> tuple[int, EpisodeSummary]:
    """Return seed and summary of one row. Raises ValueError (of which msgspec's ValidationError is one)."""
    if len(row) != len(COLUMNS) + 1:
        raise ValueError(f"expected {len(COLUMNS) + 1} values, got {len(row)}")
    seed = whole(row[0], 0, MAX_SEED)
    fields = dict(zip(COLUMNS.values(), row[1:], strict=True))
    run = run_id_of(definition_sha256, seed)
    return seed, msgspec.convert({"run": run, **fields}, EpisodeSummary, strict=False)


def _hash_in(summary: bytes) -> str:
    """Return the definition's hash in a ``summary.json``; empty when there is none."""
    sha256 = _content(summary).get("definition_sha256")
    return sha256 if isinstance(sha256, str) else ""


def _summary_beside(episodes: Path) -> dict[str, Any]:
    """Return what the ``summary.json`` beside an ``episodes.csv`` says; nothing when there is none.

    Raises ResultsError when what is there says nothing.
    """
    path = episodes.with_name(SUMMARY)
    try:
        content = _content(path.read_bytes())
    except OSError:
        return {}
    if not content:
        raise ResultsError(f"{path}: expected a summary of results, got something else; is it damaged?")
    return content


def _content(summary: bytes) -> dict[str, Any]:
    try:
        content = json.loads(summary)
    except (ValueError, RecursionError):
        return {}
    return content if isinstance(content, dict) else {}


def _toml_value(value: object) -> str:
    if isinstance(value, str):
        # TOML's basic strings are JSON's, save that DEL has to be escaped as well.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, dict):  # the settings of a plug-in
        return "{ " + ", ".join(f"{json.dumps(key)} = {_toml_value(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list | tuple):  # a list of moves
        return "[" + ", ".join(map(_toml_value, value)) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if not isinstance(value, (int, float)):
        raise TypeError(f"definition: expected text or a number, got {value!r}")
    return repr(value)


def _replace_all(folder: Path, files: Mapping[str, bytes]) -> None:
    for name, content in files.items():
        _replace(folder / name, content)


def _replace(path: Path, content: bytes) -> None:
    """Write a file so that there is either the old one or the whole new one."""
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        beside.write_bytes(content)
        beside.replace(path)
    finally:
        beside.unlink(missing_ok=True)
