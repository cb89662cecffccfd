"""``bench scale``: cells are dealt out evenly, every message is counted, and the first limit is found."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.bench.__main__ import main
from experiments.bench.message_rates import FLOWS, Network, Place, add_arguments, loads, network, report, spread_out
from services.wire.errors import TreenailError


def planned(**changes: float) -> Network:
    """Return the network of the defaults, changed."""
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    words = [word for name, value in changes.items() for word in (f"--{name.replace('_', '-')}", str(value))]
    return network(parser.parse_args(words))


@given(st.integers(1, 300), st.integers(1, 7), st.integers(1, 5), st.integers(0, 4))
def test_every_cell_has_one_router_and_none_has_two_cells_more_than_another(
    cells: int, regions: int, routers: int, down: int
) -> None:
    down = min(down, routers - 1)
    found = spread_out(planned(cells=cells, regions=regions, routers=routers, down=down, watched=0))
    assert sum(found.values()) == cells
    assert len(found) == regions * (routers - down)
    by_region = [sum(found[Place(region, one)] for one in range(routers - down)) for region in range(regions)]
    assert max(by_region) - min(by_region) <= 1
    assert max(found.values()) - min(found.values()) <= 1


def test_the_passages_of_one_cell_are_those_counted_by_hand() -> None:
    alone = planned(
        cells=1, regions=1, routers=1, watched=0, operator_routers=0, decisions_per_s=10, decisions_per_episode=100
    )
    # A tenth of an episode a second: its summary in and out, two journal entries and a fifth of a checkpoint put;
    # five heartbeats in, five out.
    loop = 10 * sum(flow.per_decision * (flow.takes + flow.hands) for flow in FLOWS)
    assert loads(alone).routers[Place(0, 0)].messages == pytest.approx(loop + 0.2 + 2 * 0.1 * 2.2 + 10)
    assert loads(alone).stores[Place(0, 0)].messages == pytest.approx(0.1 * 2.2)


def test_nothing_gets_lost_between_regions_and_centre() -> None:
    plan = planned(cells=103, regions=4, routers=3, operator_routers=1, watched=17, operator_heartbeats=5)
    found = loads(plan)
    sent = sum(link.messages for link in found.links.values())
    assert found.centre.messages == pytest.approx(2 * sent), "taken in once, handed out once"
    # What goes out to the centre is all that a router has more than the cells of its own.
    inside = loads(plan._replace(operator_routers=0, watched=0))
    assert sum(one.messages for one in found.routers.values()) == pytest.approx(
        sum(one.messages for one in inside.routers.values()) + sent
    )


def test_twice_the_cells_are_twice_the_load_and_half_the_routers_too() -> None:
    plan = planned(cells=400, regions=2, routers=4, watched=0)
    once, twice, fewer = (
        report(one)["regional_router"] for one in (plan, plan._replace(cells=800), plan._replace(routers=2))
    )
    assert isinstance(once, Mapping)
    assert isinstance(twice, Mapping)
    assert twice["passages_per_s"] == pytest.approx(2 * float(str(once["passages_per_s"])))
    assert fewer == twice


def test_a_router_that_is_down_leaves_its_cells_to_the_others() -> None:
    plan = planned(cells=400, regions=2, routers=4, watched=0)
    assert report(plan)["most_cells_on_a_router"] == 50
    assert report(plan._replace(down=1))["most_cells_on_a_router"] == 67
    assert max(loads(plan._replace(down=1)).routers) == Place(1, 2)


@pytest.mark.parametrize(
    ("changes", "first"),
    [
        ({"routers": 1, "regions": 1}, "regional router"),
        ({"store_us": 1e6}, "store"),
        ({"link_mbit_per_s": 0.01}, "link to the centre"),
        ({"operator_heartbeats": 5}, "centre's router"),
    ],
)
def test_the_part_that_is_at_its_limit_first_is_named(changes: dict[str, float], first: str) -> None:
    plan = planned(**changes)
    found: dict[str, Any] = dict(report(plan))
    assert found["first_at_its_limit"] == first
    assert found["fits"] is False
    assert found["cells_then"] < plan.cells
    assert max(found["use_percent"], key=lambda name: found["use_percent"][name]) == first


def test_so_many_routers_as_are_said_to_be_needed_are_enough_and_one_less_is_not() -> None:
    plan = planned(cells=10_000, regions=3, watched=0)
    needed = report(plan)["routers_needed_per_region"]
    assert isinstance(needed, int)
    assert needed > 1
    for routers, enough in ((needed, True), (needed - 1, False)):
        use = report(plan._replace(routers=routers))["use_percent"]
        assert isinstance(use, Mapping)
        assert (float(str(use["regional router"])) <= 101.0) is enough, "a cell is not divided between two routers"


def test_the_same_question_has_the_same_answer(capsys: pytest.CaptureFixture[str]) -> None:
    answers = []
    for _ in range(2):
        assert main(["scale", "--cells", "10000", "--json"]) == 0
        answers.append(json.loads(capsys.readouterr().out)["results"])
    assert answers[0] == answers[1]
    assert answers[0]["cells"] == 10_000
    assert answers[0]["fits"] is True


@pytest.mark.parametrize(
    ("option", "value"),
    [("cells", 0), ("down", 3), ("watched", 10_001), ("share", 1.5)],
)
def test_a_network_that_cannot_be_is_one_line(option: str, value: object, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["scale", f"--{option}={value}"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"--{option}: expected" in line


def test_an_amount_below_nothing_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["scale", "--router-us=-1"])
    (line,) = capsys.readouterr().err.splitlines()
    assert end.value.code == 2 and "--router-us: expected from 0 to 1e+15, got '-1'" in line


def test_a_network_is_checked_by_name() -> None:
    with pytest.raises(TreenailError, match="--regions: expected more than 0, got 0"):
        planned(regions=0)
