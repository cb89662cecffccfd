"""What all parts of a definition are made of: their base, and numbers with their ranges."""

from __future__ import annotations

from typing import Annotated

from msgspec import Meta, Struct

NotNegative = Annotated[float, Meta(ge=0, le=1e6)]
Finite = Annotated[float, Meta(ge=-1e6, le=1e6)]
Fraction = Annotated[float, Meta(ge=0, le=1)]
OffsetMm = Annotated[float, Meta(ge=-20, le=20)]
AngleDeg = Annotated[float, Meta(ge=-20, le=20)]
StepSize = Annotated[float, Meta(gt=0, le=2)]
Bound = Annotated[float, Meta(ge=0, le=2)]
SignedStep = Annotated[float, Meta(ge=-2, le=2)]
Setting = bool | int | Finite | Annotated[str, Meta(max_length=1000)]


class Checked(Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Base of all parts of a definition: frozen, keyword-only, unknown keys refused."""
