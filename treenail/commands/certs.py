"""``treenail certs``: a certificate authority, and a certificate for each service and person."""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Sequence
from pathlib import Path

from rich.table import Table

from services.bus.access import NAMES, ROUTER
from services.cell.authority import (
    AuthorityError,
)
from services.cell.certificates import certify
from services.cell.terminal import console
from services.rules.command_line import whole
from services.wire.keys import SERVICES

MAX_DAYS = 3650


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("--out", type=Path, default=Path("certs"), metavar="FOLDER", help="default: certs")
    parser.add_argument(
        "--host",
        action="extend",
        nargs="+",
        default=[],
        metavar="NAME_OR_IP",
        help="how other machines reach the router; may be repeated, localhost and this machine's name are always there",
    )
    parser.add_argument(
        "--days", type=whole(1, MAX_DAYS), default=365, help="how long new certificates are valid (default: 365)"
    )
    parser.add_argument(
        "--only",
        action="extend",
        nargs="+",
        choices=NAMES,
        metavar="SERVICE",
        help=f"not all of {', '.join(NAMES)}",
    )
    parser.add_argument(
        "--owner",
        type=_owner,
        metavar="UID:GID",
        help="who the services run as, containers for instance: gets their folders, the rest is the owner's of --out",
    )


def act(arguments: argparse.Namespace) -> None:
    """Make what is missing, renew what expires, and print a row a name."""
    made, done = certify(arguments.out, arguments.host, arguments.days, arguments.only or NAMES)
    if arguments.owner is not None:
        give(arguments.out, [row.name for row in (made, *done)], arguments.owner)
    table = Table(title=f"Certificates in {arguments.out}")
    for heading in ("name", "what", "valid until", "folder", "hosts"):
        table.add_column(heading, overflow="fold")
    for row in (made, *done):
        folder = str(arguments.out / row.name)
        table.add_row(row.name, row.what, f"{row.until:%Y-%m-%d %H:%M} UTC", folder, " ".join(row.hosts))
    console().print(table)
    print(f"give each machine the folders of its services; {arguments.out / 'ca'} stays here, and secret")


def give(out: Path, names: Sequence[str], owner: tuple[int, int]) -> None:
    """Give services' folders to who they run as; those of people, and the authority, to who owns ``out``.

    Raises AuthorityError when we may not do that.
    """
    try:
        mine = out.stat()
        for name in names:
            user, group = owner if name in (ROUTER, *SERVICES) else (mine.st_uid, mine.st_gid)
            for path in (out / name, *(out / name).iterdir()):
                os.chown(path, user, group)
    except OSError as error:
        raise AuthorityError(
            f"--owner {owner[0]}:{owner[1]}: cannot give {error.filename} away: {error.strerror}"
        ) from None


def _owner(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"([0-9]{1,9}):([0-9]{1,9})", text, re.ASCII)
    if found is None:
        raise argparse.ArgumentTypeError(f"expected user and group as numbers, such as 10001:10001, got {text!r}")
    return int(found[1]), int(found[2])
