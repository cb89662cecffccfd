"""What ``treenail up`` is asked to bring up, checked before anything starts."""

from __future__ import annotations

import argparse
import socket
from dataclasses import dataclass
from pathlib import Path

from services.bus import ports
from services.bus.access import OPERATOR, ROUTER
from services.bus.tls import identity
from services.cell import hil
from services.rules import plugins
from services.rules import skill as skill_file
from services.rules.skill import NamedSkill
from services.rules.swaps import SPEC, SPEC_HELP, digest, planned
from services.wire.definition import Definition
from services.wire.definition_file import check_run, definition_sha256, load, run_id
from services.wire.errors import CellError
from services.wire.keys import Keys

PROFILES = ("sim", "hil")
DEFAULT_WEB_PORT = 9090


@dataclass(frozen=True)
class Viewer:
    """Where the viewer service listens."""

    bind: str
    port: int
    web_port: int | None
    host: str
    """Name or address for people."""

    @property
    def url(self) -> str:
        """Return what a Rerun viewer attaches to."""
        return f"rerun+http://{self.host}:{self.port}/proxy"

    @property
    def page(self) -> str | None:
        """Return the page for browsers."""
        return None if self.web_port is None else f"http://{self.host}:{self.web_port}"

    @property
    def options(self) -> tuple[str, ...]:
        """Return the options of the viewer service."""
        page = ("--no-web",) if self.web_port is None else ("--web-port", str(self.web_port))
        return ("--bind", self.bind, "--port", str(self.port), *page)


@dataclass(frozen=True)
class Plan:
    """What to bring up, checked before anything starts."""

    arguments: argparse.Namespace
    overrides: tuple[str, ...]
    """Of the definition's file."""
    definition: Definition
    skill: NamedSkill | None
    run: str
    episodes: int
    out: Path
    endpoint: str
    viewer: Viewer | None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``treenail up``."""
    parser.add_argument(
        "profile", choices=PROFILES, help="sim: the simulator in place of robot and sensor; hil: emulated hardware"
    )
    parser.add_argument("--experiment", default="chamfered-q-softmax", help="name or TOML file of the definition")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", help="override a key of it")
    parser.add_argument("--episodes", type=int, help="length of the run (default: the definition's)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the run, from 0 (default: 0)")
    parser.add_argument("--skill", type=Path, metavar="FILE", help="begin with what `treenail checkpoint export` wrote")
    parser.add_argument("--swap", action="append", default=[], metavar=SPEC, help=SPEC_HELP)
    parser.add_argument(
        "--out", type=Path, help="run directory (default: runs/<experiment>-<hash>-s<seed>[-k<skill>][-w<swaps>])"
    )
    parser.add_argument("--fresh", action="store_true", help="forget what the run directory knows of earlier runs")
    parser.add_argument("--cell", default="a", help="name of the cell (default: a)")
    parser.add_argument(
        "--certs", type=Path, metavar="FOLDER", help="what `treenail certs` made: with mutual TLS and access control"
    )
    parser.add_argument("--port", type=int, default=7447, help="the router's port on 127.0.0.1, 0 for a free one")
    parser.add_argument("--viewer-port", type=int, default=9876, help="port for Rerun viewers, 0 for a free one")
    parser.add_argument("--viewer-bind", default="0.0.0.0", help="address for Rerun viewers (default: all)")
    parser.add_argument(
        "--web-port",
        type=int,
        help="port of the page for browsers, 0 for a free one (default: 9090, or a free one with --viewer-port 0)",
    )
    parser.add_argument("--no-web", action="store_true", help="serve no page for browsers")
    parser.add_argument("--no-viewer", action="store_true", help="run without the viewer service")
    parser.add_argument("--save", type=Path, metavar="FILE.rrd", help="let the viewer service record as well")
    hil.add_arguments(parser)


def plan_of(arguments: argparse.Namespace) -> Plan:
    """Return what parsed arguments ask for, checked. Raises TreenailError."""
    hil.check(arguments)
    overrides = tuple(arguments.set)
    definition = load(arguments.experiment, overrides)
    if arguments.profile == "hil":
        overrides += tuple(hil.overrides(definition))
        definition = load(arguments.experiment, overrides)
    plugins.check(definition)
    episodes = definition.episodes if arguments.episodes is None else arguments.episodes
    check_run(arguments.seed, episodes)
    Keys(arguments.cell)
    if arguments.certs is not None:
        loop = ("store", "task", "sim", "classifier", "agent", *(() if arguments.no_viewer else ("viewer",)))
        for name in (ROUTER, *loop, OPERATOR):
            identity(arguments.certs / name, name)
    skill, from_skill = None, ""
    if arguments.skill is not None:
        skill = skill_file.read(arguments.skill)
        skill_file.fits(skill.skill, definition)
        from_skill = f"-k{skill.sha256[:8]}"
    run = run_id(definition, arguments.seed, None if skill is None else skill.sha256)
    swaps = planned(run, definition, arguments.swap, episodes)
    from_swaps = f"-w{digest(swaps)[:8]}" if swaps else ""
    folder = f"{definition.name}-{definition_sha256(definition)[:8]}-s{arguments.seed}{from_skill}{from_swaps}"
    out = arguments.out or Path("runs") / folder
    port = _free_port("127.0.0.1", arguments.port, "--port")
    endpoint = f"tcp/127.0.0.1:{port}" if arguments.certs is None else f"tls/127.0.0.1:{port}"
    viewer = None if arguments.no_viewer else _viewer(arguments)
    return Plan(arguments, overrides, definition, skill, run, episodes, out, endpoint, viewer)


def _viewer(arguments: argparse.Namespace) -> Viewer:
    """Return where the viewer service shall listen."""
    bind = arguments.viewer_bind
    web_port = arguments.web_port
    if web_port is None:  # who asks for any port for one asks for any port for the other
        web_port = DEFAULT_WEB_PORT if arguments.viewer_port else 0
    port = _free_port(bind, arguments.viewer_port, "--viewer-port")
    web_port = None if arguments.no_web else _free_port(bind, web_port, "--web-port")
    host = socket.gethostname() if bind in ("0.0.0.0", "::") else f"[{bind}]" if ":" in bind else bind
    return Viewer(bind, port, web_port, host)


def _free_port(host: str, port: int, option: str) -> int:
    """Return ``port``, or a free one for 0. Raises CellError when it is taken."""
    try:
        return ports.free_port(host, port)
    except (OSError, OverflowError) as error:
        raise CellError(f"{option} {port}: cannot listen on {host}:{port}: {error}; try another, or 0") from None
