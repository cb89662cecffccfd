"""When is a controller ready for the next line? Pure: time is given.

It is when a prompt stands alone at the end of what came, on a line of its own, and nothing has come since for a while.
VAL II prompts with ``.``, and with ``*`` while a program runs; messages such as ``*Location out of range*`` begin with
the same star, so a lone star is a prompt only when silence follows. Questions end with ``?``.
"""

from __future__ import annotations

import re

PROMPT = r"[.*]\s*|.*\?\s*"
"""A whole last line that is a prompt."""
ERROR = r"\*.*[^*\s].*\*\s*"
"""A whole line that is an error (from general memory of VAL; not confirmed for VAL II)."""
_LONGEST = 1000


class PromptWatch:
    """Watches the text of a line for prompts and errors."""

    def __init__(self, quiet_s: float = 0.25, prompt: str = PROMPT, error: str = ERROR) -> None:
        self._quiet_s = quiet_s
        self._prompt, self._error = re.compile(prompt), re.compile(error)
        self._last_line, self._fresh, self._came_s = "", False, 0.0
        self.error: str | None = None
        """The first error line since the last ``sent``."""

    def sent(self) -> None:
        """A line was sent: only what stands on a new line after it can be the next prompt."""
        self._last_line, self._fresh, self.error = "", False, None

    def received(self, text: str, now_s: float) -> None:
        """Take text that came, with newlines at line ends."""
        self._came_s = now_s
        *ended, last = (self._last_line + text).split("\n")
        for line in ended if self._fresh else ended[1:]:
            if self.error is None and self._error.fullmatch(line):
                self.error = line.strip()
        self._fresh = self._fresh or bool(ended)
        self._last_line = last[-_LONGEST:]

    def ready_s(self) -> float | None:
        """Return from when on the controller is ready if nothing more comes; None while there is no prompt."""
        if self._fresh and self._prompt.fullmatch(self._last_line):
            return self._came_s + self._quiet_s
        return None
