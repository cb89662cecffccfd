"""Where a run's journal comes from: a store's file, a living cell, or the run itself, made again.

A run in one process leaves no journal. Its folder says what it was, and the same definition and seed take the same
steps, so it is run again; what comes of it must have the digest that the folder says.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from msgspec.structs import replace

from experiments.journal import options
from experiments.journal.store_file import FILE
from experiments.lab import result_files
from services.cell.stored import LISTED, Stored, StoredRun, chosen, run_named, runs
from services.rules.results import Summary, episodes_digest
from services.wire.definition import Definition
from services.wire.definition_file import load, run_id_of, seed_of
from services.wire.errors import CellError, DivergedError
from services.wire.messages import EpisodeSummary, JournalEpisode


class Source(NamedTuple):
    """A run whose journal is to be had."""

    name: str
    definition: Definition
    seed: int
    length: int
    """Episodes that there are."""
    episodes: Iterator[JournalEpisode]


@contextmanager
def source(arguments: argparse.Namespace) -> Iterator[Source]:
    """Give the run that is asked for: ``run`` is a folder, a store's file, or the name of a run in the living cell.

    Raises CellError, and DivergedError when a run that is made again is another one.
    """
    path = None if arguments.run is None else Path(arguments.run)
    in_file = path is not None and path.exists() and (not path.is_dir() or (path / FILE).is_file())
    if arguments.named is not None and not in_file:
        raise CellError(f"--named: expected with a store's file or the folder of one, got {arguments.run}")
    if path is not None and path.is_dir() and not in_file:
        yield made_again(path, arguments.seed)
        return
    a_file = path is not None and path.exists()
    if not a_file and arguments.run is not None and "/" in arguments.run:
        raise CellError(f"{arguments.run}: expected the folder of a run, a store's file or the name of a run, got none")
    with options.places(arguments, path if a_file else None) as places:
        run = _in_file(places, arguments.seed, arguments.named) if a_file else run_named(places[0], arguments.run)
        asked, there = arguments.seed, run.record().seed
        if asked is not None and asked != there:
            raise CellError(f"--seed: expected {there}, which {run.name} has, got {asked}")
        yield of_store(run)


def _in_file(places: Sequence[Stored], seed: int | None, name: str | None) -> StoredRun:
    """Return a file's only run, its only one of that seed, or that of that name. Raises CellError, with what is there.

    Two runs have a seed in common where one of them began with a skill, as after ``treenail checkpoint import``.
    """
    known = [run for stored in places for run in runs(stored)]
    if name is not None or len(known) < 2:
        return chosen(places, name)
    of_seed = [run for run in known if seed is not None and seed_of(run.name) == seed]
    if len(of_seed) == 1:
        return of_seed[0]
    if seed is not None and not of_seed:
        raise CellError(f"--seed: expected that of one of {_names(known)}, got {seed}")
    raise CellError(f"--named: expected to be told which one of {_names(of_seed or known)}")


def _names(known: Sequence[StoredRun]) -> str:
    return ", ".join(sorted(run.name for run in known)[:LISTED])


def of_store(run: StoredRun) -> Source:
    """Return a run in a store, with the episodes that it has now."""
    record, length = run.record(), run.length()
    return Source(run.name, record.definition, record.seed, length, run.episodes(length))


def made_again(folder: Path, seed: int | None) -> Source:
    """Return a run of ``treenail experiment run`` by its folder. Raises CellError for a folder that is none."""
    try:
        told: Summary = json.loads((folder / result_files.SUMMARY).read_bytes())
        runs = {run["seed"]: run for run in told["runs"]}
    except (OSError, ValueError, KeyError, TypeError) as error:
        wanted = f"a run: {FILE}, or {result_files.SUMMARY} with {result_files.DEFINITION}"
        raise CellError(f"{folder}: expected {wanted}, got neither ({type(error).__name__})") from None
    if "swaps" in told:
        raise CellError(f"{folder}: expected a run without swaps or one with its store, got {'; '.join(told['swaps'])}")
    if seed is None and len(runs) > 1:
        raise CellError(f"--seed: expected one of {', '.join(map(str, sorted(runs)))} in {folder}, got none")
    chosen_seed = next(iter(runs)) if seed is None else seed
    if chosen_seed not in runs:
        raise CellError(f"--seed: expected one of {', '.join(map(str, sorted(runs)))} in {folder}, got {seed}")
    definition = load(str(folder / result_files.DEFINITION))
    run = runs[chosen_seed]
    name = f"{definition.name}-s{chosen_seed}"
    # The file has the length that was run, so that its hash is another one than that in the run's own name.
    called = run_id_of(told["definition_sha256"], chosen_seed)
    episodes = _again(definition, chosen_seed, called, run["episodes"], run["digests"]["episodes"], folder)
    return Source(name, definition, chosen_seed, run["episodes"], episodes)


def _again(
    definition: Definition, seed: int, called: str, count: int, digest: str, folder: Path
) -> Iterator[JournalEpisode]:
    # Physics and compiled kernels are loaded where they are used: what reads a store needs neither.
    from experiments.lab.in_process import InProcessRun

    run = InProcessRun(definition, seed, remember=True)
    summaries: list[EpisodeSummary] = []
    for summary in run.episodes(count):
        summaries.append(replace(summary, run=called))
        yield run.task.record()
    got = episodes_digest(summaries)
    if got != digest:
        raise DivergedError(
            f"{folder}: expected episodes of digest {digest[:12]} when run again, got {got[:12]}:"
            " the run began with a skill, or was made by another version; export it from a cell's store"
        )
