"""Means and peaks of an episode's force and torque, held against the magnitudes that the journal has. Pure.

A magnitude is felt after each motion. The journal has those that a decision followed upon. Of the others it is known
that the force after a motion of guidance was below contact, and of the force after the last one, what outcome and last
reward say of it. Where nothing else is left, mean and peak are recomputed to the bit; else they are bounded.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from services.wire.definition import Definition, InsertionReward
from services.wire.felt_noise import contact_force_n
from services.wire.messages import EpisodeSummary, JournalStep

_ROUNDING = 1e-9
"""Relative room for a number that comes of others by another way than the task's."""


class Trouble(NamedTuple):
    """Something in the journal that cannot be so."""

    field: str
    expected: str
    got: str


class _Room(NamedTuple):
    """Between what a magnitude must have been."""

    least: float = 0.0
    most: float = math.inf


class _Magnitude(NamedTuple):
    """Force or torque in one episode."""

    name: str
    known: Sequence[float]
    """After each motion that a decision followed upon, in order."""
    between: int
    """Motions before the last one that none followed upon."""
    guided: _Room
    """After each of these."""
    last: _Room
    """After the last one."""


def magnitude_troubles(
    definition: Definition, steps: Sequence[JournalStep], summary: EpisodeSummary
) -> Iterator[Trouble]:
    """Give what is wrong with means and peaks; nothing where the number of moves is wrong already."""
    felt = [step for step in steps if step.step > 0]  # what is felt at home is in neither mean nor peak
    if summary.moves == 0 and not felt:
        for name in ("mean_force_n", "peak_force_n", "mean_torque_nm", "peak_torque_nm"):
            if getattr(summary, name) != 0.0:
                yield Trouble(name, "0.0 without a move", repr(getattr(summary, name)))
    between = summary.moves - 1 - len(felt)
    if between < 0:
        return
    below_contact_n = math.nextafter(contact_force_n(definition), 0.0)
    last_n = _last_force_n(definition, steps, summary)
    forces_n, torques_nm = [math.hypot(*step.force_n) for step in felt], [math.hypot(*step.torque_nm) for step in felt]
    force = _Magnitude("force_n", forces_n, between, _Room(0.0, below_contact_n), last_n)
    torque = _Magnitude("torque_nm", torques_nm, between, _Room(), _Room())
    yield from _troubles(force, summary.moves, summary.mean_force_n, summary.peak_force_n)
    yield from _troubles(torque, summary.moves, summary.mean_torque_nm, summary.peak_torque_nm)


def _last_force_n(definition: Definition, steps: Sequence[JournalStep], summary: EpisodeSummary) -> _Room:
    """Return what the force that ended an episode can have been [N]."""
    collision_n, reward = definition.limits.collision_force_n, definition.reward
    if summary.outcome == "collision":
        return _Room(collision_n)
    most = math.nextafter(collision_n, 0.0)
    of_the_last_decision = bool(steps) and summary.moves == steps[-1].step + 1
    if isinstance(reward, InsertionReward) or summary.outcome == "no_progress" or not of_the_last_decision:
        return _Room(0.0, most)
    before_n = math.hypot(*steps[-1].force_n)
    fell_n, rose_n = before_n * (1.0 - reward.fell_by), before_n * (1.0 + reward.rose_by)
    rooms = (
        (reward.fell, _Room(0.0, fell_n)),
        (reward.rose, _Room(rose_n, most)),
        (reward.otherwise, _Room(fell_n, rose_n)),
    )
    fitting = [room for value, room in rooms if value == steps[-1].reward] or [_Room()]
    least, highest = min(room.least for room in fitting), max(room.most for room in fitting)
    return _Room(least * (1 - _ROUNDING), min(most, highest * (1 + _ROUNDING)))


def _troubles(magnitude: _Magnitude, moves: int, mean: float, peak: float) -> Iterator[Trouble]:
    known, between, last = magnitude.known, magnitude.between, magnitude.last
    highest = max(known, default=0.0)
    guidance_had_it = between > 0 and peak <= magnitude.guided.most
    end_had_it = last.least <= peak <= last.most
    lowest = max(highest, last.least)
    if peak < lowest or not (peak == highest or guidance_had_it or end_had_it):
        at_end = f"{highest!r}, or {last.least:g} to below {last.most:g} at the end"
        yield Trouble(f"peak_{magnitude.name}", f"at least {lowest!r}" if peak < lowest else at_end, repr(peak))
        return
    end_alone_had_it = peak > highest and not guidance_had_it
    end = _Room(peak, peak) if end_alone_had_it else _Room(last.least, min(last.most, peak))
    if between == 0 and end_alone_had_it:
        total = 0.0
        for value in (*known, peak):  # in the order in which the task adds them
            total += value
        if mean != total / moves:
            yield Trouble(f"mean_{magnitude.name}", repr(total / moves), repr(mean))
        return
    least, most = _sum(magnitude, end, peak, end_had_it=end_had_it)
    if not (least / moves) * (1 - _ROUNDING) <= mean <= (most / moves) * (1 + _ROUNDING):
        yield Trouble(f"mean_{magnitude.name}", f"{least / moves!r} to {most / moves!r}", repr(mean))


def _sum(magnitude: _Magnitude, end: _Room, peak: float, *, end_had_it: bool) -> _Room:
    """Return between what the sum of all magnitudes must be."""
    total = math.fsum(magnitude.known)
    most = total + magnitude.between * min(magnitude.guided.most, peak) + end.most
    if peak <= max(magnitude.known, default=0.0):
        return _Room(total + end.least, most)
    return _Room(total + (peak if end_had_it else end.least + peak), most)
