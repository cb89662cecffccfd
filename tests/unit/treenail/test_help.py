"""What the command says of itself: everything has help, in plain words, and no command is a list of them."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable

import pytest

from services.rules.command_line import service_module
from treenail import __main__ as command

HELPS: list[tuple[str, ...]] = [(name,) for name in (*command.COMMANDS, *command.STUDIES, *command.TOOLS)]
HELPS += [("experiment", "run"), ("experiment", "show"), ("checkpoint", "export"), ("bench", "soak"), ("chaos", "run")]


def says(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    """Return status, standard output and standard error of the command."""
    monkeypatch.setattr(sys, "argv", ["treenail", *words])
    with pytest.raises(SystemExit) as end:
        command.main()
    assert isinstance(end.value.code, int)
    return (end.value.code, *capsys.readouterr())


Says = Callable[..., tuple[int, str, str]]


def plain(text: str) -> bool:
    return not any(mark in text for mark in ("``", "python -m", "SUPPRESS", "None)", ":class:"))


@pytest.mark.parametrize("words", HELPS, ids=" ".join)
def test_help_is_in_plain_words(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    status, out, err = says(monkeypatch, capsys, *words, "--help")
    assert (status, err) == (0, "")
    assert out.startswith(f"usage: treenail {' '.join(words)}") and plain(out), out


@pytest.mark.parametrize("service", command.SERVICES)
def test_help_of_a_service_is_in_plain_words(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], service: str
) -> None:
    monkeypatch.setattr(sys, "argv", ["treenail", "--help"])
    with pytest.raises(SystemExit):
        module = service_module(service)
        importlib.import_module(module if module.count(".") > 1 else f"{module}.__main__").main()
    out = capsys.readouterr().out
    assert out.startswith(f"usage: treenail {service} ") and plain(out), out
    # Where a person has to connect to is said.
    assert "7447" in out and ("9876" in out or service != "viewer")


def test_no_command_is_the_list_of_them(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    status, out, err = says(monkeypatch, capsys)
    assert (status, err) == (0, "")
    for name in (*command.COMMANDS, *command.STUDIES, *command.TOOLS, *command.SERVICES):
        assert f"\n  {name} " in out


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (("statsu",), "treenail: unknown command 'statsu'; did you mean status?; see treenail --help"),
        (("xyzzy",), "treenail: unknown command 'xyzzy'; see treenail --help"),
        (("--versoin",), "treenail: unrecognized arguments: --versoin; did you mean --version?; see treenail --help"),
        (("get",), "treenail get: the following arguments are required: key; see treenail get --help"),
    ],
)
def test_wrong_words_are_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], line: str
) -> None:
    assert says(monkeypatch, capsys, *words) == (2, "", line + "\n")


@pytest.mark.parametrize(
    "words", [("status",), ("get", "x"), ("q-table",), ("top",), ("replay",), ("checkpoint", "list")]
)
def test_without_a_cell_it_is_said_at_once_how_to_start_one(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: tuple[str, ...]
) -> None:
    where = "unixsock-stream/nowhere"
    status, out, err = says(monkeypatch, capsys, *words, "--connect", where)
    said = f"nobody listens on {where}; start a cell with `treenail up sim`, or say --connect ENDPOINT"
    assert (status, out, err) == (2, "", f"treenail {words[0]}: {said}\n")
