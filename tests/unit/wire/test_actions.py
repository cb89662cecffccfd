"""The action sets of the experiments."""

from __future__ import annotations

from typing import Literal

import pytest

from services.wire.actions import ACTION_NAMES, INSERT, Increment, action_names, increments
from services.wire.definition import Moves

SIZES: list[Literal[5, 9, 11]] = [5, 9, 11]


@pytest.mark.parametrize("actions", SIZES)
def test_every_action_has_one_increment(actions: Literal[5, 9, 11]) -> None:
    moves = Moves(actions=actions)
    assert len(increments(moves)) == len(action_names(moves)) == actions
    assert action_names(moves) == ACTION_NAMES[:actions]


@pytest.mark.parametrize("actions", SIZES)
def test_each_increment_is_what_its_name_says(actions: Literal[5, 9, 11]) -> None:
    moves = Moves(actions=actions, lateral_mm=0.1, insertion_mm=0.2, rotation_deg=0.3)
    fields = {"X": "dx_mm", "Y": "dy_mm", "Z": "dz_mm", "RX": "rx_deg", "RY": "ry_deg", "RZ": "rz_deg"}
    for name, increment in zip(action_names(moves), increments(moves), strict=True):
        axis = name[1:]
        size = 0.3 if axis.startswith("R") else 0.2 if axis == "Z" else 0.1
        expected = size if name[0] == "+" else -size
        assert increment == Increment(**{fields[axis]: expected}), name


def test_no_action_goes_back_out_of_the_hole() -> None:
    assert "-Z" not in ACTION_NAMES
    assert all(increment.dz_mm >= 0 for increment in increments(Moves(actions=11)))


def test_only_the_insertion_moves_along_z() -> None:
    along_z = [index for index, increment in enumerate(increments(Moves(actions=11))) if increment.dz_mm]
    assert along_z == [INSERT]
    assert ACTION_NAMES[INSERT] == "+Z"


def test_a_smaller_set_is_the_beginning_of_a_larger_one() -> None:
    assert increments(Moves(actions=11))[:9] == increments(Moves(actions=9))
    assert increments(Moves(actions=9))[:5] == increments(Moves(actions=5))
