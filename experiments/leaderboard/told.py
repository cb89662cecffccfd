"""What each method of a board was told beside what it feels: by a teacher, of the shape, of the pose."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from experiments.evaluate.controllers import PUSH, RANDOM, RULE, SPIRAL, TIP_RULE
from experiments.leaderboard.methods import ORACLE, TREENAIL, Method
from experiments.rivals.networks import USUAL
from experiments.rivals.teachers import ASTRAY

NOTHING = "nothing"
BY_HAND = "written by hand"
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
    TREENAIL: Told(REWARD, SENSOR, NOTHING),
    "table": Told("rewards of the moves alone", NOTHING, NOTHING),
    RULE: Told(BY_HAND, SENSOR, NOTHING),
    TIP_RULE: Told(BY_HAND, SENSOR, NOTHING),
    SPIRAL: Told(BY_HAND, SENSOR, NOTHING),
    RANDOM: Told(NOTHING, NOTHING, NOTHING),
    ORACLE: Told("none: it searches in a model of the task", "all of it", "the true pose"),
    PUSH: Told(
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


def told(method: Method) -> Told:
    """Return what a method was told; a learner that has no row of its own is Treenail's with other settings.

    What it begins with was learnt on another task by rewards, too.
    """
    own = TOLD.get(method.name)
    if own is not None:
        return own
    if method.kind not in ("learn", "frozen"):
        raise KeyError(f"experiments/leaderboard/told.py: expected a row of {method.name}, got none")
    usual = TOLD[TREENAIL]
    if method.skill is None:
        return usual
    learnt = method.skill.skill
    return usual._replace(
        supervision=f"{usual.supervision}, before also on {learnt.definition.name}, {learnt.episodes} episodes"
    )
