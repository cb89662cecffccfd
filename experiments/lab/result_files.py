"""The folder of an experiment's results: ``definition.toml``, ``episodes.csv``, figures and ``summary.json``.

``summary.json`` is written last and in one stroke: where it is, everything else is there and belongs to it.
"""

from __future__ import annotations

import csv
import itertools
import json
import os
import re
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec

from services.rules.results import RunResult, Summary
from services.wire.definition import Definition
from services.wire.definition_file import run_id_of
from services.wire.errors import TreenailError
from services.wire.messages import EpisodeSummary
from services.wire.randomness import MAX_SEED
from services.wire.text import decode, whole

SUMMARY = "summary.json"
EPISODES = "episodes.csv"
DEFINITION = "definition.toml"
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
    found = _hash_in(before)
    if found != definition_sha256:
        raise ResultsError(
            f"{path}: expected results of definition {definition_sha256[:8]}, got {found[:8] or 'no hash'};"
            " choose another --out, or --force to replace them"
        )


def write(
    folder: Path, definition: Definition, summary: Summary, runs: Sequence[RunResult], figures: Mapping[str, bytes]
) -> None:
    """Write definition, episodes, figures (by file name) and summary over what is there. Raises ResultsError.

    An old ``summary.json`` goes first, so that it never stands beside episodes that are not its own.
    """
    try:
        (folder / SUMMARY).unlink(missing_ok=True)
        episodes = episodes_csv(summary["experiment"], summary["definition_sha256"], runs)
        text = json.dumps(summary, indent=2, allow_nan=False)
        text = _NUMBERS.sub(lambda match: "[" + " ".join(match[1].split()) + "]", text) + "\n"
        _replace(folder / DEFINITION, definition_toml(definition).encode())
        _replace(folder / EPISODES, episodes.encode())
        _replace_all(folder, figures)
        _replace(folder / SUMMARY, text.encode())
    except OSError as error:
        raise ResultsError(f"{folder}: results cannot be written: {error.strerror}") from error


def write_figures(folder: Path, figures: Mapping[str, bytes]) -> None:
    """Write figures, by file name, over what is there. Raises ResultsError when that fails."""
    try:
        _replace_all(folder, figures)
    except OSError as error:
        raise ResultsError(f"{folder}: figures cannot be written: {error.strerror}") from error


def episodes_csv(experiment: str, definition_sha256: str, runs: Sequence[RunResult]) -> str:
    """Return the text of ``episodes.csv``: one row per seed and episode, numbers in full precision."""
    lines = [
        f"# experiment: {experiment}",
        f"# definition_sha256: {definition_sha256}",
        "# force in N, torque in N m: mean and peak of the magnitudes after each motion of an episode",
        ",".join(("seed", *COLUMNS)),
    ]
    for run in runs:
        for summary in run.episodes:
            lines.append(",".join((str(run.seed), *(str(getattr(summary, field)) for field in COLUMNS.values()))))
    return "\n".join(lines) + "\n"


def read_episodes(path: Path) -> EpisodeTable:
    """Read an ``episodes.csv``. Raises ResultsError with file and line for anything that does not fit."""
    try:
        lines = decode(path.read_bytes()).splitlines()
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ResultsError(f"{path}: cannot be read: {reason}") from error
    head = list(itertools.takewhile(lambda line: line.startswith("#"), lines))
    told = dict(line.removeprefix("# ").split(": ", 1) for line in head if ": " in line)
    for key in ("experiment", "definition_sha256"):
        if key not in told:
            raise ResultsError(f"{path}: expected a comment '# {key}: ...' at the top, got none")
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
    if len({len(of_seed) for of_seed in episodes.values()}) != 1:
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
    try:
        content = json.loads(summary)
    except ValueError:
        return ""
    found = content.get("definition_sha256") if isinstance(content, dict) else None
    return found if isinstance(found, str) else ""


def _toml_value(value: object) -> str:
    if isinstance(value, str):
        # TOML's basic strings are JSON's, save that DEL has to be escaped as well.
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, dict):  # the settings of a plug-in
        return "{ " + ", ".join(f"{json.dumps(key)} = {_toml_value(one)}" for key, one in value.items()) + " }"
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
