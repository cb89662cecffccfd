"""Where an episode begins: drawn from seed and episode alone, so that whoever knows the run knows it. Pure."""

from __future__ import annotations

from services.wire.definition import Definition
from services.wire.messages import Home
from services.wire.randomness import Role, generator


def start_pose(definition: Definition, run: str, seed: int, episode: int) -> Home:
    """Return the start pose of an episode: of the tip in the hole frame [mm, deg]."""
    start = definition.start
    low, high = -1.0, 1.0
    drawn = generator(seed, Role.START_POSE, episode, 0).uniform(low, high, size=5).tolist()
    middle = (start.x_mm, start.y_mm, start.rx_deg, start.ry_deg, start.rz_deg)
    pose = [at + half * part for at, half, part in zip(middle, start.spreads, drawn, strict=True)]
    if start.decimals:
        pose = [round(value, start.decimals) + 0.0 for value in pose]  # no negative zero
    x_mm, y_mm, rx_deg, ry_deg, rz_deg = pose
    return Home(
        run=run,
        episode=episode,
        x_mm=x_mm,
        y_mm=y_mm,
        z_mm=-start.height_mm,
        rx_deg=rx_deg,
        ry_deg=ry_deg,
        rz_deg=rz_deg,
    )
