"""The connection in use: packets in, scripts out, one at a time, and a lost controller brought back. Nothing blocks.

    no connection --connect--> watching: packets come, the wrist is felt
    watching, nothing wrong, no other program runs --our program sent--> ready
    ready --program stopped, safety, local mode--> watching; our program is sent again only upon ``resume``
    any --silence, a clock that jumps--> no connection

What takes long is done on a thread, one thing at a time. A controller that says nothing for a quarter of a second is
lost: the arm ends the increment under way, at most; our program goes no further by itself, and its watchdog ends it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from enum import Enum

from services.bus.opening import Opening
from services.robot_ur.calls import CALL_S, Calls, Outcome, ignore, in_time
from services.robot_ur.client import Client
from services.robot_ur.errors import ArrivalError, LostError, StateError
from services.robot_ur.motion import Arm, Go, Look, Result, Script, Step, Tell, Tool, Zero, shown
from services.robot_ur.settings import Settings
from services.robot_ur.states import PLAYING, RobotMode, SafetyMode, State, hurt, trouble
from services.robot_ur.wrist import ControllerClock
from services.rules.motions import ArmError, BusyError
from services.rules.poses import apart
from services.wire.actions import Increment

SILENT_S = 0.25
"""How long a connected controller may say nothing."""
STARTING_S = 3.0
"""How long the first packet and our program may take."""
RETRY_S = (0.1, 2.0)
"""Shortest and longest pause before the next attempt; each is twice the one before."""
CHECKS, STILL_MM_S = 5, 1.0
"""Checks in the time that the controller's watchdog waits; speed of an arm that stands."""
_POLL_S, _MOST_PACKETS = 0.002, 32


class Cause(Enum):
    """Who is to blame for a loss of control."""

    SAFETY = "a person or the safety system"
    PROGRAM = "the program"
    LINE = "the line"


class Link:
    """One controller, one motion at a time."""

    def __init__(
        self,
        connect: Callable[[], Client],
        arm: Arm,
        settings: Settings,
        on_state: Callable[[State], None],
        lost: Callable[[ArmError, Cause], None],
    ) -> None:
        """``connect`` blocks; ``on_state`` gets each packet, ``lost`` hears of each fault."""
        self._connect, self._arm, self._settings = connect, arm, settings
        self._on_state, self._lost = on_state, lost
        self._client: Client | None = None
        self._clock = ControllerClock()
        self._state: State | None = None
        """The newest packet of this connection."""
        self._heard_s = 0.0
        self._opening: Opening[Client] | None = None
        self._retry_at_s, self._retry_s = 0.0, RETRY_S[0]
        self._calls = Calls()
        self._control = False
        self._running_by_s = 0.0
        """Until when our program has to be seen running; 0 once it was."""
        self._allowed = True
        """Whether our program may be sent."""
        self._hurt = False
        """Whether something keeps the arm from moving."""
        self._recovering = False
        """Whether it may be sent as soon as nothing keeps the arm from moving."""
        self._checked_s = 0.0
        self._script: Script | None = None
        self._script_then: Callable[[Increment | ArmError], None] = ignore
        self._goal: Go | None = None
        """Where the arm is on its way to."""
        self._goal_by_s = 0.0
        self._looking = False
        self.trouble = "robot: not connected yet"
        """Why it is not ready, or what went wrong last."""

    @property
    def ready(self) -> bool:
        """Whether a script can be run, now or after the one under way."""
        return self._control and not self._running_by_s

    @property
    def busy(self) -> bool:
        """Whether a script is under way."""
        return self._script is not None

    def run(self, script: Script, then: Callable[[Increment | ArmError], None]) -> None:
        """See services.bus.robot.Link."""
        if not self.ready:
            raise ArmError(self.trouble)
        if self.busy:
            raise BusyError("robot: expected to be asked for one motion at a time, another one is under way")
        self._script, self._script_then = script, then
        self._go_on(None)

    def give_up(self, error: ArmError) -> None:
        """See services.bus.robot.Link."""
        if self.busy:
            client = self._client
            if client is not None:
                self._calls.start(client.stop, ignore)
            self._end_script(error)
            self._lost(error, Cause.PROGRAM)

    def allow(self) -> None:
        """Let our program be sent to the controller again: somebody wants that."""
        self._allowed = True
        self._retry_at_s = 0.0

    def recover(self) -> None:
        """Do what the settings allow against what keeps the arm from moving. Raises StateError when that is nothing."""
        state, client, settings = self._state, self._client, self._settings
        if state is None or client is None:
            raise ArmError(self.trouble)
        why = trouble(state)
        if why is None:
            self.allow()
        elif state.safety_mode == SafetyMode.PROTECTIVE_STOP.value and settings.unlock:
            self._calls.start(client.unlock, self._recovered)
        elif hurt(state) is None and settings.power and state.robot_mode in _POWERED:
            release = state.robot_mode == RobotMode.IDLE.value
            self._calls.start(lambda: client.power_up(release), self._recovered)
        else:
            raise StateError(f"robot: {why}")

    def pump(self, timeout_s: float) -> None:
        """See services.bus.robot.Link."""
        now = time.monotonic()
        deadline = now + timeout_s
        while True:
            for _ in range(_MOST_PACKETS):
                if not self._work(now):
                    break
            now = time.monotonic()
            if now >= deadline:
                return
            time.sleep(min(_POLL_S, deadline - now))

    def close(self) -> None:
        """See services.bus.robot.Link."""
        client, self._client = self._client, None
        if self._opening is not None:
            self._opening.abandon()
        if client is not None:
            if self.busy:
                in_time(client.stop)
            in_time(client.close)

    # -- the connection ----------------------------------------------------------------------------------------------

    def _work(self, now: float) -> bool:
        """Do what is due; return whether a packet was there."""
        client = self._client
        if client is None:
            self._open(now)
            return False
        state = client.state()
        if state is not None:
            complaint = self._clock.complaint(state.t_s, now)
            if complaint is not None:
                self._disconnect(LostError(complaint), now)
                return False
            self._heard_s, self._state = now, state
            self._on_state(state)
            self._watch(state, now)
        elif now - self._heard_s > self._patience_s or not client.connected:
            silent_s = now - self._heard_s
            self._disconnect(
                LostError(f"robot: expected packets of the controller, got none for {silent_s:.2f} s"), now
            )
            return False
        if not self._calls.mind(now):
            self._disconnect(
                LostError(f"robot: expected an answer of the controller within {CALL_S:g} s, got none"), now
            )
        if self._client is client and not self._calls.busy:
            self._find_work(client, state, now)
        return state is not None

    @property
    def _patience_s(self) -> float:
        """How long no packet may come; ur_rtde lets none through while it sends our program, when nothing moves."""
        return SILENT_S if self._state is not None and (self._control or not self._calls.busy) else STARTING_S

    def _open(self, now: float) -> None:
        if self._opening is None:
            if now < self._retry_at_s:
                return
            self._opening = Opening(self._connect, lambda client: client.close())
        if not self._opening.done:
            return
        opening, self._opening = self._opening, None
        try:
            client = opening.result()
        except ArmError as error:
            self.trouble = str(error)
            self._wait_longer(now)
            return
        self._client, self._state, self._heard_s = client, None, now
        # What somebody has stopped before the line broke stays so.
        self._control, self._running_by_s = False, 0.0
        self._clock.begin()
        self._arm.anew()
        self.trouble = f"robot: connected to {client.what}, no packet yet"

    def _disconnect(self, error: ArmError, now: float) -> None:
        client, self._client, self._state = self._client, None, None
        if client is not None:
            Opening(client.close, ignore)
        self._calls.forget()
        self._wait_longer(now)
        self._lose(error, Cause.LINE)

    def _wait_longer(self, now: float) -> None:
        self._retry_at_s = now + self._retry_s
        self._retry_s = min(RETRY_S[1], 2.0 * self._retry_s)

    def _watch(self, state: State, now: float) -> None:
        """Look whether the arm still takes our orders."""
        why = trouble(state)
        if why is not None:
            if self._control or self._allowed:
                self._allowed = False
                self._lose(StateError(f"robot: {why}"), Cause.SAFETY)
            self.trouble = f"robot: {why}"
            self._hurt = True
            return
        if self._hurt:
            self._hurt = False
            self.trouble = "robot: it could move again, and waits for `treenail resume`"
        if self._recovering:
            self._recovering = False
            self.allow()
        if self._control and self._running_by_s:
            if state.runtime == PLAYING:
                self._running_by_s, self._retry_s, self.trouble = 0.0, RETRY_S[0], ""
                self._checked_s = now
            elif now > self._running_by_s:
                self._lose(
                    StateError("robot: expected our program to run on the controller, it does not start"), Cause.PROGRAM
                )
        elif self._control and state.runtime != PLAYING:
            self._allowed = False
            self._lose(
                StateError(
                    "robot: expected our program to run on the controller, somebody has stopped it, or another client "
                    "has sent his own"
                ),
                Cause.PROGRAM,
            )

    def _lose(self, error: ArmError, cause: Cause) -> None:
        """Take note that nothing is under control any more; what was under way has failed."""
        self.trouble = str(error)
        self._control, self._running_by_s = False, 0.0
        self._arm.anew()
        self._end_script(error)
        self._lost(error, cause)

    def _find_work(self, client: Client, state: State | None, now: float) -> None:
        if self._script is not None:
            if state is not None:
                self._on_the_way(state, now)
        elif self._control and not self._running_by_s:
            if now - self._checked_s > self._settings.watchdog_s / CHECKS:
                self._checked_s = now
                self._calls.start(client.check, self._on_checked)
        elif not self._control and self._allowed and self._state is not None and now >= self._retry_at_s:
            if self._state.runtime == PLAYING and not self._settings.by_itself:  # an emulated arm has no other clients
                self.trouble = "robot: expected no program to run on the controller, another one does: stop it there"
                return
            self._wait_longer(now)
            self._calls.start(client.take_control, self._on_control)

    def _on_control(self, result: Outcome) -> None:
        if isinstance(result, ArmError):
            self.trouble = str(result)
            return
        self._control, self._running_by_s = True, time.monotonic() + STARTING_S
        self.trouble = "robot: our program is sent, it does not run yet"

    def _on_checked(self, result: Outcome) -> None:
        if isinstance(result, ArmError):
            self._allowed = False
            self._lose(result, Cause.PROGRAM)

    def _recovered(self, result: Outcome) -> None:
        if isinstance(result, ArmError):
            self.trouble = str(result)
        else:
            self._recovering = True

    # -- scripts -----------------------------------------------------------------------------------------------------

    def _go_on(self, result: Result | None) -> None:
        script = self._script
        if script is None:
            return
        try:
            step = next(script) if result is None else script.send(result)
        except StopIteration as end:
            then, self._script = self._script_then, None
            then(end.value)
            return
        except ArmError as error:
            self._end_script(error)
            self._lost(error, Cause.PROGRAM)
            return
        self._begin(step)

    def _begin(self, step: Step) -> None:
        client, settings = self._client, self._settings
        if client is None:
            return
        self._checked_s = time.monotonic()  # whatever we say keeps the watchdog quiet
        match step:
            case Look():
                self._looking = True
            case Go(goal):
                self._goal, self._goal_by_s = None, 0.0
                self._calls.start(
                    lambda: client.move(goal, settings.speed_mm_s, settings.acceleration_mm_s2),
                    lambda result: self._on_moving(step, result),
                )
            case Zero():
                self._calls.start(client.zero, self._on_done)
            case Tool():
                self._calls.start(client.tool, self._on_done)
            case Tell(episode, number):
                self._calls.start(lambda: client.tell(episode, number), self._on_done)

    def _on_moving(self, step: Go, result: Outcome) -> None:
        if isinstance(result, ArmError):
            self._fail(result)
        elif self._script is not None:
            self._goal, self._goal_by_s = step, time.monotonic() + self._settings.move_s

    def _on_done(self, result: Outcome) -> None:
        if isinstance(result, ArmError):
            self._fail(result)
        elif self._state is not None:
            self._go_on(Result(self._state, result if isinstance(result, list) else ()))

    def _on_the_way(self, state: State, now: float) -> None:
        """Look with each packet whether the arm has arrived; packets come in order, so none is older than the goal."""
        if self._looking:
            self._looking = False
            self._go_on(Result(state))
            return
        step, settings = self._goal, self._settings
        if step is None:
            return
        away_mm, turned_deg = apart(state.pose, step.goal)
        if away_mm <= settings.within_mm and turned_deg <= settings.within_deg and state.speed_mm_s < STILL_MM_S:
            self._goal = None
            self._go_on(Result(state))
        elif now > self._goal_by_s:
            expected = f"within {settings.within_mm:g} mm and {settings.within_deg:g} deg of where the motion leads"
            self._fail(
                ArrivalError(
                    f"robot: expected the arm {expected} after {settings.move_s:g} s, got {away_mm:.3f} mm and "
                    f"{turned_deg:.3f} deg away, at {shown(state.pose)}; told to stop"
                )
            )
        elif now - self._checked_s > settings.watchdog_s / CHECKS and self._client is not None:
            self._checked_s = now
            self._calls.start(self._client.check, self._on_checked)

    def _fail(self, error: ArmError) -> None:
        """End the script with an error; the arm is told to stop."""
        if self._client is not None and self._control:
            self._calls.start(self._client.stop, ignore)
        self._end_script(error)
        self._lost(error, Cause.PROGRAM)

    def _end_script(self, error: ArmError) -> None:
        script, self._script = self._script, None
        self._goal, self._looking = None, False
        if script is not None:
            script.close()
            self._script_then(error)


_POWERED = (RobotMode.POWER_OFF.value, RobotMode.IDLE.value)
