"""Recorded insertions repeat to the bit and mostly succeed; files of a real robot are read whole or refused by line."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import pytest

from experiments.lab.recordings import (
    FAILURES,
    DataError,
    Supervisor,
    cell,
    read_executions,
    read_failures,
    record,
)
from services.sim.pose import Pose
from services.wire.actions import ACTION_NAMES, INSERT

CELL = cell()
SAMPLE = "\t-1\t-1\t63\t-3\t-1\t0\n"
NORMAL = "normal\n" + 15 * SAMPLE


def test_a_recording_is_a_function_of_its_seed() -> None:
    once, again = record(CELL, 3, 90), record(CELL, 3, 90)
    assert once == again
    assert sum(len(one.samples) for one in once) == 90
    assert once[-1].outcome == "recording ended"
    assert record(CELL, 4, 90)[0] != once[0]


def test_the_beginning_does_not_depend_on_how_much_is_recorded() -> None:
    short, long = record(CELL, 0, 60), record(CELL, 0, 100)
    felt = [sample for one in long for sample in one.samples]
    assert [sample for one in short for sample in one.samples] == felt[:60]


def test_a_supervised_peg_goes_in_and_touches_on_its_way() -> None:
    done = record(CELL, 0, 150)
    whole = done[:-1]
    assert len(whole) >= 2
    assert {one.outcome for one in whole} == {"inserted"}
    truths = {sample.truth for one in done for sample in one.samples}
    assert len(truths) > 10
    assert {truth.split("-")[0] for truth in truths} >= {"chamfer", "bore", "mouth"}
    for one in done:
        for sample in one.samples:
            assert 0.3 <= math.hypot(*sample.force_n) < CELL.limits.collision_force_n


def test_the_supervisor_corrects_what_is_off() -> None:
    far = {
        "+X": Pose.from_tilt(-3, 0, 0),
        "-X": Pose.from_tilt(3, 0, 0),
        "+Y": Pose.from_tilt(0, -3, 0),
        "-Y": Pose.from_tilt(0, 3, 0),
        "+RX": Pose.from_tilt(0, 0, 0, rx_deg=-3),
        "-RX": Pose.from_tilt(0, 0, 0, rx_deg=3),
        "+RY": Pose.from_tilt(0, 0, 0, ry_deg=-3),
        "-RY": Pose.from_tilt(0, 0, 0, ry_deg=3),
    }
    supervisor = Supervisor(CELL, 0, 0)
    for name, pose in far.items():
        corrections = [ACTION_NAMES[action] for action in supervisor.corrections(pose)]
        assert name in corrections
        assert ("-" if name[0] == "+" else "+") + name[1:] not in corrections


def test_a_wary_supervisor_does_not_press() -> None:
    supervisor, off = Supervisor(CELL, 0, 0), Pose.from_tilt(3, 3, 0)
    firm = [supervisor.action(off, 6.0) for _ in range(400)]
    light = [supervisor.action(off, 1.0) for _ in range(400)]
    assert firm.count(INSERT) < 30 < 100 < light.count(INSERT)


def test_executions_are_read_with_their_labels(tmp_path: Path) -> None:
    path = tmp_path / "lp1.data"
    path.write_bytes((NORMAL + "\n\nfr_collision\n" + 14 * SAMPLE + "1 2.5 -3 4 5 6  \r\n\n").encode())
    normal, collision = read_executions(path)
    assert (normal.label, collision.label) == ("normal", "fr_collision")
    assert normal.samples == 15 * [(-1.0, -1.0, 63.0, -3.0, -1.0, 0.0)]
    assert collision.samples[-1] == (1.0, 2.5, -3.0, 4.0, 5.0, 6.0)


WRONG = {
    "": "expected executions, got an empty file",
    "\n \n": "expected executions, got an empty file",
    SAMPLE + NORMAL: ":1: expected the label of an execution first, got '-1 -1 63 -3 -1 0'",
    "normal\n1 2 3 4 5\n": ":2: expected 6 numbers (Fx Fy Fz Tx Ty Tz), got 5",
    "normal\n" + SAMPLE + "1 2 3 4 5 6 7\n": ":3: expected 6 numbers (Fx Fy Fz Tx Ty Tz), got 7",
    "normal\n1 2 nan 4 5 6\n": ":2: Fz: expected a number, such as -1.5, got 'nan'",
    "normal\n1 2 3 4 5 inf\n": ":2: Tz: expected a number, such as -1.5, got 'inf'",
    "normal\n1 2 3 4 fünf 6\n": ":2: Ty: expected a number, such as -1.5, got 'fünf'",
    "normal\nNaN\n": ":2: expected 6 numbers (Fx Fy Fz Tx Ty Tz), got 1",
    NORMAL + "normal\n" + 14 * SAMPLE: ":17: expected 15 samples of execution 'normal', got 14",
    NORMAL + SAMPLE + "ok\n" + 15 * SAMPLE: ":1: expected 15 samples of execution 'normal', got 16",
    "normal\nok\n" + 15 * SAMPLE: ":1: expected 15 samples of execution 'normal', got 0",
}


@pytest.mark.parametrize("content", WRONG)
def test_what_is_wrong_is_told_with_file_and_line(tmp_path: Path, content: str) -> None:
    path = tmp_path / "lp2.data"
    path.write_text(content, encoding="utf-8")
    with pytest.raises(DataError) as caught:
        read_executions(path)
    assert str(caught.value).startswith(str(path))
    assert str(caught.value).endswith(WRONG[content])
    assert "\n" not in str(caught.value)


def _nothing(path: Path) -> None:
    pass


def _binary(path: Path) -> None:
    path.write_bytes(b"\xff\xfe\x00normal")


@pytest.mark.parametrize(
    "make, complaint",
    [
        (_nothing, "expected a data file, got none"),
        (Path.mkdir, "cannot be read: Is a directory"),
        (_binary, "cannot be read: expected UTF-8 text: byte 0 is 0xff"),
    ],
)
def test_a_file_that_cannot_be_read_is_named(tmp_path: Path, make: Callable[[Path], None], complaint: str) -> None:
    path = tmp_path / "lp3.data"
    make(path)
    with pytest.raises(DataError) as caught:
        read_executions(path)
    assert str(caught.value) == f"{path}: {complaint}"


@pytest.mark.parametrize("below", [".", "robot_execution_failures"])
def test_the_data_set_may_lie_in_a_folder_of_its_own(tmp_path: Path, below: str) -> None:
    place = tmp_path / below
    place.mkdir(exist_ok=True)
    for name in FAILURES:
        (place / f"{name}.data").write_text(NORMAL, encoding="utf-8")
    assert {name: len(of) for name, of in read_failures(tmp_path).items()} == {"lp1": 1, "lp2": 1, "lp3": 1}
    (place / "lp2.data").unlink()
    with pytest.raises(DataError, match=r"lp2\.data: expected a data file, got none"):
        read_failures(tmp_path)
