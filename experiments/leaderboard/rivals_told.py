"""What each method of the rivals' board was told beside what it feels: by a teacher, of the shape, of the pose."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from experiments.rivals.networks import USUAL
from experiments.rivals.teachers import ASTRAY

NOTHING = "nothing"
NO_TEACHER = "no teacher"
REWARD = "rewards only"
SENSOR = "where the sensor sits"


class Told(NamedTuple):
    """One method's knowledge that it did not feel its way to."""

    supervision: str
    geometry: str
    pose: str
    differs: str = ""
    """How it differs from what was published, as far as the thesis tells."""


_SHOWN = f"{USUAL.insertions} insertions, pushed astray in {round(100 * ASTRAY)} % of the decisions"
TOLD: Mapping[str, Told] = {
    "treenail": Told(REWARD, SENSOR, NOTHING),
    "table": Told("rewards of the moves alone", NOTHING, NOTHING),
    "rule": Told("written by hand", SENSOR, NOTHING),
    "rule-tip": Told("written by hand", SENSOR, NOTHING),
    "rcc": Told(
        "none: it is a spring",
        "its centre is at the tip",
        NOTHING,
        "its wrist is another than all others have, so that its forces are felt through a softer spring",
    ),
    "srv": Told(
        REWARD,
        SENSOR,
        NOTHING,
        "Gullapalli's had the position error to the hole in its reward, and peg position as an input: here neither",
    ),
    "asada": Told(
        f"a move for each load, by an operator who sees pose, shape and clearance: {_SHOWN}",
        SENSOR,
        "to the teacher: the true pose",
        "moves from the task's list in place of velocities; the operator is a search one move ahead, not a person",
    ),
    "howarth": Told(
        f"a move for each load, by the rule `rule-tip`: {_SHOWN}",
        SENSOR,
        NOTHING,
        "the pairs come from a rule, not from a person",
    ),
    "artmap": Told(
        "a knowledge base of loads with their moves, written by hand",
        SENSOR,
        NOTHING,
        "the knowledge base is ours, as in principle described: each load along an axis is given way to",
    ),
    "art-normals": Told(
        "a move for each surface, written by hand",
        "the shape, and whether there is a chamfer",
        NOTHING,
        "translations only: the thesis gives rotations to ART-R",
    ),
    "som": Told(REWARD, SENSOR, NOTHING, "the map orders itself as it goes; Cervera's had seen 70 000 vectors before"),
    "som-position": Told(
        REWARD,
        SENSOR,
        "the moves commanded since the episode began",
        "as `som`; relative position is counted from commands, Cervera's was read from the arm's encoders",
    ),
    "art-r": Told(
        REWARD,
        SENSOR,
        NOTHING,
        "all moves, not rotations only; it learns while it inserts, Brignone's had a training rig before",
    ),
    "art1": Told(REWARD, SENSOR, NOTHING, "not published: the thesis proposes it"),
}
"""By method. *Where the sensor sits* is the lever that the task's definition refers torques by."""
