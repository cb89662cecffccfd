"""What can go wrong between us and the controller. Each is a refusal, so that it is the answer to the motion."""

from __future__ import annotations

from services.rules.motions import ArmError


class LinkError(ArmError):
    """The motion was not made, or nobody knows; nothing but ``home`` is taken after it."""


class ControllerError(LinkError):
    """The controller refused a command."""


class ArrivalError(LinkError):
    """The arm is not where the motion leads to."""


class UnsettledError(LinkError):
    """It is not known how the controller takes O, A, T."""
