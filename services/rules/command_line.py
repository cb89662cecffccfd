"""What every command has in common: how it reads its words, how it ends, and how it starts a module of ours.

An error is one line, whatever it is that went wrong; so are a missing extra, Ctrl-C, and a reader that has gone.
"""

from __future__ import annotations

import argparse
import difflib
import errno
import logging
import math
import os
import platform
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import ModuleType
from typing import IO, Any, NoReturn

from services.wire import text
from services.wire.errors import TreenailError

EXIT_DIFFERS, EXIT_ERROR, EXIT_INTERRUPTED = 1, 2, 130
"""What was compared is not the same; it could not be done, and one line says why; Ctrl-C."""

EXTRAS = {
    "PIL": "gym",
    "artlib": "artlib",
    "av": "video",
    "cryptography": "cli",
    "dashboard_client": "robot_ur",
    "distributed": "cluster",
    "gymnasium": "gym",
    "jinja2": "reproduce",
    "matplotlib": "cli",
    "mcap": "export",
    "numba": "classifier",
    "pyarrow": "export",
    "rerun": "viewer",
    "rosbags": "ros2",
    "rtde_control": "robot_ur",
    "rtde_io": "robot_ur",
    "rtde_receive": "robot_ur",
    "sapien": "sim",
    "serial": "robot_link",
    "sklearn": "rivals",
    "tornado": "viewer",
    "xxhash": "ros2",
}
"""Modules of other packages, and the extra in pyproject.toml that installs each."""

_SAFE_PATH = "PYTHONSAFEPATH"
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO)
"""What writing says when nothing more goes on the disk, or to the terminal."""
_MANY = 10**9
_ROOMS = {"ros2_out": "ros2.out", "ros2_robot": "ros2.robot", "ros2_sensor": "ros2.sensor"}
"""Services that are not alone in their folder."""


class Help(argparse.HelpFormatter):
    """Help that says every option's default, once."""

    def _get_help_string(self, action: argparse.Action) -> str:
        said, default = action.help or "", action.default
        if isinstance(default, bool) or not isinstance(default, (int, float, str, os.PathLike)):
            return said
        if not action.option_strings or default in ("", argparse.SUPPRESS) or "default" in said:
            return said
        return f"{said} (default: {default})" if said else f"default: {default}"


class RawHelp(Help, argparse.RawDescriptionHelpFormatter):
    """The same, with the lines of the description as they are."""


class Parser(argparse.ArgumentParser):
    """A parser whose errors are one line, like all others, and which says what was probably meant."""

    def __init__(self, *args: Any, **settings: Any) -> None:
        settings.setdefault("formatter_class", Help)
        for part in ("description", "epilog"):
            if settings.get(part):
                settings[part] = settings[part].replace("``", "`")  # docstrings mark code so, people do not
        super().__init__(*args, **settings)

    def error(self, message: str) -> NoReturn:
        """End the process with the message and how to get help."""
        unknown = re.search(r"^unrecognized arguments: (\S+)", message)
        word, options = unknown[1].partition("=")[0] if unknown else "", _options(self)
        meant = did_you_mean(word, options) if word not in options else ""  # one of another command means just that
        self.exit(EXIT_ERROR, f"{self.prog}: {' '.join(message.split())}{meant}; see {self.prog} --help\n")

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is None or value in action.choices:
            return
        choices = [str(choice) for choice in action.choices]
        got = f"got {str(value)!r}{did_you_mean(str(value), choices)}"
        raise argparse.ArgumentError(action, f"expected one of {', '.join(choices)}, {got}")


def did_you_mean(word: str, choices: Sequence[str]) -> str:
    """Return the choice that was probably meant, as the end of an error, or nothing."""
    close = difflib.get_close_matches(word, choices, n=1)
    return f"; did you mean {close[0]}?" if close else ""


def _options(parser: argparse.ArgumentParser) -> list[str]:
    """Return the options of a parser and of its commands."""
    names = list(parser._option_string_actions)
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                names += _options(command)
    return names


def whole(least: int = 1, most: int = _MANY) -> Callable[[str], int]:
    """Return a reader of whole numbers from ``least`` to ``most``, written in plain digits."""

    def read(said: str) -> int:
        try:
            return text.whole(said, least, most)
        except ValueError:
            wanted = f"a whole number {range_of(least, most)}"
            raise argparse.ArgumentTypeError(f"expected {wanted}, got {said!r}") from None

    return read


def number(least: float, most: float, unit: str = "") -> Callable[[str], float]:
    """Return a reader of numbers from ``least`` to ``most``; ``unit`` is for the error."""

    def read(said: str) -> float:
        with suppress(ValueError):
            if least <= text.number(said) <= most:
                return text.number(said)
        wanted = f"{range_of(least, most)} {unit}".rstrip()
        raise argparse.ArgumentTypeError(f"expected {wanted}, got {said!r}")

    return read


def range_of(least: float, most: float) -> str:
    """Return a range in words; a most that nobody reaches is not named."""
    if most in (_MANY, math.inf):
        return f"from {least:g}"
    return f"from {least:g} to {most}" if isinstance(most, int) else f"from {least:g} to {most:.10g}"


def address(said: str) -> tuple[str, int]:
    """Read ``host:port``, or ``[host]:port``, to listen on; 0 is any free port."""
    host, _, port = said.rpartition(":")
    with suppress(ValueError):
        if host.strip("[]"):
            return host.strip("[]"), text.whole(port, 0, 65535)
    raise argparse.ArgumentTypeError(f"expected host:port, got {said[:80]!r}")


def run(
    program: str, act: Callable[[], int | None], *, interrupted: str | None = "interrupted", unread: int = 0
) -> int:
    """Do what a command does and return the exit status: what ``act`` returns, None being 0.

    ``program`` stands before what goes wrong, such as ``treenail get``; ``interrupted`` is said after Ctrl-C, unless
    None. ``unread`` is the status when whoever reads what we print has gone.
    """
    for stream in (sys.stdout, sys.stderr):
        with suppress(AttributeError, ValueError):  # what stands in for a terminal need not have it
            stream.reconfigure(errors="replace")  # type: ignore[union-attr]  # a locale may lack a character
    logging.raiseExceptions = False  # a log that cannot be written is no reason for a traceback
    try:
        status = act()
        if sys.stdout is not None:  # a command gives it up when it cannot be written
            sys.stdout.flush()
        return status or 0
    except SystemExit:  # help was asked for, or the words were wrong
        if sys.stdout is not None:
            sys.stdout.flush()
        raise
    except TreenailError as error:
        return _failed(program, str(error))
    except ModuleNotFoundError as error:
        return _failed(program, missing(error))
    except KeyboardInterrupt:
        if interrupted is not None:
            _failed(program, interrupted)
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        give_up(sys.stdout)
        return unread
    except OSError as error:
        if error.filename is not None:  # somebody's file: no permission, a name too long, gone in the meantime
            name = os.fsdecode(error.filename) if isinstance(error.filename, bytes) else error.filename
            return _failed(program, f"{name}: expected to get at it, got: {error.strerror}")
        if error.errno not in _FULL:
            raise
        give_up(sys.stdout)
        return _failed(program, f"output cannot be written: {error.strerror}")


def missing(error: ModuleNotFoundError) -> str:
    """Return in words which module is missing, and the extra that has it."""
    name = (error.name or "").partition(".")[0]
    if name not in EXTRAS:
        return f"expected the module {error.name}, which is not installed"
    machine = platform.machine()
    if name == "sapien" and machine != "x86_64":
        return (
            f"expected an x86_64 machine, the only kind that SAPIEN is made for, got {machine}; all but the simulator"
            " runs here: start treenail sim on an x86_64 one with --connect to this one's router"
        )
    extra = EXTRAS[name]
    return (
        f"expected the module {name}, got none; Treenail's extra {extra} has it: pip install '.[{extra}]' in its folder"
    )


def _failed(program: str, message: str) -> int:
    with suppress(OSError, ValueError):  # nobody reads; the status still tells
        print(f"{program}: {' '.join(message.split())}", file=sys.stderr, flush=True)
    return EXIT_ERROR


def give_up(stream: IO[str]) -> None:
    """Let a stream lead nowhere; without this the interpreter would complain about it on its way out."""
    with suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def python(*words: str) -> list[str]:
    """Return a command line of this Python; with ``-P`` no file in the current folder is taken for a module."""
    return [sys.executable, "-P", *words]


def service_module(name: str) -> str:
    """Return the module that is a service's program."""
    return f"services.{_ROOMS.get(name, name)}"


def module_command(module: str, *words: str) -> list[str]:
    """Return the command line of a module of ours."""
    return python("-m", module, *words)


@contextmanager
def safe_path() -> Iterator[None]:
    """Let a child that multiprocessing starts meanwhile have what ``python -P`` has: no folder of a script, no script.

    A child would look for modules where the caller's script is, and would run that script again from its first line.
    """
    main, path, flag = sys.modules["__main__"], list(sys.path), os.environ.get(_SAFE_PATH)
    ours = str(Path(__file__).resolve().parents[2])
    theirs = {"", os.getcwd(), str(Path(getattr(main, "__file__", None) or ".").resolve().parent)} - {ours}
    wanted = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    sys.path[:] = [folder for folder in path if folder not in theirs or (folder and folder in wanted)]
    sys.modules["__main__"], os.environ[_SAFE_PATH] = ModuleType("__main__"), "1"
    try:
        yield
    finally:
        sys.modules["__main__"], sys.path[:] = main, path
        os.environ.pop(_SAFE_PATH)
        if flag is not None:
            os.environ[_SAFE_PATH] = flag
