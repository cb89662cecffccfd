"""``treenail tare`` in a living cell: six poses, each felt by a sensor that publishes, and a tool of known weight."""

from __future__ import annotations

import itertools
import math
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from services.rules.calibration import Turned, poses
from services.wire.codec import encode, encoding_of
from services.wire.definition_file import load
from services.wire.keys import HOME
from services.wire.messages import Home

TILT_DEG = 10.0
TOOL = f"""
name = "heavy"
[noise]
force_n = 0.3
torque_nm = 0.02
[tool]
mass_kg = 0.5
centre_x_mm = 5.0
centre_z_mm = -60.0
[sensor]
window = 128
[start]
x_mm = 0.0
y_mm = 0.0
rx_deg = 0.0
ry_deg = 0.0
height_mm = 5.0
tilt_spread_deg = {TILT_DEG}
"""


def test_a_tool_is_measured_by_the_sensor_of_a_living_cell(
    live: Any, wait_until: Callable[..., None], tmp_path: Path
) -> None:
    live.definition = tmp_path / "heavy.toml"
    live.definition.write_text(TOOL)
    live.start_loop(1, "task", "sim")
    # The weight is felt as a contact, and nobody is there who decides: the arm is ours.
    wait_until("the task waits", lambda: live.phase("task").startswith("waiting for agent and classifier"))
    run, made = live.experiment().run, tmp_path / "measured.toml"
    words = ["tare", str(live.definition), "--out", str(made), "--samples", "1000", "--tilt", str(TILT_DEG)]
    asked = tmp_path / "asked"

    def bring_to(pose: Turned) -> None:
        """Have the arm there, three times over, so that nothing of the pose before is on its way any more."""
        angles = {"rx_deg": pose.rx_deg, "ry_deg": pose.ry_deg, "rz_deg": pose.rz_deg}
        for _ in range(3):
            home = Home(run=run, episode=next(episodes), x_mm=0.0, y_mm=0.0, z_mm=-5.0, **angles)
            list(live.session.get(live.keys.of(HOME), payload=encode(home), encoding=encoding_of(Home)))

    episodes = itertools.count(1)
    with asked.open("wb") as err:
        tare = subprocess.Popen(
            [sys.executable, "-m", "treenail.__main__", *words, "--connect", live.endpoint],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=err,
        )
    assert tare.stdin is not None and tare.stdout is not None
    try:
        for number, pose in enumerate(poses(TILT_DEG), start=1):
            wait_until("it asks for a pose", lambda number=number: f"{number}/6: tool in the air" in asked.read_text())
            bring_to(pose)
            time.sleep(0.3)  # on a busy machine what was felt in the pose before may still wait to be heard
            tare.stdin.write(b"\n")
            tare.stdin.flush()

            def measured(number: int = number, pose: Turned = pose) -> bool:
                bring_to(pose)
                return asked.read_text().count("N, noise 0.") == number

            wait_until("it has felt enough", measured)
        out = tare.stdout.read().decode()
        assert tare.wait(timeout=30.0) == 0, asked.read_text()
    finally:
        tare.kill()
        tare.communicate()
    calibration = load(str(made)).calibration
    down_n = (calibration.weight_x_n, calibration.weight_y_n, calibration.weight_z_n)
    assert math.dist(down_n, (0.0, 0.0, 0.5 * 9.80665)) < 0.25, out
    assert abs(calibration.sigma_n - 0.3) < 0.02
    centre_mm = (calibration.centre_x_mm, calibration.centre_y_mm, calibration.centre_z_mm)
    assert math.dist(centre_mm, (5.0, 0.0, 70.0)) < 8.0, out
    assert calibration.residual_n < 0.05
    assert f"written: {made}" in out
