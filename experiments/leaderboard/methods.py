"""What the leaderboard holds against each other: one row a method, a controller or overrides of the definition."""

from __future__ import annotations

from typing import Literal, NamedTuple

import msgspec

from services.wire.definition import Art2Settings, Definition, InsertionReward, QLearning, Softmax
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


TABLE = (
    'classifier={kind="art2", rho=0.95}',
    'learner={kind="q_learning"}',
    'policy={kind="softmax", beta=1.0, beta_per_episode=0.05}',
    'reward={kind="insertion"}',
)
"""The thesis's learner, whatever a task comes with: ART2 on the torque as read, a table, softmax."""

RULE, TREENAIL = "rule", "treenail"
METHODS = (
    Method(TREENAIL, "the learner that the task's definition comes with", "learn"),
    Method("table", "the thesis's learner: ART2 on the torque as read, Q-learning, softmax", "learn", TABLE),
    Method(RULE, "a hand-written compliance rule: give way to force and torque, else step in +Z", "play"),
    Method("spiral", "the rule with a search in a spiral where it is pressed on a flat face", "play"),
    Method("random", "any move, each as likely", "play"),
    Method(
        "oracle", "the least force that a search finds which knows the pose, without noise, one start a seed", "oracle"
    ),
)
"""To add a method, add its row."""


def methods(names: list[str] | None) -> tuple[Method, ...]:
    """Return the methods of these names, the rule always among them; all for None. Raises TreenailError."""
    by_name = {method.name: method for method in METHODS}
    for name in names or ():
        if name not in by_name:
            raise TreenailError(f"--methods: expected some of {', '.join(by_name)}, got {name!r}")
    wanted = by_name if names is None else {*names, RULE}
    return tuple(method for method in METHODS if method.name in wanted)


def variant(definition: Definition, overrides: tuple[str, ...], what: str) -> Definition:
    """Return a definition with overrides; ``what`` names it in errors. Raises DefinitionError."""
    if not overrides:
        return definition
    return with_overrides(msgspec.to_builtins(definition), overrides, what)


def task_alone(definition: Definition) -> Definition:
    """Return a definition without what only a learner reads: who does not learn is the same beside any learner."""
    return msgspec.structs.replace(
        definition,
        classifier=Art2Settings(),
        learner=QLearning(),
        policy=Softmax(),
        reward=InsertionReward(),
        episodes=1,
    )
