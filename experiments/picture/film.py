"""One episode of a run as a film: made again from its journal, drawn motion by motion, written as MP4 or GIF."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path

from PIL import Image

from experiments.export.source import Source
from experiments.lab.guided import make, told
from experiments.picture.raster import Pixels
from experiments.picture.scene import Scene, Shot
from services.sim.cell import SimulatedCell
from services.task.insertion import Insertion
from services.wire.errors import DivergedError, TreenailError
from services.wire.messages import EpisodeSummary, FtPacket, Home, JournalEpisode, Move, Moved

ENDINGS = (".mp4", ".gif")
REST_S = 1.5
"""How long the last picture stays."""
COLOURS = 32
"""Of a GIF."""


def entry_of(source: Source, episode: int) -> JournalEpisode:
    """Return a finished episode of a run. Raises TreenailError when it has no such one."""
    if episode >= source.length:
        raise TreenailError(f"--episode: expected 0 to {source.length - 1} of {source.name}, got {episode}")
    for entry in source.episodes:
        if entry.episode == episode and entry.summary is not None:
            return entry
    raise TreenailError(f"{source.name}: expected episode {episode} to be over, it is not yet")


def shots(source: Source, entry: JournalEpisode) -> Iterator[Shot]:
    """Give a picture's content after each motion of an episode.

    Raises DivergedError when the simulator feels something else than the journal has, as for a run on a real arm.
    """
    definition = source.definition
    run = entry.run
    cell, task = SimulatedCell(definition, run, source.seed), Insertion(definition, run, source.seed)
    taken: list[Shot] = []
    forces: list[float] = []
    title = f"{definition.name}, seed {source.seed}, episode {entry.episode}"

    def see(moved: Moved, packet: FtPacket) -> None:
        if moved.step:
            forces.append(math.hypot(*packet.force_n[-1]))
        taken.append(Shot(cell.world.peg, packet.force_n[-1], tuple(forces), title))

    motion: Home | Move = task.home(entry.episode, entry.first_decision)
    for step in (*entry.steps, None):
        reached = make(task, cell, motion, see).then
        yield from taken
        taken.clear()
        if step is None or isinstance(reached, EpisodeSummary):
            break
        if (reached.step, reached.force_n, reached.torque_nm) != (step.step, step.force_n, step.torque_nm):
            raise DivergedError(
                f"episode {entry.episode}: expected {step.force_n} N after motion {step.step}, as the journal has, got"
                f" {reached.force_n} N: a film can be made of what this version simulated, not of a real arm"
            )
        motion = task.act(told(reached, step.action or 0, step.state or 0, step.increment))


def pictures(source: Source, entry: JournalEpisode) -> Iterator[Pixels]:
    """Give the pictures, shape (540, 480, 3)."""
    moves = 0 if entry.summary is None else entry.summary.moves
    scene = Scene(source.definition, moves)
    for shot in shots(source, entry):
        yield scene.picture(shot)


def write(path: Path, kind: str, frames: Iterable[Pixels], per_second: int) -> int:
    """Write a film of ``kind`` .mp4 or .gif and return how many pictures it has, without those of its rest."""
    return _write_gif(path, frames, per_second) if kind == ".gif" else _write_mp4(path, frames, per_second)


def _write_gif(path: Path, frames: Iterable[Pixels], per_second: int) -> int:
    images = [Image.fromarray(frame).quantize(COLOURS, dither=Image.Dither.NONE) for frame in frames]
    if not images:
        return 0
    times_ms = [1000 // per_second] * (len(images) - 1) + [round(1000 * REST_S)]
    images[0].save(
        path, format="GIF", save_all=True, append_images=images[1:], duration=times_ms, loop=0, optimize=False
    )
    return len(images)


def _write_mp4(path: Path, frames: Iterable[Pixels], per_second: int) -> int:
    import av  # an extra that GIFs do not need

    count = 0
    with av.open(str(path), "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=per_second)
        stream.pix_fmt, stream.time_base = "yuv420p", Fraction(1, per_second)
        last = None
        for last in frames:
            if count == 0:
                stream.height, stream.width = last.shape[:2]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(last, format="rgb24")))
            count += 1
        if last is not None:
            for _ in range(round(REST_S * per_second)):
                container.mux(stream.encode(av.VideoFrame.from_ndarray(last, format="rgb24")))
        container.mux(stream.encode(None))
    return count
