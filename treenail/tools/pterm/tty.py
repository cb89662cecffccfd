"""The person's own terminal: set for working on a line, and always put back as it was."""

from __future__ import annotations

import contextlib
import signal
import sys
import termios
from collections.abc import Iterator
from types import FrameType

from treenail.tools.pterm.text import QUIT_KEY

_INPUT, _LOCAL, _CHARACTERS = 0, 3, 6
_AT_ONCE = termios.ICANON | termios.ECHO


def ends_by_signal(number: int, frame: FrameType | None) -> None:
    """Leave by SystemExit, so that all is put back on the way out."""
    sys.exit(128 + number)


@contextlib.contextmanager
def keyboard(fd: int, edit: bool) -> Iterator[None]:
    """Pass every key on at once, also Ctrl-C; with ``edit`` whole lines, edited and shown by the terminal itself.

    Does nothing when ``fd`` is no terminal. Put back on every way out but SIGKILL.
    """
    try:
        before = termios.tcgetattr(fd)
    except termios.error:
        yield
        return
    try:
        termios.tcsetattr(fd, termios.TCSADRAIN, _settings(fd, edit))
        yield
    finally:
        for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
            signal.signal(number, signal.SIG_IGN)  # a second one must not stop what the first has begun
        with contextlib.suppress(termios.error):  # the person's terminal may be gone
            termios.tcsetattr(fd, termios.TCSANOW, before)


def _settings(fd: int, edit: bool) -> list[int | list[bytes | int]]:
    """Return the terminal's settings with what is needed changed; its output stays as it is."""
    settings = termios.tcgetattr(fd)
    settings[_LOCAL] &= ~(termios.ISIG | termios.IEXTEN)
    settings[_INPUT] &= ~(termios.IXON | termios.ISTRIP | termios.BRKINT)
    if edit:
        settings[_LOCAL] |= _AT_ONCE
        settings[_CHARACTERS][termios.VEOL] = bytes((QUIT_KEY,))  # it ends a line by itself, without Enter
        return settings
    settings[_LOCAL] &= ~_AT_ONCE
    settings[_INPUT] &= ~(termios.ICRNL | termios.INLCR | termios.IGNCR)
    settings[_CHARACTERS][termios.VMIN], settings[_CHARACTERS][termios.VTIME] = 1, 0
    return settings
