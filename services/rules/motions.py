"""What the robot answers, whatever arm it has: order, guard, senses, repetition. Pure; the motion is somebody else's.

    not homed --homed--> at step n of an episode --moved--> at step n + 1 ...      any fault --> not homed

After a fault every motion but ``home`` is out of order, so that the task begins the episode anew. Times are nanoseconds
of one clock that does not go back: the monotonic one of the process, simulated time in the simulator.
"""

from __future__ import annotations

from msgspec.structs import replace

from services.rules.front_end import FrontEnd
from services.rules.guard import OLDEST_S, Guard
from services.rules.senses import Senses, Taken
from services.rules.touch import Touch
from services.wire.actions import Increment
from services.wire.definition import Definition
from services.wire.errors import RefusedError
from services.wire.messages import FtPacket, Home, Move, Moved


class OutOfOrderError(RefusedError):
    """A motion that is neither the next one nor the last one again."""

    reason = "out_of_order"


class GuardError(RefusedError):
    """A motion that the guard refuses."""

    reason = "guard"


class DeadSensorError(GuardError):
    """A motion that is refused because the sensor answers, but does not feel."""


class ArmError(RefusedError):
    """The motion was not made, or nobody knows; nothing but ``home`` is taken after it."""

    reason = "not_ready"


class BusyError(RefusedError):
    """Another motion is under way."""

    reason = "not_ready"


class OtherRunError(RefusedError):
    """A motion of another run than the task's."""

    reason = "foreign_run"


class Robot:
    """Motions of one run."""

    def __init__(self, definition: Definition, run: str, oldest_s: float = OLDEST_S) -> None:
        self.run = run
        self._guard = Guard(definition, oldest_s)
        self._hard_force_n = definition.limits.hard_force_n
        self._senses, self._touch = Senses(definition), Touch(definition)
        self._front = FrontEnd(definition)
        self._last: Home | Move | None = None
        self._done: Moved | None = None

    def feel(self, packet: FtPacket, now_ns: int) -> Taken:
        """Take an F/T packet, and return what it is; the times of another source are not those before."""
        taken = self._senses.take(packet, now_ns)
        if taken == "other":
            self._front.began_anew()
        if taken != "old":
            self._touch.feel(self._front.take(packet))
        return taken

    def feel_anew(self) -> None:
        """Take the next packet for new, whatever its number and time are."""
        self._senses.forget()
        self._front.forget()

    def resumed(self) -> None:
        """Take note that somebody has looked: the next zero need not be near the one before."""
        self._front.resumed()

    def home(self, home: Home) -> None:
        """Allow ``home``. Raises GuardError, OtherRunError."""
        self._check_run(home.run)
        _allow(self._guard.homing(home))

    def homed(self, home: Home, arrived_t_ns: int) -> Moved:
        """Take note that it is done, and return the answer."""
        self._guard.homed(home)
        self._senses.homed()
        self._touch.begin(home)
        self._front.homed(home, arrived_t_ns)
        self._last = home
        self._done = Moved(run=home.run, episode=home.episode, step=0, arrived_t_ns=arrived_t_ns)
        return self._done

    def again(self, move: Move, now_ns: int) -> Moved | None:
        """Return the answer to a motion that is made already, None for one that is not. Raises as ``move``."""
        self._check_run(move.run)
        if self._done is None or move != self._last:
            return None
        _allow(self.sensing(now_ns))
        return self._done

    def move(self, move: Move, now_ns: int) -> None:
        """Allow the next motion, by what was felt last.

        Raises OutOfOrderError, GuardError, DeadSensorError, OtherRunError.
        """
        self._check_run(move.run)
        done = self._done
        if done is None or (move.episode, move.step) != (done.episode, done.step + 1):
            at = "not homed" if done is None else f"at episode {done.episode}, step {done.step}"
            raise OutOfOrderError(f"move: cannot make step {move.step} of episode {move.episode}: the robot is {at}")
        if self._front.waits:
            raise GuardError(
                "guard: tare: expected the zero of this episode to be taken before it moves, it is not yet"
            )
        numb = self._front.trouble
        if numb is None:
            _allow(self._guard.moving(move, self._front.felt, self._senses.age_s(now_ns)))
            numb = self._senses.dead() or self._touch.missing()
        if numb is not None:
            raise DeadSensorError(numb)

    def moved(self, move: Move, applied: Increment, arrived_t_ns: int) -> Moved:
        """Take note of what was applied, and return the answer."""
        dx_mm, dy_mm, dz_mm, rx_deg, ry_deg, rz_deg = applied
        answer = Moved(
            run=move.run,
            episode=move.episode,
            step=move.step,
            arrived_t_ns=arrived_t_ns,
            dx_mm=dx_mm,
            dy_mm=dy_mm,
            dz_mm=dz_mm,
            rx_deg=rx_deg,
            ry_deg=ry_deg,
            rz_deg=rz_deg,
        )
        self._guard.moved(applied)
        self._senses.moved()
        self._touch.take(applied)
        self._front.moved(applied)
        self._last, self._done = move, answer
        return answer

    def lost(self) -> None:
        """Take note that nobody knows where the arm is; also before a motion begins, until it is confirmed."""
        self._last = self._done = None

    def arrived(self, t_ns: int) -> None:
        """State anew from when on samples show the last motion: the sensor's clock is another one by now."""
        if self._done is not None:
            self._done = replace(self._done, arrived_t_ns=t_ns)

    def sensing(self, now_ns: int) -> str | None:
        """Return why nothing may move with what was felt last, or None."""
        return self._guard.sensing(self._front.felt, self._senses.age_s(now_ns)) or self._front.trouble

    def numb(self) -> str | None:
        """Return why the sensor is not to be believed before somebody has looked, or None."""
        return self._front.trouble

    def pressing(self, felt: FtPacket) -> str | None:
        """Return why a motion that is under way has to be stopped, or None."""
        force_n = self._front.greatest_n(felt)
        if force_n <= self._hard_force_n:
            return None
        return f"robot: expected at most {self._hard_force_n} N in a motion, got {force_n:.2f} N; told to abort"

    def _check_run(self, run: str) -> None:
        if run != self.run:
            raise OtherRunError(f"robot: this cell runs {self.run}, got a motion of run {run}")


def require_tool_at_tip(definition: Definition) -> None:
    """Refuse what a real arm cannot do: its way to a start pose reckons with a TOOL whose origin is the peg's tip.

    Raises:
        GuardError: if rotations are meant about another point.
    """
    if centre_mm := definition.moves.rotation_centre_mm:
        expected = "expected 0, as the arm's TOOL is set to the peg's tip"
        raise GuardError(f"robot: moves.rotation_centre_mm: {expected}, got {centre_mm}")


def _allow(complaint: str | None) -> None:
    if complaint is not None:
        raise GuardError(complaint)
