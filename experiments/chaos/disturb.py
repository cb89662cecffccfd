"""What each kind of disturbance does to a cell: one small class for each, with a beginning and an end."""

from __future__ import annotations

import signal
from dataclasses import dataclass
from typing import Protocol

from experiments.chaos.cell import ChaosCell
from experiments.chaos.clocks import ALL
from experiments.chaos.line import Faults
from experiments.chaos.plan import LINK, Disturbance


class Disturbing(Protocol):
    """One thing done to a cell."""

    def begin(self, cell: ChaosCell) -> None:
        """Begin."""

    def end(self, cell: ChaosCell) -> None:
        """End; all that is undone is undone here."""


@dataclass(frozen=True)
class Kill:
    """Processes die, all at once."""

    victims: tuple[str, ...]

    def begin(self, cell: ChaosCell) -> None:
        """Kill them."""
        for name in self.victims:
            cell.kill(name)

    def end(self, cell: ChaosCell) -> None:
        """Leave it to the supervisor."""


@dataclass(frozen=True)
class KillAgain:
    """A process dies, and another one while the cell gets over it."""

    first: str
    second: str

    def begin(self, cell: ChaosCell) -> None:
        """Kill the first."""
        cell.kill(self.first)

    def end(self, cell: ChaosCell) -> None:
        """Kill the second."""
        cell.kill(self.second)


@dataclass(frozen=True)
class Freeze:
    """A process, or the tap, stands still: sockets stay open, nothing answers."""

    name: str

    def begin(self, cell: ChaosCell) -> None:
        """Stop it."""
        cell.send(self.name, signal.SIGSTOP)

    def end(self, cell: ChaosCell) -> None:
        """Let it go on."""
        cell.send(self.name, signal.SIGCONT)


@dataclass(frozen=True)
class Spoil:
    """Something happens to messages on their way."""

    faults: Faults

    def begin(self, cell: ChaosCell) -> None:
        """Let it happen."""
        cell.fault(self.faults)

    def end(self, cell: ChaosCell) -> None:
        """Let all messages pass."""
        cell.fault(Faults())


class FullDisk:
    """The store cannot write; a store that is started meanwhile could."""

    def begin(self, cell: ChaosCell) -> None:
        """Leave no room."""
        cell.fill_disk(True)

    def end(self, cell: ChaosCell) -> None:
        """Make room."""
        cell.fill_disk(False)


@dataclass(frozen=True)
class Jump:
    """A wall clock jumps and stays there, until it jumps once more or the cell is stopped."""

    name: str
    offset_s: float

    def begin(self, cell: ChaosCell) -> None:
        """Set it."""
        assert cell.clocks is not None
        cell.clocks.set(self.name, self.offset_s)

    def end(self, cell: ChaosCell) -> None:
        """Leave it."""


def disturbing(planned: Disturbance) -> Disturbing:
    """Return what does a planned disturbance."""
    victims, kind = planned.victims, planned.kind
    if kind in ("kill", "several"):
        return Kill(victims)
    if kind == "again":
        return KillAgain(*victims)
    if kind == "freeze":
        return Freeze(victims[0])
    if kind == "cut":
        return Freeze("tap")
    if kind in LINK:
        return Spoil(Faults(**{kind: planned.strength}))
    if kind == "full-disk":
        return FullDisk()
    return Jump(victims[0] if victims else ALL, planned.strength)
