"""An emulated card in virtual time: a step of the DSP is 125 us, and only waiting makes steps."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from services.sensor_jr3.emulator.dsp import Dsp, Sensor
from services.sensor_jr3.emulator.faults import FAULTS

STEPS_S = 8000


class Bench:
    """A DSP as a driver's ``Memory``, with a record of what was written to it."""

    def __init__(self, sensor: Sensor) -> None:
        self.dsp = Dsp(sensor)
        self.written: list[tuple[int, int]] = []
        self.reads = 0
        self.waited_s = 0.0

    def read(self, address: int, count: int) -> list[int]:
        self.reads += 1
        return self.dsp.read(address, count)

    def write(self, address: int, value: int) -> None:
        self.written.append((address, value))
        self.dsp.write(address, value)

    def fault(self, name: str, value: int = 1) -> None:
        self.dsp.write(FAULTS[name][0], value)

    def go(self, seconds: float) -> None:
        """Let time go by."""
        self.waited_s += seconds
        for _ in range(round(seconds * STEPS_S)):
            self.dsp.step()

    def run(self, waits: Iterator[float]) -> None:
        """Do what takes time to its end."""
        for seconds in waits:
            self.go(seconds)


@pytest.fixture
def bench() -> Callable[..., Bench]:
    """Make a bench; settings as of the emulator's ``Sensor``."""

    def make(**settings: object) -> Bench:
        usual: dict[str, object] = {"calibration_steps": 800, "zeroes_itself": False}
        return Bench(Sensor(**(usual | settings)))  # type: ignore[arg-type]

    return make
