"""What the leaderboard holds against each other: one row a method, a controller or overrides of the definition."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, NamedTuple

import msgspec

from experiments.evaluate.controllers import BASELINES, RULE, RULES, TIP_RULE
from services.rules import skill as skill_file
from services.rules.skill import NamedSkill
from services.wire.definition import Definition
from services.wire.definition_file import with_overrides
from services.wire.errors import TreenailError

Kind = Literal["learn", "play", "frozen", "oracle"]
"""Learns from nothing; is played by a controller; is a skill that learns no more; is searched for."""


class Method(NamedTuple):
    """One row."""

    name: str
    about: str
    kind: Kind
    overrides: tuple[str, ...] = ()
    """What a method that learns changes of a task's definition, as ``--set`` does."""
    plain: tuple[str, ...] = ()
    """Tables of the definition that are as by default first, whatever the task has there."""
    skill: NamedSkill | None = None
    """What a method that learns begins with."""


LEARNERS_OWN = ("classifier", "felt", "learner", "policy", "reward", "shaping")
"""Tables of a definition that only who learns reads."""
TABLE = (
    'classifier={kind="art2", rho=0.95}',
    'learner={kind="q_learning"}',
    'policy={kind="softmax", beta=1.0, beta_per_episode=0.05}',
)
"""The thesis's learner: ART2 on the torque as read, a table, softmax, rewards of the moves alone."""

TREENAIL = "treenail"
METHODS = (
    Method(TREENAIL, "the learner that the task's definition comes with", "learn"),
    Method(
        "table", "the thesis's learner: ART2 on the torque as read, Q-learning, softmax", "learn", TABLE, LEARNERS_OWN
    ),
    Method(RULE, BASELINES[RULE], "play"),
    Method(TIP_RULE, BASELINES[TIP_RULE], "play"),
    Method("spiral", "the rule with a search in a spiral where it is pressed on a flat face", "play"),
    Method("random", "any move, each as likely", "play"),
    Method(
        "oracle", "the least force that a search finds which knows the pose, without noise, one start a seed", "oracle"
    ),
)
"""To add a method, add its row."""


def methods(names: list[str] | None) -> tuple[Method, ...]:
    """Return the methods of these names, the rules always among them; all for None. Raises TreenailError."""
    by_name = {method.name: method for method in METHODS}
    for name in names or ():
        if name not in by_name:
            raise TreenailError(f"--methods: expected some of {', '.join(by_name)}, got {name!r}")
    wanted = by_name if names is None else {*names, *RULES}
    return tuple(method for method in METHODS if method.name in wanted)


def beginning_with(path: Path) -> Method:
    """Return the method that learns on from a skill's file. Raises SkillError."""
    skill = skill_file.read(path)
    learnt = f"{skill.skill.definition.name}, {skill.skill.episodes} episodes"
    about = f"the task's learner, beginning with {path.name}: {learnt}"
    return Method(f"with {path.stem}", about, "learn", skill=skill)


def changed(definition: Definition, method: Method) -> Definition:
    """Return a task's definition as a method has it. Raises DefinitionError, SkillError when its skill does not fit."""
    made = variant(definition, method.overrides, f"{definition.name}, {method.name}", method.plain)
    if method.skill is not None:
        skill_file.fits(method.skill.skill, made)
    return made


def variant(definition: Definition, overrides: tuple[str, ...], what: str, plain: tuple[str, ...] = ()) -> Definition:
    """Return a definition with some tables as by default and with overrides; ``what`` names it in errors.

    Raises DefinitionError.
    """
    if not overrides and not plain:
        return definition
    fields = {name: value for name, value in msgspec.to_builtins(definition).items() if name not in plain}
    return with_overrides(fields, overrides, what)


def task_alone(definition: Definition) -> Definition:
    """Return a definition without what only a learner reads: who does not learn is the same beside any learner."""
    return variant(definition, ("episodes=1",), definition.name, LEARNERS_OWN)
