"""The latch between a stop and the next motion: after one, the arm moves only when somebody has said so. Pure.

    held --resume--> free --any trouble of the arm--> held                        an arm, and it begins held
    free --motions that fail, one after the other--> held --resume--> free        an emulated one

The latch is held from the start: a process that begins anew cannot know what was stopped before it, and a restart is
nobody's deliberate act. So nothing has to be remembered, and nothing that is killed can lose it. Who resumes names the
stop that he means: a request that was under way for long never frees a later one.
"""

from __future__ import annotations

from services.wire.errors import RefusedError
from services.wire.messages import Resume, Stop

MOST_FAILED = 15
"""Motions that may fail one after the other before an arm that may go on by itself is held, too."""
RETRY_S = (0.05, 10.0)
"""Shortest and longest pause after a motion that failed; each is twice the one before."""
_LONGEST = 120
"""Of a reason [characters], so that the hint behind it is seen in every phase."""


class PauseError(RefusedError):
    """A motion failed just now; the next one may be asked for in a moment."""


class StoppedError(RefusedError):
    """The arm waits for somebody to let it go on."""

    reason = "stopped"


class Hold:
    """One arm's latch. Times are nanoseconds of any clock; a stop is named by its own."""

    def __init__(self, by_itself: bool, t_ns: int) -> None:
        """``by_itself``: the arm is an emulated one, which may go on without being told."""
        self._by_itself = by_itself
        self._failed = 0
        self._not_before_s = 0.0
        self.stop = Stop(stop_t_ns=0, why="")
        """Why the arm is held; time 0 when it is not."""
        self.trouble("nothing has been let move since the robot link started", t_ns)

    @property
    def held(self) -> bool:
        """Whether nothing may move."""
        return self.stop.stop_t_ns > 0

    def trouble(self, why: str, t_ns: int) -> None:
        """Note that arm or controller are not as they were: a person or a safety device may be the reason."""
        if not self._by_itself:
            self._hold(why, t_ns)

    def insist(self, why: str, t_ns: int) -> None:
        """Hold the arm, whatever arm it is."""
        self._hold(why, t_ns)

    def failed(self, why: str, t_ns: int, now_s: float) -> None:
        """Note that a motion did not succeed, at ``now_s`` of a clock that does not go back."""
        self._failed += 1
        self._not_before_s = now_s + min(RETRY_S[1], RETRY_S[0] * 2.0 ** (self._failed - 1))
        if not self._by_itself:
            self._hold(why, t_ns)
        elif self._failed >= MOST_FAILED:
            self._hold(f"{self._failed} motions failed one after the other: {why}", t_ns)

    def succeeded(self) -> None:
        """Note that a motion was made."""
        self._failed = 0

    def check(self, now_s: float) -> None:
        """Raise StoppedError while nothing may move, PauseError for a moment after a motion that failed."""
        if self.held:
            raise StoppedError(self.words())
        if now_s < self._not_before_s:
            wait_s = self._not_before_s - now_s
            raise PauseError(f"robot: {self._failed} motions failed one after the other; the next in {wait_s:.1f} s")

    def words(self) -> str:
        """Return why nothing moves, and what to do."""
        return f"{self.stop.why}; `treenail resume` lets it move"

    def resume(self, request: Resume) -> Stop:
        """Let the arm move again; return what holds it then: nothing. Raises StoppedError for another stop's name."""
        if self.held and request.stop_t_ns != self.stop.stop_t_ns:
            expected = f"resume: expected the name of the stop that holds the arm, {self.stop.stop_t_ns}"
            raise StoppedError(f"{expected}, got {request.stop_t_ns}; look again: {self.stop.why}")
        self._failed, self._not_before_s = 0, 0.0
        self.stop = Stop(stop_t_ns=0, why="")
        return self.stop

    def _hold(self, why: str, t_ns: int) -> None:
        name = max(t_ns, self.stop.stop_t_ns + 1, 1)
        self.stop = Stop(stop_t_ns=name, why=why if len(why) <= _LONGEST else f"{why[: _LONGEST - 3]}...")
