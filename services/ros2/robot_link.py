"""The driver of an arm behind a Cartesian controller of ROS 2: targets out, one motion at a time. Nothing blocks.

    not ready --poses come, a controller hears the targets, nobody else sends any--> ready
    ready --silence of the poses, the controller gone, another sender--> not ready

A target is an order to go there now, so that a long way is many targets. The arm has arrived when the pose that it
reports has stood still near the goal; a controller says nothing else. Who stops it has it stay where it reports to be.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple, Protocol

from services.bus.opening import Opening
from services.ros2.motion import Arm, Go, Script, way
from services.ros2.names import Endpoint
from services.ros2.robot_errors import ArrivalError, MotionError
from services.ros2.robot_settings import Settings
from services.rules.motions import ArmError, BusyError
from services.rules.poses import Pose, apart
from services.wire.actions import Increment

_POLL_S, _LOOK_S = 0.002, 1.0
_STRAYED = 2.0
"""How many times as far as it may be on arrival an arm may be from there when it is told to go on."""


class Told(NamedTuple):
    """The number of a motion, for a controller that asks for it."""

    number: int
    episode: int
    step: int


class Controller(Protocol):
    """The other side, as topics."""

    def send(self, target: Pose, told: Told | None) -> None:
        """Publish a target."""

    def there(self) -> list[Endpoint]:
        """Return who publishes and hears in the domain, but for ourselves; blocks for a moment."""


class Link:
    """One controller, one motion at a time."""

    def __init__(self, controller: Controller, arm: Arm, settings: Settings, lost: Callable[[ArmError], None]) -> None:
        """``lost`` hears of each fault."""
        self._controller, self._arm, self._settings, self._lost = controller, arm, settings, lost
        self._at: deque[tuple[float, Pose]] = deque()
        """Poses reported in the last while, and when they came; the newest is last."""
        self._done = -1
        """Number of the motion that the controller says is made."""
        self._looking: Opening[list[Endpoint]] | None = None
        self._looked_s = -_LOOK_S
        self._absent = "robot: not yet known who is there"
        """Why nobody follows our targets; empty when somebody does."""
        self._was_ready = False
        self._script: Script | None = None
        self._then: Callable[[Increment | ArmError], None] = lambda _: None
        self._goal: Pose | None = None
        self._targets: deque[Pose] = deque()
        self._due_s = self._sent_s = 0.0
        self._told: Told | None = None
        self._numbers = 0
        self._commanded: Pose | None = None
        """The last target; None when the arm may be elsewhere."""

    @property
    def trouble(self) -> str:
        """Return why it is not ready; empty when it is."""
        silent_s = time.monotonic() - self._at[-1][0] if self._at else None
        if silent_s is None or silent_s > self._settings.silent_s:
            since = "" if silent_s is None else f" for {silent_s:.2f} s"
            return f"robot: expected poses on {self._settings.pose}, got none{since}"
        return self._absent

    @property
    def ready(self) -> bool:
        """See services.bus.robot.Link."""
        return not self.trouble

    @property
    def busy(self) -> bool:
        """See services.bus.robot.Link."""
        return self._script is not None

    def run(self, script: Script, then: Callable[[Increment | ArmError], None]) -> None:
        """See services.bus.robot.Link."""
        if self.trouble:
            raise MotionError(self.trouble)
        if self.busy:
            raise BusyError("robot: expected to be asked for one motion at a time, another one is under way")
        self._script, self._then = script, then
        self._go_on(lambda: next(script))

    def give_up(self, error: ArmError) -> None:
        """See services.bus.robot.Link."""
        if self.busy:
            self._fail(error)

    def heard(self, pose: Pose, now: float) -> None:
        """Take a pose that was reported."""
        self._at.append((now, pose))
        while len(self._at) > 1 and self._at[1][0] <= now - self._settings.steady_s:
            self._at.popleft()

    def made(self, number: int) -> None:
        """Take note that the controller says that a motion is made."""
        self._done = number

    def pump(self, timeout_s: float) -> None:
        """See services.bus.robot.Link."""
        self._look(time.monotonic())
        trouble = self.trouble
        if trouble and self._was_ready:
            self._arm.anew()
            if self.busy:
                self._fail(MotionError(trouble))
            else:
                self._commanded = None
                self._lost(MotionError(trouble))
        self._was_ready = not trouble
        if self.busy:
            self._work(time.monotonic())
        if timeout_s > 0.0:
            time.sleep(min(_POLL_S, timeout_s))

    def close(self) -> None:
        """See services.bus.robot.Link."""
        if self.busy:
            self._stay()
        if self._looking is not None:
            self._looking.abandon()

    # -- details -----------------------------------------------------------------------------------------------------

    def _look(self, now: float) -> None:
        if self._looking is None:
            if now - self._looked_s >= _LOOK_S:
                self._looked_s, self._looking = now, Opening(self._controller.there, lambda _: None)
            return
        if not self._looking.done:
            return
        there, self._looking = self._looking.result(), None
        target = self._settings.target
        others = [one.node for one in there if one.kind == "MP" and one.topic == target]
        if others:
            self._absent = f"robot: expected nobody else to publish on {target}, {others[0][:80]} does; end it"
        elif not any(one.kind == "MS" and one.topic == target for one in there):
            self._absent = f"robot: expected a controller that hears {target}, got none; is it active?"
        else:
            self._absent = ""

    def _work(self, now: float) -> None:
        """Send the next target, or look whether the arm has arrived."""
        if self._targets:
            if now >= self._due_s:
                self._due_s = max(self._due_s, now - 1.0 / self._settings.target_hz) + 1.0 / self._settings.target_hz
                self._commanded, self._sent_s = self._targets.popleft(), now
                self._controller.send(self._commanded, self._told)
            return
        goal, settings = self._goal, self._settings
        newest_s, pose = self._at[-1]
        if goal is None or newest_s <= self._sent_s:
            return
        away_mm, turned_deg = apart(pose, goal)
        near = away_mm <= settings.within_mm and turned_deg <= settings.within_deg
        if near and self._stands(newest_s) and (self._told is None or self._done == self._told.number):
            self._goal = None
            script = self._script
            if script is not None:
                self._go_on(lambda: script.send(pose))
        elif now - self._sent_s > settings.arrive_s:
            expected = f"within {settings.within_mm:g} mm and {settings.within_deg:g} deg of the last target"
            self._fail(
                ArrivalError(
                    f"robot: expected the arm to stand {expected} after {settings.arrive_s:g} s, it is "
                    f"{away_mm:.3f} mm and {turned_deg:.3f} deg away; told to stay there"
                )
            )

    def _stands(self, newest_s: float) -> bool:
        """Return whether the arm has reported the same place since long enough after the last target."""
        settings = self._settings
        first_s, first = self._at[0]
        since_s = max(first_s, self._sent_s)
        moved_mm = max(apart(first, pose)[0] for _, pose in self._at)
        return newest_s - since_s >= settings.steady_s * 0.9 and moved_mm <= settings.steady_mm

    def _go_on(self, step: Callable[[], Go]) -> None:
        try:
            go = step()
        except StopIteration as end:
            self._script = None
            self._then(end.value)
        except ArmError as error:
            self._fail(error)
        else:
            self._begin(go)

    def _begin(self, go: Go) -> None:
        settings, at = self._settings, self._at[-1][1]
        if go.goal is None:
            script, self._commanded = self._script, None
            if script is not None:
                self._go_on(lambda: script.send(at))
            return
        if self._commanded is not None and self._strayed(self._commanded, at):
            self._fail(
                MotionError("robot: expected the arm where it was led, somebody moved it since; only home is taken")
            )
            return
        self._told = None
        if settings.tell:
            self._numbers += 1
            episode, step = go.motion or (-1, -1)
            self._told = Told(self._numbers, episode, step)
        self._goal, self._due_s = go.goal, time.monotonic()
        start = self._commanded or at
        self._targets = deque(way(start, go.goal, settings.stride_mm, settings.stride_deg))

    def _strayed(self, commanded: Pose, at: Pose) -> bool:
        """Return whether the arm is farther from the last target than one that has arrived: it would jump there."""
        away_mm, turned_deg = apart(commanded, at)
        return away_mm > _STRAYED * self._settings.within_mm or turned_deg > _STRAYED * self._settings.within_deg

    def _stay(self) -> None:
        """Have the arm stay where it is."""
        if self._at:
            self._controller.send(self._at[-1][1], None)
        self._commanded = None

    def _fail(self, error: ArmError) -> None:
        """End the script with an error; the arm is told to stay where it is."""
        script, self._script = self._script, None
        self._goal = None
        self._targets.clear()
        self._arm.anew()
        self._stay()
        if script is not None:
            script.close()
            self._then(error)
        self._lost(error)
