"""``treenail pterm``: a terminal for an old controller on a serial line; a person types, or a script.

Lines of --send, and of a pipe as standard input, go out one by one, each after the controller's prompt. Never yet run
on hardware; how VAL II echoes and ends lines is not publicly known, so these are settings.
"""

from __future__ import annotations

import re
import signal
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from io import FileIO
from pathlib import Path

from services.robot_link import serial_line
from services.rules import command_line
from services.rules.command_line import Parser, number
from services.wire.errors import TreenailError
from treenail.tools.pterm.prompt import ERROR, PROMPT, PromptWatch
from treenail.tools.pterm.script import Script
from treenail.tools.pterm.terminal import Options, Terminal
from treenail.tools.pterm.text import LINE_ENDS, Keyboard
from treenail.tools.pterm.tty import ends_by_signal, keyboard


class FileError(TreenailError):
    """A file of the command line that cannot be used."""


def main(words: Sequence[str] | None = None) -> int:
    """Work as a terminal; return the exit status."""
    return command_line.run("treenail pterm", lambda: _act(words), interrupted=None)


def _act(words: Sequence[str] | None) -> int:
    parser = _parser()
    arguments = parser.parse_args(words)
    for option in ("prompt", "error"):
        try:
            re.compile(getattr(arguments, option))
        except re.error as error:
            parser.error(f"--{option}: expected a regular expression, got {getattr(arguments, option)!r}: {error}")
    watch = PromptWatch(arguments.quiet, arguments.prompt, arguments.error)
    script = Script(watch, arguments.patience, arguments.keep_going)
    interactive = sys.stdin.isatty()
    line_end = LINE_ENDS[arguments.line_end]
    options = Options(line_end, arguments.local_echo, arguments.edit and interactive, interactive)
    keys = Keyboard(line_end, b"\b" if arguments.backspace == "bs" else b"\x7f")
    line = serial_line.line_of(arguments)
    for ending in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(ending, ends_by_signal)
    with ExitStack() as stack:
        for text in _lines(arguments.send):
            script.add(text)
        log = _log(arguments.log, stack)
        line.open()
        stack.callback(line.close)
        stack.enter_context(keyboard(sys.stdin.fileno(), options.edit))
        terminal = Terminal(line, script, keys, options, sys.stdin.fileno(), log)
        terminal.notice(f"{line.url} {line.settings}" + ("; quit with Ctrl-]" if interactive else ""))
        try:
            return terminal.run()
        except OSError as error:
            sys.stdout = None  # or Python would complain again at its end
            raise FileError(f"standard output: {error.strerror}") from error


def _parser() -> Parser:
    parser = Parser(prog="treenail pterm", description=__doc__)
    serial_line.add_arguments(parser)
    parser.add_argument("--log", type=Path, metavar="FILE", help="append all that is shown to a file")
    parser.add_argument("--send", type=Path, metavar="FILE", help="first send a file's lines, each after a prompt")
    parser.add_argument("--edit", action="store_true", help="edit lines here, and send them whole upon Enter")
    parser.add_argument("--line-end", default="cr", choices=tuple(LINE_ENDS), help="what Enter sends (default: cr)")
    parser.add_argument("--backspace", default="del", choices=("del", "bs"), help="what Backspace sends (default: del)")
    parser.add_argument("--local-echo", action="store_true", help="show what is sent; for controllers without echo")
    parser.add_argument("--prompt", default=PROMPT, metavar="RE", help=_escaped("a last line that is a prompt", PROMPT))
    parser.add_argument("--error", default=ERROR, metavar="RE", help=_escaped("a line that is an error", ERROR))
    parser.add_argument(
        "--quiet", type=number(0.0, 1e6), default=0.25, metavar="S", help="silence after a prompt (default: 0.25)"
    )
    parser.add_argument(
        "--patience", type=number(0.01, 1e6), default=60.0, metavar="S", help="wait so long for one (default: 60)"
    )
    parser.add_argument("--keep-going", action="store_true", help="send on after an error line")
    return parser


def _escaped(what: str, default: str) -> str:
    return f"{what} (default: {default})".replace("%", "%%")


def _lines(path: Path | None) -> list[str]:
    """Return the lines of the file to send."""
    if path is None:
        return []
    try:
        # A byte order mark, with which some editors begin a file, is no text for a controller.
        return path.read_bytes().removeprefix(b"\xef\xbb\xbf").decode("latin-1").splitlines()
    except OSError as error:
        raise FileError(f"{path}: cannot be read: {error.strerror}") from error


def _log(path: Path | None, stack: ExitStack) -> FileIO | None:
    if path is None:
        return None
    try:
        return stack.enter_context(path.open("ab", buffering=0))
    except OSError as error:
        raise FileError(f"{path}: cannot be written: {error.strerror}") from error


if __name__ == "__main__":
    sys.exit(main())
