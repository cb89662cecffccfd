"""What can be wrong with a box. Trying again may help."""

from __future__ import annotations

from services.wire.errors import TreenailError


class BoxError(TreenailError):
    """The box cannot be used now."""


class SilentError(BoxError):
    """No records come."""


class CalibrationError(BoxError):
    """It is not known what a count is worth."""


class RebootedError(BoxError):
    """The box, or its stream, began anew by itself."""
