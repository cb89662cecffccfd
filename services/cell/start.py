"""Starting the services of a planned cell."""

from __future__ import annotations

import time
from collections.abc import Callable

from services.bus.access import OPERATOR
from services.bus.service import Options
from services.cell import hil
from services.cell.client import Client
from services.cell.plan import Plan
from services.cell.skill_transfer import give
from services.cell.supervisor import Supervisor
from services.wire.definition_file import find
from services.wire.errors import CellError

STORE_WITHIN_S = 60.0
"""How long router and store get to start and to keep the skill."""


def start_services(plan: Plan, supervisor: Supervisor, mind: Callable[[], None]) -> None:
    """Start all that a planned cell needs; ``mind`` is called while waiting for router and store."""
    arguments = plan.arguments
    cell = ("--cell", arguments.cell, "--connect", plan.endpoint)
    experiment = find(arguments.experiment)
    overrides = [word for item in plan.overrides for word in ("--set", item)]
    length = ("--seed", str(arguments.seed), "--episodes", str(plan.episodes))
    supervisor.start("router", "--listen", plan.endpoint)
    supervisor.start("store", *cell, "--file", str(plan.out / "store.sqlite"))
    if plan.skill is not None:
        with client_of(plan, mind) as client:
            give(client, plan.skill, mind, STORE_WITHIN_S)
    planned = [word for item in arguments.swap for word in ("--swap", item)]
    supervisor.start("task", *cell, "--experiment", str(experiment.resolve()), *overrides, *length, *planned)
    for name in ("classifier", "agent"):
        supervisor.start(name, *cell)
    if arguments.profile == "hil":
        hil.start(supervisor, arguments, plan.endpoint, plan.definition.sensor)
    else:
        supervisor.start("sim", *cell)
    if plan.viewer is not None:
        save = () if arguments.save is None else ("--save", str(arguments.save))
        supervisor.start("viewer", *cell, *plan.viewer.options, *save)


def client_of(plan: Plan, mind: Callable[[], None]) -> Client:
    """Return a client of the router that was just started, minding the processes meanwhile."""
    deadline = time.monotonic() + 30.0
    certs = plan.arguments.certs and plan.arguments.certs / OPERATOR
    while True:
        mind()
        try:
            return Client(Options(plan.arguments.cell, (plan.endpoint,), connect_timeout_s=0.5, certs=certs))
        except CellError:
            if time.monotonic() > deadline:
                raise
