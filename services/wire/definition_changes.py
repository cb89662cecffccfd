"""A definition as it is in one episode: the changes that came until then made. Pure."""

from __future__ import annotations

from collections.abc import Iterator

from msgspec.structs import replace

from services.wire.definition import Definition
from services.wire.definition_world import Change


def at_episode(definition: Definition, episode: int) -> Definition:
    """Return the definition of one episode, from 0: with what had changed by its beginning, and nothing to come."""
    if not definition.changes:
        return definition
    settings = replace(definition, changes=())
    for change in definition.changes:
        if change.episode <= episode:
            settings = _changed(settings, change)
    return settings


def phases(definition: Definition) -> Iterator[tuple[int, Definition]]:
    """Give the first episode and the definition of each time in which nothing changes, in order."""
    for first in sorted({0, *(change.episode for change in definition.changes)}):
        yield first, at_episode(definition, first)


def _changed(definition: Definition, change: Change) -> Definition:
    table, _, name = change.key.partition(".")
    return replace(definition, **{table: replace(getattr(definition, table), **{name: change.value})})
