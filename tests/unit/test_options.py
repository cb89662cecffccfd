"""Every numeric option of every command, service, tool and bench is read strictly; none is left out."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import pytest

from services.rules.command_line import Parser, service_module
from treenail import __main__ as command

ROOT = Path(__file__).resolve().parents[2]
WRONG = ("nan", "inf", "-inf", "1_0", "\u0663", "0x10", "1e400", "")
OTHERS = (
    "services.robot_link.emulator.__main__",
    "services.robot_ur.emulator.__main__",
    "services.ros2.emulator.__main__",
    "services.sensor_jr3.card_server",
    "services.sensor_jr3.emulator.__main__",
    "services.sensor_jr3.emulator.panel",
    "services.sensor_rdt.emulator.__main__",
    "services.together.__main__",
    "treenail.tools.pfloppy.try_it",
    "experiments.bench.ft_stream",
    "experiments.chaos.tap",
    "experiments.fuzz.__main__",
    "experiments.lab.contact_states",
)
"""Programs that are no word of ``treenail``."""


class CaughtError(Exception):
    """A program's parser, and the file that has it read words."""


def caught(monkeypatch: pytest.MonkeyPatch, program: Callable[[], object]) -> tuple[Parser, str]:
    """Return the parser with which a program is about to read its words, and the program's file."""

    def catch(self: Parser, *_: Any) -> NoReturn:
        raise CaughtError(self, sys._getframe(1).f_code.co_filename)

    with monkeypatch.context() as here:
        here.setattr(Parser, "parse_args", catch)
        with pytest.raises(CaughtError) as end:
            program()
    parser, file = end.value.args
    return parser, file


def program_of(name: str) -> str:
    """Return the module with the main function of a service."""
    module = service_module(name)
    return module if module.count(".") > 1 else f"{module}.__main__"


def programs() -> Iterator[tuple[str, Callable[[], object]]]:
    for name in (*command.COMMANDS, *command.STUDIES, *command.TOOLS, "store"):
        yield name, partial(command._act, name, [])
    for module in (*(program_of(name) for name in command.SERVICES), *OTHERS):
        yield module, partial(lambda name: importlib.import_module(name).main(), module)


PROGRAMS = dict(programs())


def each(parser: argparse.ArgumentParser, before: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Give each argument of a parser and of its commands, and the words that must stand before it."""
    places = before
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, under in action.choices.items():
                yield from each(under, (*places, name))
        elif action.option_strings:
            yield (*before, action.option_strings[-1]), action
        else:
            yield places, action
            places = (*places, str(next(iter(action.choices))) if action.choices else "x")


def reads_text(reader: Callable[[str], object]) -> bool:
    try:
        reader("x")
    except (ValueError, argparse.ArgumentTypeError):
        return False
    return True


def refusal(parser: Parser, words: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> str:
    """Return the one line with which words are refused."""
    with pytest.raises(SystemExit) as end:
        if words[-2].startswith("-"):
            parser.parse_args([*words[:-2], "=".join(words[-2:])])
        parser.parse_args([*words[:-1], "--", words[-1]])
    assert end.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


@pytest.mark.parametrize("name", PROGRAMS)
def test_no_number_is_read_as_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    parser, _ = caught(monkeypatch, PROGRAMS[name])
    for words, action in each(parser):
        if action.type is None:
            assert not isinstance(action.default, (int, float)) or action.nargs == 0, f"{words}: a number, not read"
        elif not reads_text(action.type):
            for wrong in WRONG:
                line = refusal(parser, (*words, wrong), capsys)
                assert repr(wrong) in line and "expected" in line and "Traceback" not in line, (words, line)


def test_every_program_that_reads_words_is_here(monkeypatch: pytest.MonkeyPatch) -> None:
    sources = (path for folder in ("services", "treenail", "experiments") for path in (ROOT / folder).rglob("*.py"))
    reading = {str(path) for path in sources if ".parse_args(" in path.read_text(encoding="utf-8")}
    assert reading == {caught(monkeypatch, program)[1] for program in PROGRAMS.values()}


@pytest.mark.parametrize("wrong", ["nan", "1_0", "0"])
def test_a_number_in_the_environment_is_read_as_strictly(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], wrong: str
) -> None:
    monkeypatch.setenv("TREENAIL_FLEET", wrong)
    with pytest.raises(SystemExit) as end:
        caught(monkeypatch, PROGRAMS["services.agent.__main__"])[0].parse_args([])
    assert end.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"argument --fleet: expected a whole number from 1 to 1000, got '{wrong}'" in line
