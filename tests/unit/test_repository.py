"""What every file of the repository must be: free of one machine's places, documented, of a readable size, pinned."""

from __future__ import annotations

import ast
import os
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NOT_OURS = {
    ".git",
    ".hypothesis",
    ".import_linter_cache",
    ".mypy_cache",
    ".pytest_cache",
    ".ruff_cache",
    ".venv",
    "__pycache__",
    "build",
    "dist",
    "report",
    "runs",
}
MAX_LINES = 400
MAX_BYTES = 2_000_000
# Written in pieces, so that this file does not find itself.
INDEX = re.compile(r"https?://[^\s\"'<>)]*(?:py" + r"pi|pythonhosted|/sim" + r"ple\b)[^\s\"'<>)]*", re.IGNORECASE)
INDEX_OPTION = re.compile(r"--(?:extra-)?index" + r"-url[ =]\S|--find" + r"-links[ =]\S|--trusted" + r"-host[ =]\S")
HOME = re.compile(
    r"(?<![\w.*}-])/(?:wor" + r"k|roo" + r"t|tmp/" + r"w|hom" + r"e/[a-z]\w*|User" + r"s/\w+)(?:/|\b(?![\w-]))"
)
PIN = re.compile(r"^([A-Za-z0-9][A-Za-z0-9._-]*)(?:\[[a-z,]+\])?==([^\s;\\]+)")


def texts() -> Iterator[tuple[str, str]]:
    """Yield path and content of every text file."""
    for folder, folders, names in os.walk(ROOT):
        folders[:] = sorted(name for name in folders if name not in NOT_OURS and not name.endswith(".egg-info"))
        for name in sorted(names):
            path = Path(folder) / name
            if name in NOT_OURS or path.is_symlink() or path.stat().st_size > MAX_BYTES:  # .git is a file in a worktree
                continue
            try:
                yield str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")
            except UnicodeDecodeError:
                continue


def hits(pattern: re.Pattern[str]) -> list[str]:
    return [
        f"{name}:{text.count(chr(10), 0, match.start()) + 1}: {match.group()}"
        for name, text in texts()
        for match in pattern.finditer(text)
    ]


def modules() -> list[Path]:
    return sorted(path for part in ("services", "experiments", "treenail") for path in (ROOT / part).rglob("*.py"))


def pins() -> list[str]:
    """Return the requirements of the lock file, each with its continuation lines."""
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8").replace("\\\n", " ")
    return [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]


@pytest.mark.parametrize(
    "text", ["see /wor" + "k/main/x", '"/tmp/' + 'w/v"', "cd /roo" + "t", "/hom" + "e/joe/x", "(/wor" + "k)"]
)
def test_places_of_one_machine_would_be_noticed(text: str) -> None:
    assert HOME.search(text)


@pytest.mark.parametrize("text", ["framework/x", "services/work/x", "a/root/b", "/workers", "/rooted", "$HOME/x"])
def test_other_words_are_no_places(text: str) -> None:
    assert not HOME.search(text)


def test_an_index_would_be_noticed() -> None:
    assert INDEX.search("https://py" + "pi.example.com/x")
    assert INDEX.search("http://10.0.0.1:80/sim" + "ple/")
    assert INDEX_OPTION.search("--index" + "-url http://x")


def test_the_walk_finds_the_repository() -> None:
    names = {name for name, _ in texts()}
    assert {"pyproject.toml", "requirements.lock", "services/wire/codec.py", "tests/unit/test_repository.py"} <= names


def test_no_file_names_a_package_index() -> None:
    assert hits(INDEX) == []
    assert hits(INDEX_OPTION) == []


def test_no_file_names_a_place_of_one_machine() -> None:
    assert hits(HOME) == []


def test_every_module_is_documented_and_of_a_readable_size() -> None:
    texts = {str(path.relative_to(ROOT)): path.read_text(encoding="utf-8") for path in modules()}
    assert len(texts) > 100
    assert {name: text.count("\n") for name, text in texts.items() if text.count("\n") > MAX_LINES} == {}
    assert [name for name, text in texts.items() if text.strip() and not ast.get_docstring(ast.parse(text))] == []


def test_every_pin_has_an_exact_version_and_a_hash() -> None:
    locked = pins()
    assert len(locked) > 10
    for line in locked:
        assert PIN.match(line), line[:100]
        assert re.search(r"--hash=sha256:[0-9a-f]{64}(\s|$)", line), line[:100]


def test_the_lock_needs_nothing_of_this_machine() -> None:
    text = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    for word in ("@ file", "file:/" + "/", "index" + "-url", "find" + "-links", "trusted" + "-host", "http:", "https:"):
        assert word not in text, word


def test_the_lock_has_every_package_that_the_project_names() -> None:
    locked = {match.group(1).lower().replace("_", "-") for line in pins() if (match := PIN.match(line))}
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    project = text.partition("[project]")[2].partition("[tool.")[0]
    named = {name.lower() for name in re.findall(r"\"([A-Za-z][A-Za-z0-9-]*)(?:==|>=)", project)}
    assert {"msgspec", "sapien", "pytest"} <= named
    assert named <= locked
