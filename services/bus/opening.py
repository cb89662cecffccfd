"""What may take long to open, opened while a loop goes on: a serial server that does not answer."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Opening(Generic[T]):
    """One attempt, on a thread of its own that keeps no process from ending."""

    def __init__(self, attempt: Callable[[], T], discard: Callable[[T], None]) -> None:
        """``discard`` closes what is open only after ``abandon``."""
        self._attempt, self._discard = attempt, discard
        self._lock = threading.Lock()
        self._result: T
        self._error: Exception | None = None
        self._abandoned = False
        self.done = False
        """Whether ``result`` can be asked for."""
        threading.Thread(target=self._run, name="opening", daemon=True).start()

    def result(self) -> T:
        """Return what is open, once it is done. Raises what the attempt raised."""
        if self._error is not None:
            raise self._error
        return self._result

    def abandon(self) -> None:
        """Have what is open in the end closed."""
        with self._lock:
            self._abandoned = True
            late = self.done and self._error is None
        if late:
            self._discard(self._result)

    def _run(self) -> None:
        try:
            self._result = self._attempt()
        except Exception as error:
            self._error = error  # raised again where the loop is
        with self._lock:
            self.done = True
            late = self._abandoned and self._error is None
        if late:
            self._discard(self._result)
