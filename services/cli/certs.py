"""``treenail certs``: a certificate authority, and a certificate for each service and person."""

from __future__ import annotations

import argparse
import datetime as dt
import os
import re
import socket
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from rich.table import Table

from services.cli.authority import (
    Authority,
    AuthorityError,
    authority,
    certificate,
    check_host,
    hosts_of,
    intact,
    now,
    read,
    write,
)
from services.cli.terminal import console
from services.wire.access import NAMES, ROUTER, SERVICES

RENEW_BEFORE_DAYS = 30
"""A certificate with less left is renewed; one that never had so much, when two thirds are over."""
MAX_DAYS = 3650


class Done(NamedTuple):
    """What was done about one name."""

    name: str
    what: str
    until: dt.datetime
    hosts: Sequence[str] = ()


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
    parser.add_argument("--days", type=int, default=365, help="how long new certificates are valid (default: 365)")
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
    if not 1 <= arguments.days <= MAX_DAYS:
        raise AuthorityError(f"--days: expected 1 to {MAX_DAYS}, got {arguments.days}")
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


def certify(out: Path, hosts: Sequence[str], days: int, names: Sequence[str] = NAMES) -> tuple[Done, list[Done]]:
    """Make what is missing in ``out`` and renew what expires; return what was done about the authority and each name.

    ``hosts`` are added to those that the router's certificate has anyway. Raises AuthorityError when there is
    something in ``out`` that is not of its authority; nothing is changed then.
    """
    wanted = {host: None for host in (*_own_hosts(), *map(check_host, hosts))}
    ours, made = authority(out)
    for name in names:
        _check_ours(ours, out / name)
    return (
        Done("ca", "made" if made else "kept", ours.cert.not_valid_after_utc),
        [_certified(ours, out / name, name, list(wanted) if name == ROUTER else [], days) for name in names],
    )


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


def _own_hosts() -> list[str]:
    """Return how this machine itself, and a container network, reach the router."""
    found = ["localhost", "127.0.0.1", "::1", ROUTER]
    try:
        found.append(check_host(socket.gethostname()))
    except AuthorityError:
        return found  # a name that nobody could connect to
    return found


def _check_ours(ours: Authority, folder: Path) -> None:
    """Raise AuthorityError when a folder has a certificate that another authority signed."""
    path = folder / "cert.pem"
    if path.exists() and not ours.signed(certificate(path)):
        raise AuthorityError(f"{path}: expected one of the authority in {folder.parent / 'ca'}, got another's")


def _certified(ours: Authority, folder: Path, name: str, hosts: Sequence[str], days: int) -> Done:
    """Keep the certificate in a folder when it is good, otherwise make one."""
    old = intact(folder, name)
    known = hosts_of(old) if old is not None else []
    missing = [host for host in hosts if host not in known]
    every = list(dict.fromkeys((*hosts, *known))) if name == ROUTER else []
    if old is not None:
        left, whole = old.not_valid_after_utc - now(), old.not_valid_after_utc - old.not_valid_before_utc
        why = f"new hosts: {' '.join(missing)}" if missing else ""
        if left < min(dt.timedelta(days=RENEW_BEFORE_DAYS), whole / 3):
            why = f"expire{'d' if left <= dt.timedelta() else 's'} {old.not_valid_after_utc:%Y-%m-%d %H:%M}"
        if not why:
            return Done(name, _completed(ours, folder), old.not_valid_after_utc, known)
        what = f"renewed ({why})"
    else:
        what = "made again (it was damaged)" if (folder / "cert.pem").exists() else "made"
    cert = ours.issue(folder, name, every, days)
    return Done(name, what, cert.not_valid_after_utc, every)


def _completed(ours: Authority, folder: Path) -> str:
    """Put back the copy of the authority's certificate when it is not as it should be; return what was done."""
    copy = folder / "ca.pem"
    if copy.exists() and read(copy) == ours.pem:
        return "kept"
    write(copy, ours.pem)
    return "kept (ca.pem put back)"
