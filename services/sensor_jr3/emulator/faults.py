"""What can go wrong with the emulated card, on demand: words of its own memory, far above those of a real one.

Written like any word, also while there is "no card": ``python -m services.sensor_jr3.emulator.panel`` does it.
"""

from __future__ import annotations

FAULTS: dict[str, tuple[int, str]] = {
    "pull": (0xF000, "1: the sensor's plug is out; 0: it is in again"),
    "watchdog": (0xF001, "1: the card says that no data comes, though samples go on"),
    "saturate": (0xF002, "1: all axes saturated"),
    "near": (0xF003, "1: all axes near saturation"),
    "change": (0xF004, "1: another sensor is put in"),
    "drop": (0xF005, "number of samples to lose"),
    "no_card": (0xF006, "1: FFFF everywhere"),
    "stall": (0xF007, "1: a command is never done"),
    "refuse": (0xF008, "1: a command ends in an error"),
    "stop": (0xF009, "1: no new samples, and no error bit says so"),
}
"""Address and meaning of each."""
FIRST_FAULT = 0xF000
