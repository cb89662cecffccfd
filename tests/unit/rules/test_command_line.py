"""However a command ends, it says so in one line; options are read strictly and meant kindly."""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import pytest

from services.rules import command_line
from services.rules.command_line import Parser, address, number, whole
from services.wire.errors import TreenailError

RUN = """
import sys
from services.rules import command_line
def act():
    {act}
sys.exit(command_line.run("treenail x", act))
"""


def ended(error: BaseException, **settings: int) -> int:
    def act() -> int:
        raise error

    return command_line.run("treenail x", act, **settings)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (TreenailError("key: expected a,\n got b"), 2, "treenail x: key: expected a, got b\n"),
        (KeyboardInterrupt(), 130, "treenail x: interrupted\n"),
        (ModuleNotFoundError("no", name="sapien.core"), 2, "pip install '.[sim]'"),
        (ModuleNotFoundError("no", name="serial"), 2, "pip install '.[robot_link]'"),
        (ModuleNotFoundError("no", name="nobodys"), 2, "treenail x: expected the module nobodys, which is not"),
        (BrokenPipeError(), 0, ""),
        (PermissionError(13, "Permission denied", "a/b"), 2, "treenail x: a/b: expected to get at it, got: Permission"),
        (OSError(36, "File name too long", b"a\xff"), 2, "got: File name too long\n"),
        (FileNotFoundError(2, "No such file or directory", Path("a")), 2, "treenail x: a: expected to get at it"),
    ],
)
def test_an_end_is_one_line(capsys: pytest.CaptureFixture[str], error: BaseException, status: int, said: str) -> None:
    assert ended(error) == status
    printed = capsys.readouterr().err
    assert said in printed
    assert printed.count("\n") == bool(said)


def test_a_status_is_passed_on_and_what_nobody_reads_has_its_own() -> None:
    assert command_line.run("treenail x", lambda: None) == 0
    assert command_line.run("treenail x", lambda: 1) == 1
    assert ended(BrokenPipeError(), unread=1) == 1


def test_a_mistake_of_ours_keeps_its_traceback() -> None:
    with pytest.raises(ZeroDivisionError):
        ended(ZeroDivisionError())
    with pytest.raises(OSError, match="Bad file descriptor"):
        ended(OSError(9, "Bad file descriptor"))


@pytest.mark.parametrize("size", [5, 100_000])
def test_a_full_disk_under_standard_output_is_one_line(size: int) -> None:
    code = RUN.format(act=f"print('x' * {size})")
    with Path("/dev/full").open("w") as full:
        done = subprocess.run([sys.executable, "-c", code], stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    said = "treenail x: output cannot be written: No space left on device\n"
    assert (done.returncode, done.stderr) == (2, said)


def test_a_reader_that_has_gone_is_no_error_and_a_poor_locale_neither() -> None:
    code = RUN.format(act="print('\\u00b7\\u2500' * 200000)")
    environment = {"PYTHONIOENCODING": "latin-1", "PYTHONPATH": ":".join(sys.path)}
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        assert process.stdout.read(4) == b"\xb7?\xb7?"
        process.stdout.close()
        assert process.stderr.read() == b""
        assert process.wait(60) == 0


def parser() -> Parser:
    made = Parser(prog="treenail x", description="``x`` it")
    made.add_argument("--episodes", type=whole(1, 100), default=60, help="how long")
    made.add_argument("--quiet", action="store_true", help="say nothing")
    made.add_argument("--mode", choices=("terminal", "supervisory"), default="terminal", help="which, by default: one")
    commands = made.add_subparsers(metavar="COMMAND")
    commands.add_parser("run", help="go").add_argument("--seeds", type=whole(0), default=0)
    return made


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--quite"], "unrecognized arguments: --quite; did you mean --quiet?"),
        (["run", "--seed=1", "--sedes=3"], "unrecognized arguments: --sedes=3; did you mean --seeds?"),
        (["run", "--quiet"], "unrecognized arguments: --quiet; see treenail x --help"),
        (["rn"], "expected one of run, got 'rn'; did you mean run?"),
        (["--mode", "terminl"], "expected one of terminal, supervisory, got 'terminl'; did you mean terminal?"),
        (["--episodes", "1_0"], "argument --episodes: expected a whole number from 1 to 100, got '1_0'"),
        (["--episodes", "\u0661"], "argument --episodes: expected a whole number from 1 to 100, got '\u0661'"),
    ],
)
def test_wrong_words_are_one_line_with_what_was_meant(
    capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    with pytest.raises(SystemExit) as end:
        parser().parse_args(words)
    assert end.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert said in line and line.startswith("treenail x") and line.endswith("--help")


def test_help_says_each_default_once_and_has_no_markup() -> None:
    text = parser().format_help()
    assert "how long (default: 60)" in text
    assert text.count("default") == 2 and "``" not in text and "SUPPRESS" not in text


@pytest.mark.parametrize("text", ["nan", "inf", "-1", "1e99", "1_0", "", "\u0661", "0x1", "5s"])
def test_numbers_are_read_strictly(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="expected from 0 to 10 seconds, got"):
        number(0, 10, "seconds")(text)
    assert [number(0, 10)(good) for good in ("0", "10.0", ".5", "1e-3")] == [0, 10, 0.5, 0.001]


@pytest.mark.parametrize("text", ["", "host", "host:", ":1", "[]:1", "host:x", "host:70000", f"host:{'9' * 5000}"])
def test_an_address_is_asked_for(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="expected host:port"):
        address(text)
    assert address("[::1]:0") == ("::1", 0)


def test_a_choice_that_is_a_number_may_be_written_in_any_way() -> None:
    made = Parser()
    made.add_argument("--stop", type=number(1, 2), choices=(1, 1.5, 2))
    assert [made.parse_args(["--stop", text]).stop for text in ("1", "1.0", "1.5", "2")] == [1, 1, 1.5, 2]


def test_a_process_of_ours_has_a_safe_path() -> None:
    command = command_line.python("-c", "import sys; sys.exit(not sys.flags.safe_path)")
    assert subprocess.run(command, check=False).returncode == 0
    assert command_line.module_command("services.agent", "-h")[1:] == ["-P", "-m", "services.agent", "-h"]
