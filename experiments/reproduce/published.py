"""The report's sections as pages of Markdown, one each, for docs/experiments: tables, verdicts, and small drawings."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence

from experiments.reproduce.chapter import Block, Comparison, Comparisons, Figure, Heading, Table, Text
from experiments.reproduce.figures import INK
from experiments.reproduce.page import Done, counts

LARGEST_BYTES = 50_000
"""A drawing above this stays in the report: a repository is no place for it."""
_NOT_SAID = ("--pages", "--out", "--jobs")
"""Options, each with a value, that change no number."""


def pages(facts: Mapping[str, str], done: Sequence[Done], words: Sequence[str]) -> dict[str, str]:
    """Return files by their path: each section's page and its drawings. ``words`` are those of the command."""
    files: dict[str, str] = {}
    for section in done:
        files |= _page(facts, section, words)
    return files


def _page(facts: Mapping[str, str], done: Done, words: Sequence[str]) -> dict[str, str]:
    name, files = done.section.name, dict[str, str]()
    said = [f"# {done.section.title}", f"Made by `{command(name, words)}`."]
    said.append("\n".join(f"- {label}: {text}" for label, text in facts.items() if label not in ("sections", "took")))
    if done.chapter is None:
        return {f"{name}.md": "\n\n".join([*said, f"Could not run: {done.reason}"]) + "\n"}
    rows = done.chapter.comparisons
    if rows:
        verdicts = ", ".join(f"{number} {verdict}" for verdict, number in counts(rows).items() if number)
        said.append(f"Compared with the thesis: {verdicts}.")
    left_out = 0
    for block in done.chapter.blocks:
        if isinstance(block, Figure):
            drawn, path = standalone(block.svg), f"images/{name}-{len(files) + 1}.svg"
            if len(drawn) > LARGEST_BYTES:
                left_out += 1
                continue
            files[path] = drawn
            said.append(f"![{_plain(block.caption)}]({path})\n\n{_numbered('Fig.', block)}")
        else:
            said.append(_block(block))
    if left_out:
        said.append(f"Of the drawings {left_out} stand in the report alone, which the command above makes.")
    return {f"{name}.md": "\n\n".join(said) + "\n", **files}


def command(name: str, words: Sequence[str]) -> str:
    """Return the command that makes a section's page anew, without what changes no number."""
    kept, only = list[str](), False
    rest = iter(words)
    for word in rest:
        if word.partition("=")[0] in _NOT_SAID:
            if "=" not in word:
                next(rest, None)
            continue
        if word.startswith("-"):
            only = word == "--only"
        if not only and word != "--kept":
            kept.append(word)
    return shlex.join(["treenail", "reproduce", "--only", name, *kept])


def standalone(svg: str) -> str:
    """Return a drawing as a file of its own, in a grey that is legible on light and dark."""
    return svg.replace("<svg", '<svg xmlns="http://www.w3.org/2000/svg"', 1).replace("currentColor", INK) + "\n"


def _block(block: Block) -> str:
    match block:
        case Text():
            return block.text
        case Heading():
            return f"## {block.text}"
        case Table():
            return f"{_numbered('Table', block)}\n\n{table(block.head, block.rows)}"
        case Comparisons():
            head = ("", "thesis", "Treenail", "verdict", "")
            return f"{block.caption}:\n\n{table(head, [_row(row) for row in block.rows])}"
        case Figure():
            raise AssertionError("a figure is a file")


def _row(row: Comparison) -> tuple[str, ...]:
    return (row.what, row.thesis, row.ours_shown, str(row.outcome), " ".join(row.remarks))


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(_plain(cell).replace("|", "\\|") for cell in line) + " |" for line in lines)


def _numbered(kind: str, block: Table | Figure) -> str:
    return f"{kind} {block.number}. {block.caption}" if block.number else block.caption


def _plain(text: str) -> str:
    return " ".join(text.split()).replace("[", "(").replace("]", ")") if "](" in text else " ".join(text.split())
