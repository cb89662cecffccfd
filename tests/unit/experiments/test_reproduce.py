"""The report's command: what it refuses, what it writes, and that Ctrl-C costs only the pieces at work."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from experiments.reproduce import page, report
from experiments.reproduce.__main__ import main
from experiments.reproduce.chapter import CannotRun, Chapter, Comparison, Comparisons, Section
from experiments.reproduce.context import Context
from experiments.reproduce.sections import SECTIONS
from experiments.reproduce.verdicts import Verdict

ROOT = Path(__file__).resolve().parents[3]


def refused(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """Run the command, which has to end with status 2 and one line; return the line."""
    try:
        status = main(words)
    except SystemExit as ended:
        status = int(ended.code or 0)
    said = capsys.readouterr()
    assert (status, said.out) == (2, "")
    assert said.err.count("\n") == 1
    assert said.err.startswith("treenail reproduce: ")
    return said.err


def wanted(out: Path, only: tuple[str, ...] | None = None) -> report.Wanted:
    return report.Wanted(True, (0, 1), only, out, None, 1)


def fine(context: Context) -> Chapter:
    value = context.cached("answer", {"version": 1}, lambda: 42, int)
    return Chapter((Comparisons([Comparison("answer", "42", str(value), Verdict.MATCHES)]),))


def lacking(context: Context) -> Chapter:
    raise CannotRun("no folder with data was given")


MADE_UP = (Section("fine", "A fine section", fine), Section("lacking", "A lacking section", lacking))


def test_an_unknown_section_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused(capsys, "--out", str(tmp_path / "out"), "--only", "learners", "dance")
    assert "--only: expected one or more of learners" in line
    assert line.endswith("got dance\n")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("option", ["--seeds", "--jobs"])
@pytest.mark.parametrize("number", ["0", "-1", "1001", "two"])
def test_a_wrong_number_is_refused(capsys: pytest.CaptureFixture[str], option: str, number: str) -> None:
    assert f"{option}: expected a whole number from 1 to 1000, got '{number}'" in refused(capsys, option, number)


def test_a_data_folder_that_is_not_there_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refused(capsys, "--out", str(tmp_path / "out"), "--data", str(tmp_path / "none"))
    assert f"--data: expected a folder, got {tmp_path / 'none'}" in line
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("mine")
    assert "--out: expected a folder to write to" in refused(capsys, "--out", str(tmp_path / "file" / "out"))
    assert "--out: expected a folder to write to" in refused(capsys, "--out", str(tmp_path / "file"))
    assert (tmp_path / "file").read_text() == "mine"


def test_a_page_of_somebody_else_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "index.html").write_text("<p>my own page</p>")
    assert "it is left alone" in refused(capsys, "--out", str(tmp_path))
    assert (tmp_path / "index.html").read_text() == "<p>my own page</p>"
    assert [path.name for path in tmp_path.iterdir()] == ["index.html"]


def test_a_section_that_lacks_something_stops_no_other(tmp_path: Path) -> None:
    index = report.make(wanted(tmp_path), MADE_UP)
    text = index.read_text(encoding="utf-8")
    assert index == tmp_path / "index.html"
    assert page.MARK in text
    assert "= matches</span>: 1" in text
    assert "This section could not run: no folder with data was given." in text
    assert "0 to 1" in text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["cache", "index.html"]


def test_only_the_sections_asked_for_are_run_and_an_earlier_report_is_replaced(tmp_path: Path) -> None:
    report.make(wanted(tmp_path), MADE_UP)
    text = report.make(wanted(tmp_path, ("fine",)), MADE_UP).read_text(encoding="utf-8")
    assert "A fine section" in text
    assert "A lacking section" not in text


def test_sections_have_names_of_their_own() -> None:
    names = [section.name for section in SECTIONS]
    assert names[0] == "learners"
    assert len(set(names)) == len(names)
    assert all(name.isalpha() and name.islower() for name in names)


def living(group: int) -> list[int]:
    """Return the processes of a group that have not ended (a zombie has)."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, its_group = stat.read_text().rpartition(")")[2].split()[:3]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(its_group) == group and state != "Z":
            found.append(int(stat.parent.name))
    return found


@pytest.mark.parametrize("moment", ["workers starting", "workers at work", "terminated"])
def test_ctrl_c_ends_it_with_a_word_and_keeps_what_is_finished(
    tmp_path: Path, wait_until: Callable[[str, Callable[[], object]], None], moment: str
) -> None:
    words = ["--quick", "--out", str(tmp_path), "--only", "learners", "--jobs", "2"]
    with subprocess.Popen(
        [sys.executable, "-m", "experiments.reproduce", *words],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("Learning agent")
        assert process.stderr.readline() == "maze, open: 28 pieces\n"
        if moment != "workers starting":
            wait_until("a finished piece", lambda: list(tmp_path.glob("cache/*.json")))
        if moment == "terminated":
            process.terminate()
        else:
            os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the workers too
        said = process.stderr.read()
        assert said == "treenail reproduce: interrupted; started again with the same --out it resumes\n"
        assert process.wait() == 130
    wait_until("no process is left", lambda: not living(process.pid))
    assert not (tmp_path / "index.html").exists()
    if moment != "workers starting":
        assert list(tmp_path.glob("cache/*.json"))
    assert not list(tmp_path.glob("cache/.*"))
