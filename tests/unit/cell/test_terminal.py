"""What is printed: text is text, whatever stands in it, on whatever terminal or log, read by somebody or not."""

from __future__ import annotations

import ast
import io
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from rich.table import Table

from services.cell import terminal
from services.cell.terminal import LOG_WIDTH, console

ROOT = Path(__file__).resolve().parents[3]
FOREIGN = ("a[bold]b", "old[/new]", "http://[fd00::1]:9090", "force [N]", "[/x]", ":warning:", "[link=x]y[/link]")


def ours() -> Iterator[tuple[Path, ast.AST]]:
    """Yield every node of every file that may print."""
    for folder in ("treenail", "services", "experiments"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text())):
                yield path, node


@pytest.mark.parametrize("text", FOREIGN)
def test_foreign_text_is_text_in_lines_and_everywhere_in_tables(text: str) -> None:
    file = io.StringIO()
    table = Table(title=f"title {text}", caption=f"caption {text}")
    table.add_column(f"column {text}")
    table.add_row(f"cell {text}")
    shown = console(file=file)
    shown.print(f"line {text}")
    shown.print(table)
    for place in ("title", "caption", "column", "cell", "line"):
        assert f"{place} {text}" in file.getvalue()


def test_all_that_prints_does_so_on_the_console_of_one_place() -> None:
    own = Path(terminal.__file__)
    for path, node in ours():
        if path == own or not isinstance(node, ast.ImportFrom | ast.Attribute | ast.Call):
            continue
        if isinstance(node, ast.ImportFrom) and node.module in ("rich", "rich.console"):
            assert not {"Console", "print"} & {alias.name for alias in node.names}, path
        if isinstance(node, ast.Attribute):
            assert node.attr not in ("from_markup", "render_markup"), path
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "TextColumn":
            assert "description" not in ast.unparse(node) or "markup=False" in ast.unparse(node), path


def test_a_log_is_wide_enough_for_a_table_and_a_wide_table_may_ask_for_more() -> None:
    assert console(file=io.StringIO()).width == LOG_WIDTH
    assert console(file=io.StringIO(), least_width=200).width == 200


@pytest.mark.parametrize("encoding", ["iso8859-2", "ascii", "latin-1", "utf-8"])
def test_a_character_that_an_encoding_lacks_is_replaced(encoding: str) -> None:
    raw = io.BytesIO()
    file = io.TextIOWrapper(raw, encoding=encoding)
    table = Table(title="N·m ✓")
    table.add_column("torque [N·m]")
    shown = console(file=file)
    shown.print(table)
    shown.print("5 °, 3 µm")
    file.flush()
    assert b"torque [N" in raw.getvalue()


SPEAKER = """
import sys
from services.cell.terminal import Unread, console
unread, shown = Unread("treenail up"), console()
for number in range(20000):
    unread.attempt(lambda: shown.print(f"line {number}"))
sys.exit(7)
"""


def _unread(where: int) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-c", SPEAKER]
    return subprocess.run(command, stdout=where, stderr=subprocess.PIPE, cwd=ROOT, check=False, timeout=60)


def test_when_nobody_reads_work_goes_on_and_it_is_said_once() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    done = _unread(writing)
    os.close(writing)
    assert done.returncode == 7
    assert done.stderr.decode() == "treenail up: standard output: Broken pipe; the run goes on unread\n"


def test_when_the_disk_of_the_log_is_full_work_goes_on_and_it_is_said_once() -> None:
    full = os.open("/dev/full", os.O_WRONLY)
    done = _unread(full)
    os.close(full)
    assert done.returncode == 7
    assert done.stderr.decode() == "treenail up: standard output: No space left on device; the run goes on unread\n"
