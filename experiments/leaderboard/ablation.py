"""The learner with each of its parts left out: one row a part."""

from __future__ import annotations

from experiments.evaluate.controllers import RULES
from experiments.leaderboard.methods import METHODS, TABLE, TREENAIL, Method

TASKS = ("suite-round", "suite-square", "suite-noisy", "suite-stiff-wrist", "suite-round-fine")
"""Where they are left out, unless the command line says otherwise."""
_, Q_LEARNING, SOFTMAX = TABLE
NO_PRICE = "reward.force_per_n=0.0"
PARTS = (
    Method("torque as read", "torques refer to the sensor, not to where the definition says", "learn", plain=("felt",)),
    Method("torque at the tip", "torques refer to the tip", "learn", ('felt={torque="tip"}',)),
    Method("no help", "no potential is added to the rewards", "learn", plain=("shaping",)),
    Method("force no aim", "force costs nothing, the potential is a help all the same", "learn", (NO_PRICE,)),
    Method("nothing of force", "rewards of the moves alone", "learn", (NO_PRICE,), ("shaping",)),
    Method(
        "no model",
        "nothing but a table over contact states, with softmax",
        "learn",
        (Q_LEARNING, SOFTMAX, "shaping.gamma=0.95"),
    ),
    Method("no table", "nothing but the model of what a move earns at once", "learn", ("learner.follow=0.0",)),
    Method(
        "table for ever",
        "what follows counts as much at the end as at first",
        "learn",
        ("learner.follow_fade=0.0",),
    ),
    Method("free return", "to be back where it was costs nothing", "learn", ("learner.revisit=0.0",)),
    Method(
        "all that follows", "the table counts on all of what is thought to follow", "learn", ("learner.follow=1.0",)
    ),
    Method("no drawing", "always the best move known", "learn", ('policy={kind="greedy"}',)),
    Method(
        "drawing for ever",
        "what is drawn spreads as widely at the end as at first",
        "learn",
        ("policy.width_fade=0.0",),
    ),
    Method("forgetting", "what is long ago counts less", "learn", ("learner.drift=0.003",)),
    Method("coarse classes", "ART2's vigilance 0.8", "learn", ("classifier.rho=0.8",)),
)
"""What is left out. A part that a task's learner does not have is named on the page as one that cannot be left out."""


def methods() -> tuple[Method, ...]:
    """Return the whole learner, and it without each part; the rule beside them."""
    whole = [method for method in METHODS if method.name in (TREENAIL, *RULES)]
    return (whole[0], *PARTS, *whole[1:])
