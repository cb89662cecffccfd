"""The learner with each of its parts left out: one row a part."""

from __future__ import annotations

from experiments.leaderboard.methods import METHODS, RULE, TREENAIL, Method

TASKS = ("suite-round", "suite-square", "suite-noisy", "suite-stiff-wrist", "suite-chamferless")
"""Where they are left out, unless the command line says otherwise."""
PARTS = (
    ("constant exploration", "softmax that does not become greedier", ("policy.beta_per_episode=0.0",)),
    ("coarse classes", "ART2's vigilance 0.90", ("classifier.rho=0.90",)),
    ("torque of force's weight", "ART2 hears torque at 30 per metre", ("classifier.torque_gain_per_m=30.0",)),
    ("SARSA", "learns from what it does, not from the best", ("learner.kind=sarsa",)),
)
"""What is left out, in words, and the overrides that leave it out."""


def methods() -> tuple[Method, ...]:
    """Return the whole learner, and it without each part; the rule beside them."""
    whole = [method for method in METHODS if method.name in (TREENAIL, RULE)]
    parts = [Method(name, about, "learn", overrides) for name, about, overrides in PARTS]
    return (whole[0], *parts, *whole[1:])
