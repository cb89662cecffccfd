"""What can go wrong between us and the controller. Each is a refusal, so that it is the answer to the motion."""

from __future__ import annotations

from services.rules.motions import ArmError


class LostError(ArmError):
    """The controller does not answer, or its clock is another one."""


class StateError(ArmError):
    """A person or a safety device stopped the arm, or it is not ready to move."""


class ArrivalError(ArmError):
    """The arm is not where the motion leads to."""


class PayloadError(ArmError):
    """Payload or tool are not those that were said."""
