"""The force guard beside the robot: refuses a motion before it is made, and needs no learner to be alive."""

from __future__ import annotations

from services.wire.definition import Definition
from services.wire.messages import Move

_ROUNDING = 1e-9


class Guard:
    """Step limits of the experiment's action set and a hard limit on the force felt last."""

    def __init__(self, definition: Definition) -> None:
        moves = definition.moves
        turn_z = moves.rotation_deg if moves.actions == 11 else 0.0
        turn = moves.rotation_deg if moves.actions >= 9 else 0.0
        self._limits = {
            "dx_mm": (-moves.lateral_mm, moves.lateral_mm),
            "dy_mm": (-moves.lateral_mm, moves.lateral_mm),
            "dz_mm": (0.0, moves.insertion_mm),
            "rx_deg": (-turn, turn),
            "ry_deg": (-turn, turn),
            "rz_deg": (-turn_z, turn_z),
        }
        self._hard_force_n = definition.limits.hard_force_n

    def complaint(self, move: Move, force_n: float) -> str | None:
        """Return why a motion is refused, or None. ``force_n``: magnitude felt last, in newtons."""
        if not force_n <= self._hard_force_n:  # a force that is no number never passes
            limit = f"the hard limit of {self._hard_force_n} N"
            return f"guard: force is {force_n:.2f} N, above {limit}; only home is taken"
        for name, (low, high) in self._limits.items():
            value = getattr(move, name)
            if not low - _ROUNDING <= value <= high + _ROUNDING:
                return f"guard: {name}: expected {low} to {high}, got {value}"
        return None
