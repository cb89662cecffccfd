"""What can go wrong with an arm of ROS 2. Each is a refusal, so that it is the answer to the motion."""

from __future__ import annotations

from services.rules.motions import ArmError


class MotionError(ArmError):
    """The arm cannot move, or the controller is not there."""


class ArrivalError(ArmError):
    """The arm is not where the motion leads to."""
