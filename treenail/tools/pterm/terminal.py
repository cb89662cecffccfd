"""The loop of pterm: keys or a script on one side, the line on the other. A line that is lost is opened again."""

from __future__ import annotations

import os
import select
import sys
import time
from dataclasses import dataclass
from io import RawIOBase

from services.robot_link.serial_line import Line, LineError
from treenail.tools.pterm.script import Script
from treenail.tools.pterm.text import EchoFilter, Keyboard, Screen

RETRY_S = 1.0
BELL = "\a"


@dataclass
class Options:
    """How the terminal behaves."""

    line_end: bytes = b"\r"
    """What Enter sends."""
    local_echo: bool = False
    """Show what is sent, for controllers that do not."""
    edit: bool = False
    """The person's terminal edits and shows lines; the controller's echo is dropped."""
    interactive: bool = True
    """Keys come from a person; otherwise lines come from a pipe, and the end of them is the end."""


class Terminal:
    """One session. ``log`` gets what is shown, and is not buffered."""

    def __init__(
        self, line: Line, script: Script, keys: Keyboard, options: Options, source: int, log: RawIOBase | None = None
    ) -> None:
        self._line, self._script, self._keys, self._options = line, script, keys, options
        self._source, self._log = source, log
        self._screen, self._echo = Screen(), EchoFilter()
        self._up, self._retry_s, self._reading, self._quit = True, 0.0, True, False
        self._rest = b""
        self._at_line_start = True
        self._told_failure = False

    def run(self) -> int:
        """Work until the quit key, or the end of a script; return 0, or 1 when a script was not done to its end."""
        while not self._quit:
            self._send_next()
            if self._script.failure is not None and not self._told_failure:
                self._told_failure = True
                self.notice(self._script.failure)
            if self._script.done and not self._options.interactive:
                break
            sources: list[int | Line] = [
                *([self._source] if self._reading else []),
                *([self._line] if self._up else []),
            ]
            ready, _, _ = select.select(sources, [], [], self._pause_s())
            if self._line in ready:
                self._come()
            if self._source in ready:
                self._typed()
            if not self._up and time.monotonic() >= self._retry_s:
                self._reopen()
        return 0 if self._script.failure is None or self._options.interactive else 1

    def notice(self, text: str) -> None:
        """Tell the person something that is not from the controller, on a line of its own."""
        if not self._at_line_start and sys.stderr.isatty():
            self._write("\n")
        print(f"pterm: {text}", file=sys.stderr, flush=True)

    def _pause_s(self) -> float | None:
        """Return how long to wait if nothing comes."""
        due = self._script.next_s() if self._up else self._retry_s
        return None if due is None else max(0.0, due - time.monotonic())

    def _send_next(self) -> None:
        if not self._up:
            return
        line = self._script.next(time.monotonic())
        if line is not None:
            self._send(line.encode("latin-1", "replace") + self._options.line_end)

    def _send(self, data: bytes) -> None:
        if not self._up:
            self._write(BELL if sys.stdout.isatty() else "")
            return
        try:
            self._line.write(data)
        except LineError as error:
            self._lose(error)
            return
        if self._options.local_echo:
            self._write(Screen().show(data))

    def _come(self) -> None:
        try:
            came = self._line.read()
        except LineError as error:
            self._lose(error)
            return
        text = self._screen.show(came)
        self._script.received(text, time.monotonic())
        self._write(self._echo.show(text))

    def _typed(self) -> None:
        """Take what was typed, or the next lines of a script that comes through a pipe."""
        try:
            typed = os.read(self._source, 4096)
        except OSError:  # the person's terminal is gone
            typed = b""
        if not self._options.interactive:
            self._script_lines(typed)
            return
        if not typed:
            self._quit = True
            return
        sent, self._quit = self._keys.keys(typed)
        if sent:
            if self._options.edit:
                self._echo.sent(Screen().show(sent))
            self._send(sent)

    def _script_lines(self, data: bytes) -> None:
        *lines, self._rest = (self._rest + data).split(b"\n")
        if not data:
            self._reading = False
            lines = [self._rest] if self._rest else []
        for line in lines:
            self._script.add(line.removesuffix(b"\r").decode("latin-1"))
        if not data:
            self._script.close()

    def _lose(self, error: LineError) -> None:
        self._line.close()
        self._up, self._retry_s = False, time.monotonic() + RETRY_S
        self._script.lost()
        if self._options.interactive or not self._script.done:
            self.notice(f"{error}; trying again every {RETRY_S:g} s")
        else:
            self.notice(str(error))

    def _reopen(self) -> None:
        try:
            self._line.open()
        except LineError:
            self._retry_s = time.monotonic() + RETRY_S
            return
        self._up = True
        self.notice(f"{self._line.url}: open again")

    def _write(self, text: str) -> None:
        if not text:
            return
        sys.stdout.write(text)
        sys.stdout.flush()
        self._at_line_start = text.endswith("\n")
        if self._log is None:
            return
        try:
            self._log.write(text.encode())
        except OSError as error:
            self._log = None
            self.notice(f"the log cannot be written any more: {error.strerror}")
