"""The transition tables: what the page draws is what the machines run by."""

from __future__ import annotations

from pathlib import Path

import pytest

from services.robot_link.ddcmp import events as ddcmp
from services.robot_link.ddcmp.line import Ddcmp
from services.robot_link.machine import diagram, following, page
from services.robot_link.val2 import states as val2
from services.robot_link.val2.dialects import DIALECTS
from services.robot_link.val2.terminal import Terminal

PAGE = Path(__file__).parents[3] / "docs" / "state_machines.md"


def test_the_page_is_up_to_date() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "python -m services.robot_link.machine > docs/state_machines.md"


def test_every_state_can_be_reached_and_left() -> None:
    for table, states in ((val2.TRANSITIONS, val2.State), (ddcmp.TRANSITIONS, ddcmp.State)):
        assert {before for before, _ in table} == set(states)
        assert set(table.values()) | {val2.State.DOWN} >= set(states)


def test_what_is_not_in_the_table_cannot_be() -> None:
    with pytest.raises(ValueError, match="down: expected one of start, garbage, silence, got echo complete"):
        following(val2.TRANSITIONS, val2.State.DOWN, val2.What.ECHOED)


def test_a_diagram_has_one_line_for_each_way() -> None:
    table = {
        (val2.State.DOWN, val2.What.STARTED): val2.State.IDLE,
        (val2.State.DOWN, val2.What.ASKED): val2.State.IDLE,
    }
    assert diagram(table, val2.State.DOWN).splitlines()[2:4] == [
        "    [*] --> DOWN",
        "    DOWN --> IDLE: start, command",
    ]


def test_the_machines_begin_where_the_page_says() -> None:
    assert Terminal(DIALECTS["val2"]).state is val2.State.DOWN
    assert Ddcmp().state is ddcmp.State.HALTED
