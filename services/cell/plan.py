"""What cell to bring up on this machine, checked before anything starts."""

from __future__ import annotations

import socket
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from services.bus import ports
from services.bus.access import ROUTER
from services.bus.tls import identity
from services.cell.ros2 import OUT, Graph
from services.rules import plugins
from services.rules.shipped_skill import for_task, named_or_file
from services.rules.skill import NamedSkill
from services.rules.swaps import digest
from services.rules.swaps import planned as planned_swaps
from services.wire.definition import Definition, Sensor
from services.wire.definition_file import check_run, definition_sha256, find, load, run_id
from services.wire.errors import CellError
from services.wire.keys import OPERATOR, Keys

WORKERS_AND_TASK = ("store", "task", "classifier", "agent")
"""The services of a cell in which a run can be made, beside the router and what moves and feels."""


class Hardware(Protocol):
    """What moves and feels in a cell in the simulator's place: hil.Hil, ur.Ur, ros2.RosArm."""

    @property
    def emulated(self) -> bool:
        """Whether a simulator is behind it."""

    @property
    def services(self) -> tuple[str, ...]:
        """What is in the cell itself, and needs a certificate there."""

    def overrides(self, definition: Definition) -> Sequence[str]:
        """Return what has to be set in a definition for it. Raises CellError for what it cannot make."""

    def commands(self, cell: str, endpoint: str, sensor: Sensor) -> dict[str, tuple[str, ...]]:
        """Return the options of its services by name, in the order of starting."""


@dataclass(frozen=True)
class Viewer:
    """Where the viewer service listens, and what it records."""

    bind: str
    port: int
    web_port: int | None
    """Of the page for browsers; None for no page."""
    host: str
    """Name or address for people."""
    save: Path | None = None
    """File of the recording; None for none."""

    @property
    def url(self) -> str:
        """Return what a Rerun viewer attaches to."""
        return f"rerun+http://{self.host}:{self.port}/proxy"

    @property
    def for_whom(self) -> str:
        """Return who can watch, for the line that says where."""
        if self.bind in ("0.0.0.0", "::"):
            return "open to the network"
        local = self.bind == "::1" or self.bind.startswith("127.")
        return "this machine only; --viewer-bind opens it" if local else f"at {self.bind} only"

    @property
    def page(self) -> str | None:
        """Return the page for browsers."""
        return None if self.web_port is None else f"http://{self.host}:{self.web_port}"

    @property
    def options(self) -> tuple[str, ...]:
        """Return the options of the viewer service."""
        page = ("--no-web",) if self.web_port is None else ("--web-port", str(self.web_port))
        save = () if self.save is None else ("--save", str(self.save))
        return ("--bind", self.bind, "--port", str(self.port), *page, *save)


@dataclass(frozen=True)
class Plan:
    """A cell, where it works and what run it makes."""

    experiment: Path
    """File of the definition."""
    overrides: tuple[str, ...]
    """Of the definition's file, as ``KEY=VALUE``."""
    definition: Definition
    seed: int
    episodes: int
    swaps: tuple[str, ...]
    """As ``EPISODE:SERVICE:KEY=VALUE,...``."""
    skill: NamedSkill | None
    """What the run begins with; None for nothing learnt."""
    cell: str
    out: Path
    """Run directory: logs, the store's file, results."""
    port: int
    """The router's, on 127.0.0.1."""
    certs: Path | None
    """Folder of ``treenail certs``; None for a cell without certificates."""
    hardware: Hardware | None
    """Robot and sensor, emulated or real; None for the simulator in their place."""
    viewer: Viewer | None
    ros2: Graph | None
    """Where ROS 2 sees the cell; None for nowhere."""
    fresh: bool
    """Whether what the run directory knows of earlier runs is forgotten."""
    together: bool
    """Whether task, classifier, agent and simulator are in one process."""

    @property
    def run(self) -> str:
        """Return the name of the run."""
        return run_id(self.definition, self.seed, None if self.skill is None else self.skill.sha256)

    @property
    def endpoint(self) -> str:
        """Return where the router listens."""
        return f"{'tcp' if self.certs is None else 'tls'}/127.0.0.1:{self.port}"

    @property
    def logs(self) -> Path:
        """Return the folder of the services' logs."""
        return self.out / "logs"


def make_plan(
    experiment: str,
    *,
    overrides: Sequence[str] = (),
    seed: int = 0,
    episodes: int | None = None,
    swaps: Sequence[str] = (),
    skill: str | Path | None = None,
    cell: str = "a",
    out: Path | None = None,
    port: int = 0,
    certs: Path | None = None,
    hardware: Hardware | None = None,
    viewer: Viewer | None = None,
    ros2: Graph | None = None,
    fresh: bool = False,
    together: bool = False,
) -> Plan:
    """Return a plan, checked. Raises TreenailError, which names the option of ``treenail up``.

    ``experiment`` is a name or a file, ``episodes`` the definition's by default, ``skill`` a file or
    ``builtin``, ``port`` the router's on 127.0.0.1 and 0 a free one, ``out`` by default a folder in ``runs`` that is
    named by all that makes the run what it is.
    """
    sets = tuple(overrides)
    definition = load(experiment, sets)
    if hardware is not None:
        sets += tuple(hardware.overrides(definition))
        definition = load(experiment, sets)
    plugins.check(definition)
    length = definition.episodes if episodes is None else episodes
    check_run(seed, length)
    Keys(cell)
    if together and hardware is not None:
        raise CellError("--together: expected the simulator, whose physics is in the same process, got other hardware")
    if together and certs is not None:
        raise CellError("--together: expected no --certs: each service has its own, and there is one process for four")
    if certs is not None:
        if hardware is not None and hardware.emulated:
            raise CellError("--certs: expected none with emulated hardware, which has no certificates")
        if ros2 is not None and ros2.router is None:
            raise CellError(
                "--ros2: expected --ros ENDPOINT, ROS's own router, with --certs: the cell's carries nothing of ROS 2"
            )
        arm = ("sim",) if hardware is None else hardware.services
        watching = (*(() if viewer is None else ("viewer",)), *(() if ros2 is None else (OUT,)))
        for name in (ROUTER, *WORKERS_AND_TASK, *arm, *watching, OPERATOR):
            identity(certs / name, name)
    named_skill = None if skill is None else for_task(named_or_file(skill), definition)
    run = run_id(definition, seed, None if named_skill is None else named_skill.sha256)
    all_swaps = planned_swaps(run, definition, swaps, length)
    from_skill = "" if named_skill is None else f"-k{named_skill.sha256[:8]}"
    from_swaps = f"-w{digest(all_swaps)[:8]}" if all_swaps else ""
    folder = f"{definition.name}-{definition_sha256(definition)[:8]}-s{seed}{from_skill}{from_swaps}"
    return Plan(
        experiment=find(experiment).resolve(),
        overrides=sets,
        definition=definition,
        seed=seed,
        episodes=length,
        swaps=tuple(swaps),
        skill=named_skill,
        cell=cell,
        out=out or Path("runs") / folder,
        port=_checked_port("127.0.0.1", port, "--port"),
        certs=certs,
        hardware=hardware,
        viewer=viewer,
        ros2=ros2,
        fresh=fresh,
        together=together,
    )


def viewer_at(bind: str, port: int, web_port: int | None, save: Path | None = None) -> Viewer:
    """Return a viewer that listens on free ports for 0; None for no page. Raises CellError when one is taken."""
    port = _checked_port(bind, port, "--viewer-port")
    web_port = None if web_port is None else _checked_port(bind, web_port, "--web-port")
    host = socket.gethostname() if bind in ("0.0.0.0", "::") else f"[{bind}]" if ":" in bind else bind
    return Viewer(bind, port, web_port, host, save)


def _checked_port(host: str, port: int, option: str) -> int:
    """Return ``port``, or a free one for 0. Raises CellError when it is taken."""
    try:
        return ports.free_port(host, port)
    except (OSError, OverflowError) as error:
        raise CellError(f"{option} {port}: cannot listen on {host}:{port}: {error}; try another, or 0") from None
