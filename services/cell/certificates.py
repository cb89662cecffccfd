"""A folder of certificates: making what is missing, renewing what expires."""

from __future__ import annotations

import datetime as dt
import socket
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from services.bus.access import NAMES, ROUTER
from services.cell.authority import (
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

RENEW_BEFORE_DAYS = 30
"""A certificate with less left is renewed; one that never had so much, when two thirds are over."""


class Done(NamedTuple):
    """What was done about one name."""

    name: str
    what: str
    until: dt.datetime
    hosts: Sequence[str] = ()


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
        [_keep_or_make(ours, out / name, name, list(wanted) if name == ROUTER else [], days) for name in names],
    )


def _own_hosts() -> list[str]:
    """Return how this machine itself, and a container network, reach the router."""
    hosts = ["localhost", "127.0.0.1", "::1", ROUTER]
    try:
        return [*hosts, check_host(socket.gethostname())]
    except AuthorityError:
        return hosts  # the machine has a name that nobody could connect to


def _check_ours(ours: Authority, folder: Path) -> None:
    """Raise AuthorityError when a folder has a certificate that another authority signed."""
    path = folder / "cert.pem"
    if path.exists() and not ours.signed(certificate(path)):
        raise AuthorityError(f"{path}: expected one of the authority in {folder.parent / 'ca'}, got another's")


def _keep_or_make(ours: Authority, folder: Path, name: str, hosts: Sequence[str], days: int) -> Done:
    """Keep the certificate in a folder when it is good, otherwise make one."""
    old = intact(folder, name)
    old_hosts = hosts_of(old) if old is not None else []
    missing = [host for host in hosts if host not in old_hosts]
    every = list(dict.fromkeys((*hosts, *old_hosts))) if name == ROUTER else []
    if old is not None:
        left, whole = old.not_valid_after_utc - now(), old.not_valid_after_utc - old.not_valid_before_utc
        why = f"new hosts: {' '.join(missing)}" if missing else ""
        if left < min(dt.timedelta(days=RENEW_BEFORE_DAYS), whole / 3):
            why = f"expire{'d' if left <= dt.timedelta() else 's'} {old.not_valid_after_utc:%Y-%m-%d %H:%M}"
        if not why:
            return Done(name, _put_back_authority(ours, folder), old.not_valid_after_utc, old_hosts)
        what = f"renewed ({why})"
    else:
        what = "made again (it was damaged)" if (folder / "cert.pem").exists() else "made"
    cert = ours.issue(folder, name, every, days)
    return Done(name, what, cert.not_valid_after_utc, every)


def _put_back_authority(ours: Authority, folder: Path) -> str:
    """Put back the copy of the authority's certificate when it is not as it should be; return what was done."""
    copy = folder / "ca.pem"
    if copy.exists() and read(copy) == ours.pem:
        return "kept"
    write(copy, ours.pem)
    return "kept (ca.pem put back)"
