"""``bench scale``: what many cells over regional routers send, and which part of the network is at its limit first.

Nothing is measured here and nothing is random: cells are dealt out to routers one after the other, as a launcher would
do, each sends what one cell was measured to send (docs/scaling.md), and every message is followed through the routers.

A region has routers, each of which holds some cells and the connections of their processes; one store of its own for
each router's cells; and a link to the centre, where the operators are. Operators listen to the episodes of all cells,
if they wish to heartbeats as well, and to everything of a few. A message that operators want crosses the link of its
region once for each of the centre's routers that has such an operator, however many operators there are behind it.

A *passage* is one message that a router takes in or hands out: what a router's processor is busy with.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Callable, Sequence
from typing import NamedTuple

from experiments.bench.values import Value
from services.bus.inbox import HEARTBEAT_S
from services.rules.command_line import number, whole
from services.wire.errors import TreenailError

WIRE_BYTES = 200
"""What a message takes on the wire beside its payload: 85 for Zenoh, the rest for TCP and IP with acknowledgements."""
HEARTS = 5
"""Services of a cell that beat: task, sim, classifier, agent, store."""


class Flow(NamedTuple):
    """Messages of one kind in a cell."""

    name: str
    per_decision: float
    payload_bytes: float
    """Of one message."""
    takes: int
    """How often a router takes it, or its answers, in."""
    hands: int
    """How often a router hands it, or its answers, out in the cell."""


FLOWS = (
    Flow("ft", 1.158, 124, 1, 1),
    Flow("observation", 1.0, 126, 1, 1),
    Flow("state", 1.0, 82, 1, 1),
    Flow("action", 1.0, 85, 1, 1),
    Flow("reward", 1.002, 78, 1, 1),
    Flow("move and home", 1.158, 96, 3, 3),
    Flow("sim/truth", 0.0, 197, 1, 0),
)
"""The loop: measured by ``bench fleet`` with chamfered-q-softmax. A query is question, answer and end of answers. The
true pose is not sent unless somebody listens."""


class Network(NamedTuple):
    """Cells, what they do, how they are spread, and what its parts can bear."""

    cells: int
    decisions_per_s: float
    """Of one cell."""
    decisions_per_episode: float
    regions: int
    routers: int
    """In each region."""
    operator_routers: int
    """Routers in the centre to which operators are connected."""
    operator_heartbeats: float
    """Heartbeats a second of each cell that operators listen to, of its 5; liveliness says who is here without any."""
    watched: int
    """Cells of which everything is listened to by one operator each."""
    ft_packets_per_s: float
    """Of a fast F/T sensor of each cell, 0 without."""
    ft_packet_bytes: float
    down: int
    """Routers of each region that are out of order; their cells have moved to the others."""
    episode_bytes: float
    journal_bytes: float
    """Of one decision in the journal's episode."""
    checkpoint_bytes: float
    """Of one worker; two of them, every 20 episodes."""
    heartbeat_bytes: float
    router_us: float
    """Processor time of a router for one passage."""
    store_us: float
    """Processor time of a store for one put."""
    share: float
    """How much of one core a router or store shall use at most, 0 to 1."""
    link_mbit_per_s: float
    """What a region's link to the centre can carry."""


class Load(NamedTuple):
    """Messages a second, and bytes a second on the wire."""

    messages: float = 0.0
    bytes: float = 0.0

    def plus(self, per_s: float, payload_bytes: float) -> Load:
        """Return the load with so many messages more."""
        return Load(self.messages + per_s, self.bytes + per_s * (payload_bytes + WIRE_BYTES))


class Place(NamedTuple):
    """One of a region's routers."""

    region: int
    router: int


class Loads(NamedTuple):
    """What every part of a network has to bear."""

    cells: dict[Place, int]
    routers: dict[Place, Load]
    """Passages."""
    stores: dict[Place, Load]
    """Puts."""
    links: dict[int, Load]
    """From each region to the centre."""
    centre: Load
    """Passages of one of the centre's routers."""


def spread_out(network: Network) -> dict[Place, int]:
    """Deal the cells out to regions and to the routers in them that work, and return how many each has."""
    working = network.routers - network.down
    cells = {Place(region, router): 0 for region in range(network.regions) for router in range(working)}
    for cell in range(network.cells):
        cells[Place(cell % network.regions, cell // network.regions % working)] += 1
    return cells


def loads(network: Network) -> Loads:
    """Follow the messages of every cell and return what each part has to bear."""
    cells = spread_out(network)
    watched = _deal_watched(network, cells)
    inside, puts = _in_cell(network), _puts(network)
    told, seen = _load_at_centre(network), _load_of_watching(network)
    copies = network.operator_routers
    routers, stores = {}, {}
    links = dict.fromkeys(range(network.regions), Load())
    for place, count in cells.items():
        out = _sum([_times(told, count * copies), _times(seen, watched[place])])
        routers[place] = _sum([_times(inside, count), out])
        stores[place] = _times(puts, count)
        links[place.region] = _sum([links[place.region], out])
    arriving = _sum([_times(told, network.cells), _times(seen, network.watched / max(1, copies))])
    centre = _times(arriving, 2.0)  # in, and out to the operator
    return Loads(cells, routers, stores, links, centre)


def report(network: Network) -> dict[str, Value]:
    """Return the rates of the busiest router, store and link, and which part is at its limit first."""
    all_loads = loads(network)
    router, store = max(all_loads.routers.values()), max(all_loads.stores.values())
    link = max(all_loads.links.values(), key=lambda load: load.bytes)
    use = {
        "regional router": router.messages * network.router_us / 1e6 / network.share,
        "store": store.messages * network.store_us / 1e6 / network.share,
        "link to the centre": 8 * link.bytes / 1e6 / network.link_mbit_per_s,
        "centre's router": all_loads.centre.messages * network.router_us / 1e6 / network.share,
    }
    first = max(use, key=lambda name: use[name])
    most = max(all_loads.cells.values())
    own = _in_cell(network)
    return {
        "cells": network.cells,
        "regions": network.regions,
        "routers_per_region": network.routers,
        "routers_down_per_region": network.down,
        "decisions_per_s_and_cell": network.decisions_per_s,
        "most_cells_on_a_router": most,
        "one_cell": {"passages_per_s": own.messages, "kbit_per_s": 8 * own.bytes / 1000},
        "all_cells": {
            "passages_per_s": sum(load.messages for load in all_loads.routers.values()),
            "puts_per_s": sum(load.messages for load in all_loads.stores.values()),
            "gbit_per_s": 8 * sum(load.bytes for load in all_loads.routers.values()) / 1e9,
        },
        "regional_router": _rates(router, "passages"),
        "store": _rates(store, "puts"),
        "store_gb_per_day": store.bytes * 86400 / 1e9,
        "link_to_the_centre": _rates(link, "messages"),
        "centre_router": _rates(all_loads.centre, "passages"),
        "use_percent": {name: 100 * value for name, value in use.items()},
        "fits": max(use.values()) <= 1.0,
        "first_at_its_limit": first,
        "cells_then": math.floor(network.cells / use[first]),
        "routers_needed_per_region": _routers_needed(network),
    }


def _routers_needed(network: Network) -> int:
    """Return how many routers a region needs that its routers and stores are not above their share."""
    here = math.ceil(network.cells / network.regions)
    per_cell_us = max(
        (_in_cell(network).messages + network.operator_routers * _load_at_centre(network).messages) * network.router_us,
        _puts(network).messages * network.store_us,
    )
    return max(1, math.ceil(here * per_cell_us / 1e6 / network.share)) + network.down


def _rates(load: Load, what: str) -> dict[str, Value]:
    return {f"{what}_per_s": load.messages, "mbit_per_s": 8 * load.bytes / 1e6}


def _in_cell(network: Network) -> Load:
    """Return the passages of one cell through its own router, operators not counted."""
    load = Load()
    for flow in FLOWS:
        load = load.plus(network.decisions_per_s * flow.per_decision * (flow.takes + flow.hands), flow.payload_bytes)
    episodes = network.decisions_per_s / network.decisions_per_episode
    load = load.plus(2 * episodes, network.episode_bytes)  # to the sim, which prints its progress
    load = load.plus(HEARTS / HEARTBEAT_S, network.heartbeat_bytes)
    load = load.plus(5 / HEARTBEAT_S, network.heartbeat_bytes)  # the task's to three, those of two workers to the task
    load = load.plus(2 * network.ft_packets_per_s, network.ft_packet_bytes)
    puts = _puts(network)
    return Load(load.messages + 2 * puts.messages, load.bytes + 2 * puts.bytes)


def _puts(network: Network) -> Load:
    """Return what one cell's store is given: each episode and checkpoint twice, by number and as the newest."""
    episodes = network.decisions_per_s / network.decisions_per_episode
    journal_bytes = network.journal_bytes * network.decisions_per_episode
    return Load().plus(2 * episodes, journal_bytes).plus(4 * episodes / 20, network.checkpoint_bytes)


def _load_at_centre(network: Network) -> Load:
    """Return what one of the centre's routers gets of each cell."""
    episodes = network.decisions_per_s / network.decisions_per_episode
    return Load().plus(episodes, network.episode_bytes).plus(network.operator_heartbeats, network.heartbeat_bytes)


def _load_of_watching(network: Network) -> Load:
    """Return what one operator gets, beside that, of a cell that he watches: all of the loop but the queries."""
    load = Load().plus(network.ft_packets_per_s, network.ft_packet_bytes)
    for flow in FLOWS:
        if flow.takes == 1:
            load = load.plus(network.decisions_per_s * flow.per_decision, flow.payload_bytes)
    return load


def _deal_watched(network: Network, cells: dict[Place, int]) -> Counter[Place]:
    """Deal the watched cells out to the routers that have cells, one after the other."""
    left, watched = network.watched, Counter[Place]()
    while left:
        for place, count in cells.items():
            if left and watched[place] < count:
                watched[place] += 1
                left -= 1
    return watched


def _times(load: Load, factor: float) -> Load:
    return Load(load.messages * factor, load.bytes * factor)


def _sum(parts: Sequence[Load]) -> Load:
    return Load(sum(part.messages for part in parts), sum(part.bytes for part in parts))


_COUNT, _AMOUNT = whole(0), number(0.0, 1e15)
_OPTIONS: tuple[tuple[str, Callable[[str], float], float, str], ...] = (
    ("cells", _COUNT, 10_000, "number of cells"),
    ("decisions-per-s", _AMOUNT, 2.0, "of one cell: a robot that moves makes some 2, a simulator at full speed 200"),
    ("decisions-per-episode", _AMOUNT, 100.0, "of one cell"),
    ("regions", _COUNT, 20, "regions, each with routers and stores"),
    ("routers", _COUNT, 3, "routers, and stores, in each region: with 2 of 3 the default still fits"),
    ("operator-routers", _COUNT, 2, "routers in the centre that operators are connected to"),
    ("operator-heartbeats", _AMOUNT, 0.0, "heartbeats a second of each cell that operators listen to, of its 5"),
    ("watched", _COUNT, 20, "cells of which an operator listens to everything"),
    ("ft-packets-per-s", _AMOUNT, 0.0, "of a fast F/T sensor of each cell through its router: 1000 for 8 kHz by 8"),
    ("ft-packet-bytes", _AMOUNT, 520.0, "payload of such a packet"),
    ("down", _COUNT, 0, "routers of each region that are out of order"),
    ("episode-bytes", _AMOUNT, 195.0, "payload of an episode's summary"),
    ("journal-bytes", _AMOUNT, 135.0, "payload of the journal for one decision"),
    ("checkpoint-bytes", _AMOUNT, 1400.0, "payload of a worker's checkpoint"),
    ("heartbeat-bytes", _AMOUNT, 300.0, "payload of a heartbeat"),
    ("router-us", _AMOUNT, 34.0, "processor time of a router for one message in or out [us]"),
    ("store-us", _AMOUNT, 1600.0, "processor time of a store for one put [us]"),
    ("share", _AMOUNT, 0.7, "how much of one core a router or a store shall use at most"),
    ("link-mbit-per-s", _AMOUNT, 1000.0, "what a region's link to the centre can carry"),
)

_ABOVE_0 = (
    *("cells", "regions", "routers", "decisions_per_s", "decisions_per_episode", "router_us", "share"),
    "link_mbit_per_s",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``bench scale``."""
    for name, kind, default, about in _OPTIONS:
        parser.add_argument(f"--{name}", type=kind, default=default, metavar="X", help=f"{about} (default: {default})")


def network(arguments: argparse.Namespace) -> Network:
    """Return the network that parsed arguments describe. Raises TreenailError for one that cannot be."""
    plan = Network(**{name: getattr(arguments, name) for name in Network._fields})
    for name in _ABOVE_0:
        _check(name, getattr(plan, name), getattr(plan, name) > 0, "more than 0")
    _check("down", plan.down, plan.down < plan.routers, f"less than the {plan.routers} routers of a region")
    _check("watched", plan.watched, plan.watched <= plan.cells, f"at most the {plan.cells} cells")
    _check("share", plan.share, plan.share <= 1, "at most 1")
    return plan


def _check(name: str, value: float, holds: bool, expected: str) -> None:
    if not holds:
        raise TreenailError(f"--{name.replace('_', '-')}: expected {expected}, got {value:g}")
