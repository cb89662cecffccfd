"""An arm whose TOOL is at the peg's tip, asked to turn about another point."""

from __future__ import annotations

import pytest

from services.rules.motions import GuardError, require_tool_at_tip
from services.wire.definition import Definition, Moves


def test_rotations_about_another_point_than_the_tip_are_refused() -> None:
    require_tool_at_tip(Definition(name="tip"))
    with pytest.raises(GuardError, match=r"moves\.rotation_centre_mm: expected 0, .* got 130\.0"):
        require_tool_at_tip(Definition(name="flange", moves=Moves(rotation_centre_mm=130.0)))
