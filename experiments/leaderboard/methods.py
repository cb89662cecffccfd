"""What the leaderboard holds against each other: one row a method, a controller or overrides of the definition."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, NamedTuple

import msgspec

from experiments.evaluate.controllers import BASELINES, PUSH, RULE, RULES, TIP_RULE
from services.rules.shipped_skill import for_task, named_or_file
from services.rules.skill import NamedSkill
from services.wire.definition import Definition
from services.wire.definition_file import with_overrides
from services.wire.errors import DefinitionError, TreenailError

Kind = Literal["learn", "play", "frozen", "oracle", "taught"]
"""Learns from nothing; is played by a controller; is a skill that learns no more; is searched for; is a controller that
was taught before the first insertion."""


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

TREENAIL, ORACLE = "treenail", "oracle"
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
        ORACLE, "the least force that a search finds which knows the pose, without noise, one start a seed", "oracle"
    ),
)
"""To add a method, add its row."""


def _som(name: str, more: str = "") -> str:
    """Return the override that makes a map the classifier."""
    return f'classifier={{kind="plugin", name="{name}", settings={{torque_gain_per_m=30.0{more}}}}}'


PROPOSES = (
    'classifier={kind="none"}',
    'learner={kind="plugin", name="srv"}',
    'policy={kind="greedy"}',
    "moves.continuous={x_mm=0.2, y_mm=0.2, z_mm=0.2, rx_deg=0.2, ry_deg=0.2, rz_deg=0.2}",
)
SPRING = ("wrist.stiffness_n_per_mm=7.0", "wrist.stiffness_nm_per_rad=53.0", "wrist.sensor_height_mm=0.0")
"""A device whose centre of compliance is at the tip: K_x = 7 N/mm and K_theta = 53 000 N mm/rad are those of Whitney's
experiments (Quasi-static assembly of compliantly supported rigid parts, J. Dyn. Sys. Meas. Control 104, 1982)."""
TABULAR = (
    'learner={kind="q_learning"}',
    'policy={kind="softmax", beta=1.0, beta_per_episode=0.05}',
    "shaping.gamma=0.95",
)
"""Q-learning and softmax, beside the task's own rewards and reference of the torque."""
SWITCH = (
    'classifier={kind="plugin", name="fuzzy-art", settings={rho=0.7}}',
    'learner={kind="plugin", name="art-r"}',
    'policy={kind="softmax", beta=1.0, beta_per_episode=0.0}',
)
ART1 = 'classifier={kind="plugin", name="art1", settings={rho=0.85, torque_gain_per_m=30.0}}'
RIVALS = (
    Method("srv", "Gullapalli's SRV units, which propose moves by the reward alone; told nothing", "learn", PROPOSES),
    Method(PUSH, "a remote centre compliance and steps of +Z, no controller; told nothing", "play", SPRING),
    Method("asada", "Asada: a perceptron, taught by an operator who sees the task", "taught"),
    Method("howarth", "Howarth: a perceptron on four components and axes, taught by the rule `rule-tip`", "taught"),
    Method("artmap", "Lopez-Juarez: Fuzzy ARTMAP over a primitive knowledge base", "taught"),
    Method("art-normals", "Brignone: Fuzzy ART over the normals of the hole's surfaces", "taught"),
    Method("som", "Cervera: a self-organising map of the torques, Q-learning", "learn", (_som("som"), *TABULAR)),
    Method(
        "som-position",
        "Cervera: the same map, beside where the peg was moved to",
        "learn",
        (_som("som-position", ", cell_steps=10"), *TABULAR),
    ),
    Method("art-r", "Brignone: Fuzzy ART, and stochastic units taught by the reward of each move", "learn", SWITCH),
    Method(
        "art1", "the thesis's own idea for later (7.4.5): ART1 on coarse inputs, Q-learning", "learn", (ART1, *TABULAR)
    ),
)
"""The controllers of the thesis's chapter 2: on a board only where they are named, and all on that of rivals."""


def methods(names: list[str] | None) -> tuple[Method, ...]:
    """Return the methods of these names, the rules always among them; all of ``METHODS`` for None.

    Raises TreenailError.
    """
    every = (*METHODS, *RIVALS)
    by_name = {method.name: method for method in every}
    for name in names or ():
        if name not in by_name:
            raise TreenailError(f"--methods: expected some of {', '.join(by_name)}, got {name!r}")
    return METHODS if names is None else tuple(method for method in every if method.name in {*names, *RULES})


def beginning_with(what: str) -> Method:
    """Return the method that learns on from a skill, the shipped one by its name or a file's. Raises SkillError."""
    skill, path = named_or_file(what), Path(what)
    learnt = f"{skill.skill.definition.name}, {skill.skill.episodes} episodes"
    about = f"the task's learner, beginning with {path.name}: {learnt}"
    return Method(f"with {path.stem}", about, "learn", skill=skill)


def changed(definition: Definition, method: Method) -> Definition:
    """Return a task's definition as a method has it. Raises DefinitionError, also where it is so without the method."""
    what = f"{definition.name}, {method.name}"
    made = variant(definition, method.overrides, what, method.plain)
    if made == definition and (method.overrides or method.plain):
        raise DefinitionError(f"{what}: expected a task that it changes something of, got one that is so already")
    return made


def learnt_before(definition: Definition, method: Method) -> NamedSkill | None:
    """Return the skill that a method begins a task with, which has it as ``changed``; None for nothing.

    Raises SkillError when it does not fit.
    """
    return None if method.skill is None else for_task(method.skill, definition)


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
