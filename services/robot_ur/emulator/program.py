"""What the program does that ur_rtde sends to the controller, as seen through the registers. Not interpreted.

``input_int_register_0`` is the command; ``output_int_register_0`` says 1 ready, 2 done; the numbers are ur_rtde 1.6's.
A motion takes place on a thread of its own, for a simulator may have to be asked; the packets go on meanwhile.
"""

from __future__ import annotations

import threading

from services.bus.emulated_arm import ArmFault
from services.bus.frames import between
from services.robot_ur.emulator.controller import LOG, PLAYING, STOPPED, Controller

MOVE_L, ZERO_FT, SET_PAYLOAD, PROTECTIVE_STOP = 3, 8, 17, 31
STOP_L, STOP_J, WATCHDOG, IS_SAFE, TCP_OFFSET, IS_STEADY, END = 33, 34, 35, 36, 40, 47, 255
READY, DONE = 1, 2
EPISODE_REGISTER, STEP_REGISTER = "input_int_register_18", "input_int_register_19"
"""Episode + 1, and step, where the driver tells them."""
_HEADER, _END = b"def rtde_control()", b"end"
_LONGEST = 1 << 20


class Motion:
    """One motion of the arm, made on a thread."""

    def __init__(self, controller: Controller, goal: tuple[float, ...], asynchronous: bool) -> None:
        self.goal, self.asynchronous = goal, asynchronous
        self.ends_s = controller.now_s + controller.behaviour.motion_s
        self.thread: threading.Thread | None = None
        self.fault = ""

    def begin(self, controller: Controller) -> None:
        """Have it made."""
        episode, step = (int(controller.number(name)) for name in (EPISODE_REGISTER, STEP_REGISTER))
        told = (episode - 1, step) if episode > 0 else (None, None)
        self.thread = threading.Thread(target=self._make, args=(controller, *told), daemon=True)
        self.thread.start()

    def _make(self, controller: Controller, episode: int | None, step: int | None) -> None:
        try:
            controller.arm.move_to(self.goal, episode, step)
        except ArmFault as fault:
            self.fault = str(fault)


class Program:
    """The program while it runs."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._text = b""
        self._executing = False
        self._motion: Motion | None = None
        self._watched_s = 0.0
        """Longest silence of the client; 0 for any."""
        self._progress = self._operations = 0

    def take(self, text: bytes) -> None:
        """Take script text as it comes; a whole program starts."""
        self._text = (self._text + text)[-_LONGEST:]
        if self._text.startswith(_HEADER) and self._text.rstrip().endswith(b"\n" + _END):
            self._text = b""
            self._start()
        elif not _HEADER.startswith(self._text[: len(_HEADER)]) and not self._text.startswith(_HEADER):
            LOG.info("script that is not run: %r", self._text[:60])
            self._text = b""

    def tick(self) -> None:
        """Let the program go on."""
        controller = self._controller
        if self._motion is not None:
            self._go_on(self._motion)
        if controller.runtime != PLAYING:
            return
        if self._watched_s and controller.now_s - controller.heard_s > self._watched_s:
            LOG.info("watchdog: the client has said nothing for %.2f s", self._watched_s)
            self._stop(controller)
            return
        command = int(controller.number("input_int_register_0"))
        if command == 0:
            self._executing = False
            self._say(READY)
        elif not self._executing:
            self._executing = True
            self._do(command)

    def _start(self) -> None:
        controller = self._controller
        if not controller.start_program():
            LOG.info("a program was sent, and not taken")
            return
        self._abort()
        # A command that a client has left in the register is carried out, as by the true program.
        self._executing, self._watched_s, controller.heard_s = False, 0.0, controller.now_s
        self._report(-1)
        self._say(READY)

    def _do(self, command: int) -> None:
        controller = self._controller
        number = [controller.number(f"input_double_register_{place}") for place in range(8)]
        match command:
            case 3:
                self._abort()
                asynchronous = controller.number("input_int_register_1") == 1
                self._motion = Motion(controller, tuple(number[:6]), asynchronous)
                if asynchronous:
                    self._report(0)
                else:
                    return  # done when it is made
            case 8:
                controller.zero()
            case 17:
                controller.payload_kg, controller.payload_cog_m = number[0], tuple(number[1:4])
            case 31:
                controller.protect()
                return
            case 33 | 34:
                self._abort()
            case 35:
                self._watched_s = 1.0 / number[0] if number[0] > 0 else 0.0
            case 36:
                controller.registers["output_int_register_1"] = 1
            case 40:
                for place, value in enumerate(controller.behaviour.tcp):
                    controller.registers[f"output_double_register_{place}"] = value
            case 47:
                controller.registers["output_int_register_1"] = int(self._motion is None)
            case 255:
                self._stop(controller)
                return
            case _:
                LOG.warning("command %d is not emulated: the program stops", command)
                self._stop(controller)
                return
        self._say(DONE)

    def _go_on(self, motion: Motion) -> None:
        controller = self._controller
        if controller.runtime != PLAYING:
            self._abort()
        elif motion.thread is None:
            if controller.faults.stop_in_motion:
                controller.faults.stop_in_motion = False
                self._abort()
                controller.protect()
            elif controller.now_s >= motion.ends_s:
                motion.begin(controller)
        elif not motion.thread.is_alive():
            self._motion = None
            if motion.fault:
                LOG.warning("the arm cannot make the motion, the program stops: %s", motion.fault)
                controller.runtime = STOPPED
                return
            controller.pose, controller.loads = controller.arm.pose, controller.arm.loads
            if controller.faults.short_mm:
                x, *rest = controller.pose
                controller.pose = (x - controller.faults.short_mm / 1000.0, *rest)
            if motion.asynchronous:
                self._report(-1)
            else:
                self._say(DONE)

    def _abort(self) -> None:
        """End the motion under way, half-way; one that is being made already is waited for."""
        motion, self._motion = self._motion, None
        if motion is None:
            return
        controller = self._controller
        if motion.thread is not None:
            motion.thread.join()
            controller.pose, controller.loads = controller.arm.pose, controller.arm.loads
        else:
            controller.arm.stop_at(between(controller.pose, motion.goal, 0.5))
            controller.pose, controller.loads = controller.arm.pose, controller.arm.loads
        if motion.asynchronous:
            self._report(-1)

    def _stop(self, controller: Controller) -> None:
        self._abort()
        controller.runtime = STOPPED

    def _say(self, what: int) -> None:
        self._controller.registers["output_int_register_0"] = what

    def _report(self, progress: int) -> None:
        """Show how far an operation is that nobody waits for; less than 0 when it has ended."""
        self._progress = (self._progress + 1) % 128
        if progress == 0:
            self._operations = (self._operations + 1) % 128
        shown = self._progress << 16 | self._operations << 24
        self._controller.registers["output_int_register_2"] = shown + (progress + 32768 if progress >= 0 else 0)
