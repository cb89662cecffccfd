"""Settings that are options: a field of a frozen dataclass says its default, its range and its help, once for all."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import Field, field, fields, replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

from services.rules.command_line import number, range_of, whole
from services.wire.errors import TreenailError

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

T = TypeVar("T")
S = TypeVar("S", bound="DataclassInstance")
_KEY = "setting"


class SettingError(TreenailError):
    """A setting of a driver that cannot be used."""


class _Setting(NamedTuple):
    help: str
    option: str
    within: tuple[float, float] | None
    more: dict[str, Any]


def setting(default: T, says: str = "", option: str = "", within: tuple[float, float] | None = None, **more: Any) -> T:
    """Return a dataclass's field; without ``says``, its help, it is no option.

    ``option`` is for one that is not called as the field is; ``within`` is the least and the most, whole numbers for a
    whole number; ``more`` is what else ``add_argument`` gets. A bool's option turns it round.
    """
    made: T = field(default=default, metadata={_KEY: _Setting(says, option, within, more)})
    return made


def add_settings(parser: argparse._ActionsContainer, usual: DataclassInstance | type[DataclassInstance]) -> None:
    """Add the options of a dataclass; ``usual`` has the defaults."""
    for name, option, said in _settings(usual):
        default, more = getattr(usual, name), dict(said.more)
        text = said.help
        if isinstance(default, bool):
            more["action"] = "store_false" if default else "store_true"
        elif said.within is not None:
            least, most = said.within
            both_whole = isinstance(least, int) and isinstance(most, int)
            more["type"] = whole(int(least), int(most)) if both_whole else number(least, most)
            head, mark, usually = text.partition(" (default")
            text = f"{head}, {range_of(least, most)}{mark}{usually}"
        if said.help:
            parser.add_argument(option, dest=name, default=default, help=text, **more)


def settings_of(usual: S, arguments: argparse.Namespace, **others: Any) -> S:
    """Return what parsed options and ``others`` say, the rest as in ``usual``. Raises what the dataclass does."""
    given = {name: getattr(arguments, name) for name, _, said in _settings(usual) if said.help}
    return replace(usual, **(given | others))


def check(settings: DataclassInstance, error: type[Exception], subject: str = "") -> None:
    """Raise an error for a field that is out of range, or none of its choices; None is what nobody has said."""
    for name, _, said in _settings(settings):
        value, choices, expected = getattr(settings, name), said.more.get("choices"), ""
        if value is None:
            continue
        if said.within is not None and not said.within[0] <= value <= said.within[1]:  # what is no number never passes
            expected = range_of(*said.within)
        elif choices is not None and value not in choices:
            expected = f"one of {', '.join(map(str, choices))}"
        if expected:
            raise error(f"{subject}{name}: expected {expected}, got {str(value)[:40]}")


def _settings(of: DataclassInstance | type[DataclassInstance]) -> Iterator[tuple[str, str, _Setting]]:
    """Give name, option and setting of each field that is one."""
    each: tuple[Field[Any], ...] = fields(of)
    for one in each:
        if (said := one.metadata.get(_KEY)) is not None:
            yield one.name, said.option or f"--{one.name.replace('_', '-')}", said
