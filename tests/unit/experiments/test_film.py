"""Pictures and films of insertions: near hides far, the film is of the episode that was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("PIL", reason="the extra gym or video is not installed")

from msgspec.structs import replace
from PIL import Image

from experiments.export.source import Source
from experiments.lab.in_process import InProcessRun
from experiments.picture import film
from experiments.picture.raster import Camera, Canvas
from experiments.picture.scene import Scene, Shot
from services.sim.pose import Pose
from services.wire.definition_file import load
from services.wire.errors import DivergedError, TreenailError
from services.wire.messages import JournalEpisode

CAMERA = Camera((0.0, 0.0, -100.0), (0.0, 0.0, 0.0), (0.0, -1.0, 0.0), 20.0, 40, 40)
"""Looks along +Z: 2 pixels a mm, x to the right, y down."""
FACING = np.tile([0.0, 0.0, -1.0], (3, 1))


def triangle(size: float, z: float) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    return np.array([[-size, -size, z], [size, -size, z], [-size, size, z]])


@pytest.fixture(scope="module")
def recorded() -> tuple[Source, list[JournalEpisode]]:
    definition = load("initial", ["start.height_mm=0.4", "limits.move_limit=40", "limits.success_fraction=0.2"])
    run = InProcessRun(definition, 3)
    journal = []
    for _ in run.episodes(2):
        journal.append(run.task.record())
    return Source("small", definition, 3, 2, iter(())), journal


def test_the_camera_puts_a_point_where_it_is() -> None:
    (centre, right, below) = CAMERA.project([[0, 0, 0], [5, 0, 0], [0, 5, 0]])
    assert centre == pytest.approx([20, 20, 100])
    assert right == pytest.approx([30, 20, 100]) and below == pytest.approx([20, 30, 100])


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_what_is_nearer_hides_what_is_behind_in_whatever_order(order: tuple[int, int]) -> None:
    canvas = Canvas(CAMERA, (0, 0, 0))
    shapes = [(triangle(8, 0.0), (255, 0, 0)), (triangle(4, -10.0), (0, 255, 0))]
    for place in order:
        canvas.draw(shapes[place][0], FACING, shapes[place][1])
    red, green = canvas.pixels[8, 8], canvas.pixels[18, 18]
    assert red[0] > 0 and red[1] == 0, "only the one behind reaches there"
    assert green[1] > 0 and green[0] == 0, "the nearer one hides it"
    assert canvas.pixels[38, 38].tolist() == [0, 0, 0]


def test_what_is_half_transparent_mixes_with_what_is_behind() -> None:
    canvas = Canvas(CAMERA, (0, 0, 0))
    canvas.draw(triangle(8, 0.0), FACING, (200, 0, 0))
    before = int(canvas.pixels[18, 18, 0])
    canvas.draw(triangle(4, -10.0), FACING, (0, 200, 0), opacity=0.5)
    mixed = canvas.pixels[18, 18]
    assert mixed[0] == pytest.approx(before / 2, abs=1) and mixed[1] > 0


def test_a_picture_has_peg_arrow_and_curve() -> None:
    scene = Scene(load("suite-square"))
    still = Shot(Pose(0.0, 0.0, -1.0), (0.0, 0.0, 0.0), [], "")
    plain = scene.picture(still)
    assert plain.shape == (540, 480, 3)
    deeper = scene.picture(still._replace(peg=Pose(0.0, 0.0, 6.0)))
    pushed = scene.picture(still._replace(force_n=(4.0, 0.0, -3.0)))
    curved = scene.picture(still._replace(forces_n=[0.0, 5.0, 2.0]))
    assert (deeper[:400] != plain[:400]).any() and (deeper[400:] == plain[400:]).all()
    assert (pushed[:400] != plain[:400]).any() and (pushed[400:] == plain[400:]).all()
    assert (curved[:400] == plain[:400]).all() and (curved[400:] != plain[400:]).any()


def test_a_film_is_of_the_episode_that_was(recorded: tuple[Source, list[JournalEpisode]]) -> None:
    source, journal = recorded
    entry = journal[1]
    assert entry.summary is not None
    shots = list(film.shots(source, entry))
    assert len(shots) == entry.summary.moves + 1
    assert max(shots[-1].forces_n) == entry.summary.peak_force_n
    other = replace(entry.steps[1], force_n=(9.0, 0.0, 0.0))
    with pytest.raises(DivergedError, match="a film can be made of what this version simulated, not of a real arm"):
        list(film.shots(source, replace(entry, steps=(entry.steps[0], other, *entry.steps[2:]))))


def test_films_play(tmp_path: Path, recorded: tuple[Source, list[JournalEpisode]]) -> None:
    source, journal = recorded
    frames = [frame for frame, _ in zip(film.pictures(source, journal[0]), range(3), strict=False)]
    assert film.write(tmp_path / "film.gif", ".gif", frames, 10) == 3
    with Image.open(tmp_path / "film.gif") as image:
        assert (image.format, image.size, getattr(image, "n_frames", 1)) == ("GIF", (480, 540), 3)
    av = pytest.importorskip("av", reason="the extra video is not installed")
    assert film.write(tmp_path / "film.mp4", ".mp4", frames, 10) == 3
    with av.open(str(tmp_path / "film.mp4")) as container:
        decoded = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    assert len(decoded) == 3 + 15 and np.abs(decoded[2].astype(int) - frames[2]).mean() < 8


def test_an_episode_that_is_not_there_is_refused(recorded: tuple[Source, list[JournalEpisode]]) -> None:
    source, journal = recorded
    with pytest.raises(TreenailError, match="--episode: expected 0 to 1 of small, got 2"):
        film.entry_of(source, 2)
    unfinished = source._replace(episodes=iter([replace(journal[0], summary=None)]))
    with pytest.raises(TreenailError, match="expected episode 0 to be over"):
        film.entry_of(unfinished, 0)
