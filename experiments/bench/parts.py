"""``bench sim``, ``bench art2`` and ``bench learner``: what the parts of the loop take by themselves."""

from __future__ import annotations

import math
import time

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from experiments.bench import bare_mujoco, bare_physics
from experiments.bench.pattern import timed
from experiments.bench.values import Value, spread
from services.agent.learning import Learner
from services.cell.traffic import percentile
from services.classifier.art2 import Art2
from services.classifier.encoding import Encoding, input_count
from services.rules.swaps import kind_of
from services.sim.cell import SimulatedCell
from services.wire.definition import Art2Settings, Definition, Noise, TdSettings
from services.wire.errors import TreenailError
from services.wire.messages import FtPacket, Home, Move

ART2_TARGET_US = 50.0
"""Most that the median step with 12 inputs and 20 classes may take."""
ART2_CASES: tuple[tuple[Encoding, int], ...] = (("odd", 20), ("split", 20), ("odd", 100), ("split", 100))
CLOSE = 0.02
"""Standard deviation of a presentation's components from the unit vector that founded its class."""
MOST_DRAWS = 100_000
STATES = 20
"""Contact states in the learner's table; the simulated tasks have about as many."""
_RUN = "bench"


def sim(definition: Definition, seed: int, moves: int, episodes: int, rounds: int) -> dict[str, Value]:
    """Measure lateral moves in free air and in contact, two bare loops beside them, and whole episodes."""
    free, contact, whole, bare, other = [], [], [], [], list[float]()
    absent = ""
    for _ in range(rounds):
        bare.append(bare_physics.moves_per_s(definition, moves))
        try:
            other.append(bare_mujoco.moves_per_s(definition, moves))
        except ImportError as error:
            absent = f"not measured: {error}; pip install mujoco"
        free.append(moves / _sweep(definition, seed, moves, in_contact=False))
        contact.append(moves / _sweep(definition, seed, moves, in_contact=True))
        run = timed(definition, seed, episodes)
        whole.append(run.motions / run.physics_s)
    return {
        "experiment": definition.name,
        "seed": seed,
        "rounds": rounds,
        "moves": moves,
        "episodes": episodes,
        "free_moves_per_s": spread(free),
        "contact_moves_per_s": spread(contact),
        "bare_sapien_moves_per_s": spread(bare),
        "bare_mujoco_moves_per_s": spread(other) if other else absent,
        "episode_motions_per_s": spread(whole),
    }


def art2(steps: int, rounds: int) -> dict[str, Value]:
    """Measure classify-and-learn steps that find a known class, for all encodings and numbers of classes."""
    cases: list[Value] = []
    for encoding, classes in ART2_CASES:
        network, founders = _art2_with(encoding, classes)
        taken_us = [_art2_steps(network, founders, steps, number) for number in range(rounds)]
        medians = spread([percentile(round_us, 50) for round_us in taken_us])
        inputs = input_count(encoding)
        case: dict[str, Value] = {
            "encoding": encoding,
            "inputs": inputs,
            "classes": classes,
            "classifications_per_s": spread([1e6 / percentile(round_us, 50) for round_us in taken_us]),
            "step_median_us": medians,
            "step_p99_us": spread([percentile(round_us, 99) for round_us in taken_us]),
        }
        if (inputs, classes) == (12, 20):
            case |= {"target_us": ART2_TARGET_US, "target_met": medians["median"] <= ART2_TARGET_US}
        cases.append(case)
    return {"rounds": rounds, "steps": steps, "cases": cases}


def learner(definition: Definition, seed: int, steps: int, rounds: int) -> dict[str, Value]:
    """Measure updates of a table, and decisions with the update before them, in episodes of 100 decisions."""
    if not isinstance(definition.learner, TdSettings):
        raise TreenailError(f"bench learner: expected q_learning or sarsa, got {kind_of(definition.learner)!r}")
    subject = Learner(definition.moves.actions, definition.learner, definition.policy, seed)
    updates, decides_us = [], []
    for number in range(rounds):
        draws = np.random.Generator(np.random.Philox(key=number))
        states = draws.integers(STATES, size=steps + 1).tolist()
        actions = draws.integers(definition.moves.actions, size=steps + 1).tolist()
        began = time.perf_counter()
        for n in range(steps):
            subject.update(states[n], actions[n], -1.0, states[n + 1], actions[n + 1])
        updates.append(steps / (time.perf_counter() - began))
        decides_us.append(_decides(subject, states, actions))
    return {
        "experiment": definition.name,
        "rounds": rounds,
        "steps": steps,
        "states": STATES,
        "actions": definition.moves.actions,
        "updates_per_s": spread(updates),
        "decide_median_us": spread([percentile(round_us, 50) for round_us in decides_us]),
        "decide_p99_us": spread([percentile(round_us, 99) for round_us in decides_us]),
    }


def _sweep(definition: Definition, seed: int, moves: int, *, in_contact: bool) -> float:
    """Return the time [s] of moves to and fro along X, high above the hole or pressed on its rim.

    The arm makes them exactly: with its errors it would wander off the rim. Raises TreenailError when the peg is not
    where it should be.
    """
    limits = replace(definition.limits, move_limit=3 * definition.limits.move_limit + moves)
    start = definition.start if in_contact else replace(definition.start, height_mm=20.0)
    cell = SimulatedCell(replace(definition, noise=Noise(), start=start, limits=limits), _RUN, seed)
    tilt = {"rx_deg": start.rx_deg, "ry_deg": start.ry_deg, "rz_deg": start.rz_deg}
    cell.home(Home(run=_RUN, episode=0, x_mm=start.x_mm, y_mm=start.y_mm, z_mm=-start.height_mm, **tilt))
    step = _press(cell, definition) if in_contact else 0
    size_mm = definition.moves.lateral_mm
    sweep = [
        Move(run=_RUN, episode=0, step=step + n, dx_mm=size_mm if n % 2 else -size_mm) for n in range(1, moves + 1)
    ]
    began = time.perf_counter()
    packets = [cell.move(move)[1] for move in sweep]
    seconds = time.perf_counter() - began
    touching = sum(_force(packet) >= limits.contact_force_n for packet in packets)
    if touching != (moves if in_contact else 0):
        raise TreenailError(f"bench: expected {'all' if in_contact else 'no'} moves in contact, got {touching}")
    return seconds


def _press(cell: SimulatedCell, definition: Definition) -> int:
    """Go down until both ends of the sweep press on the rim, and return the number of moves that it took.

    Raises TreenailError when they do not within an episode's moves.
    """
    limits, size_mm = definition.limits, definition.moves.lateral_mm
    step, felt_n = 0, [0.0]
    for _ in range(limits.move_limit):
        felt_n = []
        for motion in ({"dz_mm": definition.moves.insertion_mm}, {"dx_mm": size_mm}, {"dx_mm": -size_mm}):
            step += 1
            felt_n.append(_force(cell.move(Move(run=_RUN, episode=0, step=step, **motion))[1]))
        if min(felt_n) >= 2 * limits.contact_force_n:
            return step
    raise TreenailError(f"bench: expected contact within {limits.move_limit} moves down, felt {min(felt_n):g} N")


def _force(packet: FtPacket) -> float:
    return math.hypot(*packet.force_n[-1])


def _art2_with(encoding: Encoding, classes: int) -> tuple[Art2, NDArray[np.float64]]:
    """Return a network that has so many classes, and the vectors that founded them, shape (classes, 6)."""
    network = Art2(Art2Settings(encoding=encoding, rho=0.97, torque_gain_per_m=1.0, capacity=classes))
    draws = np.random.Generator(np.random.Philox(key=classes))
    founders: list[NDArray[np.float64]] = []
    for _ in range(MOST_DRAWS):
        vector = draws.standard_normal(6)
        vector /= np.linalg.norm(vector)
        if network.learn(vector[:3].tolist(), vector[3:].tolist()).new:
            founders.append(vector)
        if network.states == classes:
            return network, np.array(founders)
    raise TreenailError(f"bench: expected {classes} classes within {MOST_DRAWS} draws, got {network.states}")


def _art2_steps(network: Art2, founders: NDArray[np.float64], steps: int, number: int) -> list[float]:
    """Return what each step takes [us]; the vectors presented depend on ``number``."""
    draws = np.random.Generator(np.random.Philox(key=number))
    chosen = founders[draws.integers(len(founders), size=steps)]
    presented = (chosen + CLOSE * draws.standard_normal(chosen.shape)).tolist()
    taken_us = []
    for vector in presented:
        force, torque = vector[:3], vector[3:]
        began = time.perf_counter()
        network.learn(force, torque)
        taken_us.append(1e6 * (time.perf_counter() - began))
    return taken_us


def _decides(subject: Learner, states: list[int], actions: list[int]) -> list[float]:
    """Return what each decision takes [us]."""
    taken_us = []
    for n in range(len(states) - 1):
        previous = (states[n], actions[n], -1.0)
        began = time.perf_counter()
        subject.decide(previous, states[n + 1], n // 100, n % 100)
        taken_us.append(1e6 * (time.perf_counter() - began))
    return taken_us
