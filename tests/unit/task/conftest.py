"""A task fed with hand-made samples, as if a robot and a sensor were there."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from services.task.insertion import Felt, Insertion
from services.wire.definition import Definition, Limits, Moves, Parts, Reward, Start
from services.wire.messages import Action, EpisodeSummary, Force, Home, Move, Moved, Observation

RUN = "test-s0"


def definition(*, reward: Reward | None = None, start: Start | None = None, **limits: float) -> Definition:
    """Return a definition whose numbers are exact in binary: contact at 0.5 N, collision at 8 N, success at 8 mm."""
    exact = {"contact_force_n": 0.5, "collision_force_n": 8.0, "success_fraction": 0.5} | limits
    made = Definition(
        name="exact",
        parts=Parts(peg_height_mm=16.0),
        start=start or Start(height_mm=1.0),
        moves=Moves(lateral_mm=0.25, insertion_mm=0.25, rotation_deg=0.5),
        limits=Limits(**exact),  # type: ignore[arg-type]
    )
    return (
        made
        if reward is None
        else Definition(**{n: getattr(made, n) for n in made.__struct_fields__} | {"reward": reward})
    )


class Bench:
    """One run of the task; each call answers the motion asked for last."""

    def __init__(self, settings: Definition, seed: int = 0) -> None:
        self.task = Insertion(settings, RUN, seed)
        self.motion: Home | Move | None = None
        self.felt: Felt | None = None
        self.rewards: list[float] = []
        self.versions = 0

    def home(self, episode: int = 0, first_decision: int = 0) -> Home:
        self.motion = home = self.task.home(episode, first_decision)
        self.rewards = []
        return home

    def feel(self, force: float | Force, torque: float = 0.0, dz_mm: float | None = None) -> Felt:
        """Let the motion be made, as asked or with another dz, and give the sample felt after it."""
        assert isinstance(self.motion, Home | Move)
        step = 0 if isinstance(self.motion, Home) else self.motion.step
        asked = 0.0 if isinstance(self.motion, Home) else self.motion.dz_mm
        moved = Moved(
            run=RUN,
            episode=self.motion.episode,
            step=step,
            arrived_t_ns=step,
            dz_mm=asked if dz_mm is None else dz_mm,
        )
        vector = force if isinstance(force, tuple) else (0.0, 0.0, -force)
        self.felt = self.task.feel(moved, vector, (torque, 0.0, 0.0))
        if self.felt.reward is not None:
            self.rewards.append(self.felt.reward.reward)
        self.motion = self.felt.then if isinstance(self.felt.then, Move) else None
        return self.felt

    def act(self, action: int, state: int = 0) -> Move:
        assert self.felt is not None
        observation = self.felt.then
        assert isinstance(observation, Observation)
        self.motion = move = self.task.act(answer(observation, action, state, self.versions))
        self.versions += 1
        return move

    def touch(self, action: int, force: float, state: int = 0, dz_mm: float | None = None) -> Felt:
        """Decide, and give the sample felt after the decision's move."""
        self.act(action, state)
        return self.feel(force, dz_mm=dz_mm)

    def summary(self) -> EpisodeSummary:
        assert self.felt is not None
        assert isinstance(self.felt.then, EpisodeSummary)
        return self.felt.then


def answer(observation: Observation, action: int, state: int = 0, version: int = 0) -> Action:
    """Return an agent's answer to an observation."""
    return Action(
        run=observation.run,
        episode=observation.episode,
        step=observation.step,
        decision=observation.decision,
        state=state,
        action=action,
        policy_version=version,
    )


@pytest.fixture
def exact() -> Callable[..., Definition]:
    return definition


@pytest.fixture
def bench() -> Callable[..., Bench]:
    """Make a bench from the settings of ``exact``."""
    return lambda seed=0, **settings: Bench(definition(**settings), seed)


@pytest.fixture(scope="session")
def answered() -> Callable[..., Action]:
    return answer


@pytest.fixture
def below() -> Callable[[float], float]:
    """The next float below a number."""
    return lambda value: math.nextafter(value, -math.inf)
