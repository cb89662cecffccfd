"""Lines sent one by one, each after the controller's prompt. Pure: time is given."""

from __future__ import annotations

from collections import deque

from treenail.tools.pterm.prompt import PromptWatch


class Script:
    """Lines still to be sent, and what became of those that were.

    The first goes out at once: a prompt that stood there before the terminal came cannot be seen.
    """

    def __init__(self, watch: PromptWatch, patience_s: float = 60.0, keep_going: bool = False) -> None:
        self._watch, self._patience_s, self._keep_going = watch, patience_s, keep_going
        self._lines: deque[str] = deque()
        self._waiting_for: str | None = None
        self._sent_s = 0.0
        self._number = 0
        self._closed = False
        self.failure: str | None = None
        """Why the rest is not sent, in one line."""

    def add(self, line: str) -> None:
        """Put a line, without its end, behind the others."""
        self._lines.append(line)

    def close(self) -> None:
        """Say that no line will follow."""
        self._closed = True

    @property
    def busy(self) -> bool:
        """Whether a line is waiting to be sent or answered."""
        return self.failure is None and bool(self._lines or self._waiting_for is not None)

    @property
    def done(self) -> bool:
        """Whether nothing will be sent any more."""
        return self.failure is not None or (self._closed and not self.busy)

    def received(self, text: str, now_s: float) -> None:
        """Take text that came, with newlines at line ends."""
        self._watch.received(text, now_s)

    def next(self, now_s: float) -> str | None:
        """Return the line to send now, if it is time for one."""
        if self.failure is not None or not self._answered(now_s) or not self._lines:
            return None
        line = self._waiting_for = self._lines.popleft()
        self._number, self._sent_s = self._number + 1, now_s
        self._watch.sent()
        return line

    def next_s(self) -> float | None:
        """Return when to ask again even if nothing comes; None for never."""
        if self.failure is not None or self._waiting_for is None:
            return None
        ready = self._watch.ready_s()
        return self._sent_s + self._patience_s if ready is None else ready

    def lost(self) -> None:
        """The line is gone: nothing is sent again by itself, since it might move the arm twice."""
        if self.busy:
            self._fail("the line was lost")

    def _answered(self, now_s: float) -> bool:
        """Return whether the last line's prompt has come; notice errors, and that it does not come."""
        if self._waiting_for is None:
            return True
        ready = self._watch.ready_s()
        if ready is not None and now_s >= ready:
            if self._watch.error is not None and not self._keep_going:
                self._fail(f"the controller says {self._watch.error!r}")
                return False
            self._waiting_for = None
            return True
        if ready is None and now_s >= self._sent_s + self._patience_s:
            self._fail(f"no prompt within {self._patience_s:g} s")
        return False

    def _fail(self, why: str) -> None:
        after = f"line {self._number} ({self._waiting_for!r})" if self._number else "the first line"
        self.failure = f"{why} after {after}; {len(self._lines)} more not sent"
