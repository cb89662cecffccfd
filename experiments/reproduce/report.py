"""Makes the report: looks at what was asked for, runs the sections one after the other, writes the page."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from experiments.lab import progress
from experiments.lab.pool import usable_cores
from experiments.reproduce import page, published
from experiments.reproduce.cache import Cache
from experiments.reproduce.chapter import CannotRun, Section
from experiments.reproduce.code import code_sha256, origin
from experiments.reproduce.context import Context
from experiments.reproduce.page import Done
from experiments.reproduce.sections import SECTIONS
from services.wire.errors import TreenailError

TITLE = "Treenail: the thesis reproduced"
INDEX, CACHE = "index.html", "cache"


class ReportError(TreenailError):
    """The report cannot be made as asked."""


@dataclass(frozen=True)
class Wanted:
    """What was asked for."""

    quick: bool
    seeds: tuple[int, ...]
    only: Sequence[str] | None
    """Names of sections; None for all."""
    out: Path
    data: Path | None
    jobs: int | None
    """Processes at a time; None for one per core."""
    episodes: int | None = None
    """Length of the runs of the sections plan, limits and claims; None for theirs."""
    kept: bool = False
    """Whether these sections show what is kept and make no run."""
    pages: Path | None = None
    """Where each section is written as a page of Markdown, too."""
    words: Sequence[str] = ()
    """What was typed; the pages say it."""


def make(wanted: Wanted, sections: Sequence[Section] = SECTIONS) -> Path:
    """Run the sections, write the page into ``wanted.out`` and return its path.

    Raises ReportError when it cannot be made as asked and whatever TreenailError a section ends with; a section
    that lacks something (CannotRun) only says so on the page.
    """
    unknown = sorted(set(wanted.only or ()) - {section.name for section in sections})
    if unknown:
        names = ", ".join(section.name for section in sections)
        raise ReportError(f"--only: expected one or more of {names}, got {', '.join(unknown)}")
    if wanted.data is not None and not wanted.data.is_dir():
        raise ReportError(f"--data: expected a folder, got {wanted.data}")
    index = wanted.out / INDEX
    _prepare(index)
    began = time.monotonic()
    with progress.reporter() as reporter:
        cache = Cache(wanted.out / CACHE, reporter.say, code_sha256())
        jobs = wanted.jobs or usable_cores()
        context = Context(wanted.quick, wanted.seeds, wanted.data, cache, reporter, jobs, wanted.episodes, wanted.kept)
        done = [run(section, context) for section in sections if wanted.only is None or section.name in wanted.only]
    facts = _facts(wanted, time.monotonic() - began, cache.from_before)
    _write(index, page.render(TITLE, facts, done, wanted.quick))
    if wanted.pages is not None:
        for path, content in published.pages(facts, done, wanted.words).items():
            _write(wanted.pages / path, content)
    return index


def run(section: Section, context: Context) -> Done:
    """Run one section; what it lacks is no error."""
    began, before = time.monotonic(), context.cache.from_before
    context.reporter.say(section.title)
    try:
        chapter = section.run(context)
    except CannotRun as error:
        context.reporter.say(f"{section.name}: could not run: {error}")
        return Done(section, None, str(error))
    return Done(section, chapter, seconds=time.monotonic() - began, from_before=context.cache.from_before - before)


def _facts(wanted: Wanted, seconds: float, from_before: int) -> dict[str, str]:
    """Return what was run, by label."""
    some = {"runs": "only those kept so far; the command makes those that are missing"} if wanted.kept else {}
    return {
        **origin(),
        **some,
        "length": "quick" if wanted.quick else "full",
        "seeds": f"{len(wanted.seeds)}: {wanted.seeds[0]} to {wanted.seeds[-1]}",
        "sections": ", ".join(wanted.only) if wanted.only else "all",
        "took": progress.duration(seconds) + (f", with {from_before} pieces kept from before" if from_before else ""),
    }


def _prepare(index: Path) -> None:
    """Make the folder, see that it can be written to, and that no page of somebody else is in the way."""
    try:
        index.parent.mkdir(parents=True, exist_ok=True)
        _replace(index.with_name(f".probe.{os.getpid()}"), "").unlink()
        ours = not index.exists() or page.MARK in index.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise ReportError(f"--out: expected a folder to write to, got {index.parent}: {error.strerror}") from error
    if not ours:
        raise ReportError(f"--out: expected no other page than an earlier report, got {index}; it is left alone")


def _write(index: Path, content: str) -> None:
    try:
        index.parent.mkdir(parents=True, exist_ok=True)
        _replace(index, content)
    except OSError as error:
        raise ReportError(f"{index}: cannot be written: {error.strerror}") from error


def _replace(path: Path, content: str) -> Path:
    """Write a file whole or not at all and return its path. Raises OSError."""
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        part.write_text(content, encoding="utf-8")
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
    return path
