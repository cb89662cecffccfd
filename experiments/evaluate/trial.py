"""Episodes of a controller on a task, in one process: the task and the world are those of a run that learns."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from experiments.evaluate.controllers import Controller
from experiments.lab.guided import make, told
from services.sim.cell import SimulatedCell
from services.task.insertion import Insertion
from services.wire.definition import Definition
from services.wire.definition_file import run_id
from services.wire.messages import EpisodeSummary, Home, Move


class Trial(NamedTuple):
    """What came of the episodes of one seed."""

    seed: int
    episodes: tuple[EpisodeSummary, ...]
    states: frozenset[int]
    """Contact states that decisions were taken for."""


def trial(
    definition: Definition,
    controller: Controller,
    seed: int,
    episodes: int,
    done: Callable[[int], object] = lambda _: None,
) -> Trial:
    """Let a controller insert ``episodes`` times; start poses and noise are those of runs with this ``seed``.

    ``done`` hears the number of episodes finished after each.
    """
    run = run_id(definition, seed)
    cell, task = SimulatedCell(definition, run, seed), Insertion(definition, run, seed)
    summaries, states, decisions = list[EpisodeSummary](), set[int](), 0
    for episode in range(episodes):
        controller.begin()
        motion: Home | Move = task.home(episode, decisions)
        while True:
            then = make(task, cell, motion).then
            if isinstance(then, EpisodeSummary):
                break
            choice = controller.decide(then)
            states.add(choice.state)
            motion = task.act(told(then, *choice))
        summaries.append(then)
        decisions += then.decisions
        done(episode + 1)
    return Trial(seed, tuple(summaries), frozenset(states))
