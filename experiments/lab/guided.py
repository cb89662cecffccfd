"""The way between two decisions: the task and the simulated cell, joined by plain calls, as long as nobody is asked."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

from msgspec.structs import replace

from services.rules.window import Load
from services.task.insertion import Insertion
from services.wire.messages import Action, EpisodeSummary, FtPacket, Home, Motion, Move, Moved, Observation, Reward

Seen = Callable[[Moved, FtPacket], object]
"""Hears of every motion what was applied and what was felt after it."""


class Cell(Protocol):
    """Robot and sensor of one run, see ``services.sim.cell.SimulatedCell``."""

    def home(self, home: Home) -> tuple[Moved, FtPacket]:
        """Begin an episode."""

    def move(self, move: Move) -> tuple[Moved, FtPacket]:
        """Make the next motion."""


class Reached(NamedTuple):
    """Where the task waits: for a decision, or, with the episode over, for the next one to begin."""

    reward: Reward | None
    """Of the decision before, now that it is due."""
    then: Observation | EpisodeSummary
    packet: FtPacket
    """What was felt last: one sample, what those of the window came to."""


def make(task: Insertion, cell: Cell, motion: Home | Move, seen: Seen = lambda _moved, _packet: None) -> Reached:
    """Make a motion and then, as long as nothing is touched, the task's own steps in the direction of insertion.

    Raises what the cell raises, GuardError above all.
    """
    while True:
        moved, packet = cell.home(motion) if isinstance(motion, Home) else cell.move(motion)
        felt = task.sense(moved, packet)
        packet = _of(packet, task.load)
        seen(moved, packet)
        if not isinstance(felt.then, Move):
            return Reached(felt.reward, felt.then, packet)
        motion = felt.then


def told(asked: Observation, action: int, state: int = 0, increment: Motion | None = None) -> Action:
    """Return the action of who decides without an agent's memory: of policy version 0.

    ``increment`` is for a move that is no listed one; ``action`` is then what it counts as.
    """
    return Action(
        run=asked.run,
        episode=asked.episode,
        step=asked.step,
        decision=asked.decision,
        state=state,
        action=action,
        policy_version=0,
        swaps=asked.swaps,
        increment=increment,
    )


def _of(packet: FtPacket, load: Load) -> FtPacket:
    """Return a packet with what its samples came to in their place."""
    force_n, torque_nm = load
    same = (packet.force_n, packet.torque_nm) == ((force_n,), (torque_nm,))
    return packet if same else replace(packet, force_n=(force_n,), torque_nm=(torque_nm,))
