"""The services of a planned cell, each with its command line."""

from __future__ import annotations

from collections.abc import Mapping

from services.cell.plan import Plan
from services.cell.ros2 import OUT

TOGETHER = "together"
"""The program in which several services stand."""
PARTS = ("task", "classifier", "agent", "sim")
"""Those."""
Commands = dict[str, tuple[str, ...]]
"""Options by service, in the order in which the services are started."""


def commands(plan: Plan, endpoints: Mapping[str, str] | None = None) -> Commands:
    """Return the services of a plan with their options, in the order of starting.

    ``endpoints`` names another router for some of them.
    """
    elsewhere = endpoints or {}

    def where(service: str) -> tuple[str, ...]:
        return ("--cell", plan.cell, "--connect", elsewhere.get(service, plan.endpoint))

    overrides = [word for item in plan.overrides for word in ("--set", item)]
    swaps = [word for item in plan.swaps for word in ("--swap", item)]
    length = ("--seed", str(plan.seed), "--episodes", str(plan.episodes))
    services: Commands = {
        "router": ("--listen", plan.endpoint, *(() if plan.ros2 is None else plan.ros2.of_router)),
        "store": (*where("store"), "--file", str(plan.out / "store.sqlite")),
        "task": (*where("task"), "--experiment", str(plan.experiment), *overrides, *length, *swaps),
        "classifier": where("classifier"),
        "agent": where("agent"),
    }
    if plan.hardware is None:
        services["sim"] = where("sim")
    else:
        services |= plan.hardware.commands(plan.cell, plan.endpoint, plan.definition.sensor)
    if plan.viewer is not None:
        services["viewer"] = (*where("viewer"), *plan.viewer.options)
    if plan.ros2 is not None:
        services[OUT] = (*where(OUT), *plan.ros2.options)
    return in_one_process(services, where(TOGETHER)) if plan.together else services


def in_one_process(services: Commands, options: tuple[str, ...]) -> Commands:
    """Return the same services, those of PARTS in one process, which has some ``options`` of its own."""
    words = [(name, *services[name]) for name in PARTS]
    joined = (*words[0], *(word for part in words[1:] for word in ("+", *part)))
    return {
        TOGETHER if name == PARTS[0] else name: (*options, *joined) if name == PARTS[0] else given
        for name, given in services.items()
        if name not in PARTS[1:]
    }
