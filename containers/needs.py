"""Prints the part of requirements.lock that one service needs, for its image: ``python needs.py SERVICE LEFT_OUT...``.

The lock says behind each package whose sake it is there for, so that the way down from the extra of a service's name
in pyproject.toml leads past all that it takes, pinned and with hashes.
"""

from __future__ import annotations

import re
import sys
import tomllib
from collections.abc import Iterable
from pathlib import Path

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")


def needs(project: str, lock: str, service: str, left_out: Iterable[str] = ()) -> dict[str, str]:
    """Return the lock's text for each package that ``service`` takes, without ``left_out`` and what only they take.

    Raises KeyError when the lock lacks what pyproject.toml asks for.
    """
    asked = tomllib.loads(project)["project"]
    blocks = {_name(block): block for block in re.split(r"^(?=[A-Za-z0-9])", lock, flags=re.MULTILINE)[1:]}
    taken_by: dict[str, list[str]] = {}
    for name, block in blocks.items():
        for parent in re.findall(r"^    #(?: via)? +([^ \n]+)", block, flags=re.MULTILINE):
            taken_by.setdefault(parent, []).append(name)
    waiting = [_name(need) for need in (*asked["dependencies"], *asked["optional-dependencies"].get(service, ()))]
    chosen: dict[str, str] = {}
    while waiting:
        name = waiting.pop()
        if name not in chosen and name not in left_out:
            chosen[name] = blocks[name]
            waiting += taken_by.get(name, ())
    return chosen


def _name(requirement: str) -> str:
    found = _NAME.match(requirement)
    assert found is not None, requirement
    return re.sub(r"[-_.]+", "-", found[0]).lower()


if __name__ == "__main__":
    texts = [Path(name).read_text(encoding="utf-8") for name in ("pyproject.toml", "requirements.lock")]
    print(*needs(texts[0], texts[1], sys.argv[1], sys.argv[2:]).values(), sep="")
