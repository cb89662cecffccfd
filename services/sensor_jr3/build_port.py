"""``python -m services.sensor_jr3.build_port``: the helper for 16-bit port access, next to this file. Needs ``cc``."""

from __future__ import annotations

import platform
import shutil
import subprocess
import sys
from pathlib import Path

from services.bus import command
from services.rules.settings import SettingError
from services.wire.text import one_line

SOURCE = Path(__file__).with_name("port.c")
LIBRARY = Path(__file__).with_name("jr3_port.so")
COMMAND = "python -m services.sensor_jr3.build_port"
MACHINES = ("x86_64", "i686", "i586", "i386", "AMD64")


def check_machine() -> None:
    """Raise SettingError on a machine that has no I/O ports, or no Linux to allow them."""
    if platform.machine() not in MACHINES or sys.platform != "linux":
        got = f"{sys.platform} on {platform.machine()}"
        raise SettingError(f"isa: expected Linux on an x86 machine, which has I/O ports, got {got}")


def build(library: Path = LIBRARY) -> Path:
    """Compile the helper and return its path. Raises SettingError without a compiler, and on other machines."""
    check_machine()
    compiler = shutil.which("cc")
    if compiler is None:
        raise SettingError("jr3 port helper: expected a C compiler (cc), got none; on Debian: apt install gcc")
    words = [compiler, "-O2", "-Wall", "-Wextra", "-shared", "-fPIC", "-pthread", "-o", str(library), str(SOURCE)]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SettingError(f"jr3 port helper: the C compiler fails: {one_line(' '.join(done.stderr.split()))}")
    return library


def main() -> None:
    """Build it and say where."""
    print(build())


if __name__ == "__main__":
    command.run("build_port", main)
