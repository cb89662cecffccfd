"""The way to ROS 2: by the cell's own router, or by one of ROS's."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import zenoh

from services.bus.opening import Opening
from services.bus.service import Service
from services.bus.session import open_client
from services.ros2.messages import Messages
from services.ros2.names import word
from services.ros2.node import Node
from services.ros2.settings import Graph
from services.rules.settings import SettingError
from services.wire.errors import CellError

_TRY_S = 2.0
"""How long one attempt to reach a router may take."""


@contextmanager
def node_with(service: Service, graph: Graph, part: str = "") -> Iterator[Node | None]:
    """Have a node of ROS 2 that is named after the cell and ``part``; otherwise as ``_session_with``."""
    with _session_with(service, graph) as session:
        name = f"treenail_{word(service.keys.cell)}{part}"
        yield None if session is None else Node(session, graph.domain, name, Messages(graph.chosen))


@contextmanager
def _session_with(service: Service, graph: Graph) -> Iterator[zenoh.Session | None]:
    """Have a session with ROS's router, waiting for it, saying loudly that it is missing; None when stopped before.

    Raises SettingError for a secured cell whose own router is meant: it carries nothing but the cell's keys.
    """
    if graph.ros is None:
        if service.options.certs is not None:
            raise SettingError(
                "--ros: expected the endpoint of ROS's own router, as tcp/127.0.0.1:7448: that of a cell with "
                "certificates carries nothing of ROS 2"
            )
        yield service.session
        return
    session = _open(service, graph.ros)
    try:
        yield session
    finally:
        if session is not None:
            _close(session)


def _open(service: Service, endpoint: str) -> zenoh.Session | None:
    while not service.stopping:
        opening = Opening(lambda: open_client((endpoint,), _TRY_S), _close)
        service.phase = f"waiting for ROS's router at {endpoint}"[:200]
        while not (opening.done or service.stopping):
            service.work(_TRY_S / 20.0)
        if not opening.done:
            opening.abandon()
            break
        try:
            return opening.result()
        except CellError as error:
            service.complain(f"ROS 2: {error}; is `ros2 run rmw_zenoh_cpp rmw_zenohd` running?", topic="ros")
            service.work_until(lambda: False, _TRY_S / 4.0)
    return None


def _close(session: zenoh.Session) -> None:
    session.close()  # type: ignore[no-untyped-call]
