"""The insertion task as a Gymnasium environment, ``treenail/PegInHole-v0``: every step is a decision in contact.

Task and cell are those of every other run, so that the same decisions give the same forces, rewards and ends. What an
agent meets is as there: with nothing touched the peg is taken on in +Z without a question (thesis 6.2.2).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium import error

from experiments.lab.guided import Reached, make, told
from services.rules.guard import increment_of
from services.rules.motions import GuardError
from services.sim.cell import SimulatedCell
from services.sim.pose import Pose
from services.sim.world import World
from services.task.insertion import Insertion
from services.wire.definition import Definition
from services.wire.definition_file import run_id
from services.wire.errors import TreenailError
from services.wire.message_base import LONGEST_RUN
from services.wire.messages import EpisodeSummary, FtPacket, Home, Move, Moved, Observation
from services.wire.randomness import MAX_SEED
from treenail.api import Setting, load
from treenail.gym.spaces import MOST_HISTORY, AnyMoves, Array, Feeling, ListedMoves, with_bounds
from treenail.registration import NAME

if TYPE_CHECKING:
    from experiments.picture.scene import Scene
    from treenail.gym.watching import Watched

TERMINAL = ("inserted", "collision")
"""Outcomes that are the task's own; the others are limits."""
REFUSED = "refused"
"""Outcome of an episode whose next motion the guard beside the robot refused; nothing moved then."""
SKIPPED_AT_MOST = 100
"""Episodes in a row that end before there is anything to decide."""
OF_EPISODE = ("episode_number", "outcome", "moves", "mean_force_n", "peak_force_n")
"""What ``info`` says of an episode that was passed over."""
PER_SECOND = 50
"""Motions in a second of the simulator's clock."""


class PegInHole(gymnasium.Env[Array, Any]):
    """One peg, one hole, one cell. docs/python.md says what is observed, done, and told in ``info``."""

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": PER_SECOND}  # noqa: RUF012

    def __init__(
        self,
        definition: str | Definition = "chamfered-q-softmax",
        *,
        overrides: Mapping[str, Setting] | Iterable[str] = (),
        history: int = 0,
        orientation: bool = False,
        continuous: bool = False,
        render_mode: str | None = None,
        **settings: Setting,
    ) -> None:
        """Build the cell of a definition, or of one by name or file, with settings changed as ``treenail.load`` does.

        ``settings`` may have dotted keys too: ``**{"limits.move_limit": 200}``. ``history`` wrenches of decisions
        before are observed along, with ``orientation`` how the tool is turned; with ``continuous`` any small move can
        be made. Raises TreenailError for what cannot be.
        """
        if render_mode is not None and render_mode not in self.metadata["render_modes"]:
            raise TreenailError(f"{NAME}: render_mode: expected rgb_array or human, got {render_mode!r}")
        if not isinstance(history, int) or not 0 <= history <= MOST_HISTORY:
            raise TreenailError(f"{NAME}: history: expected 0 to {MOST_HISTORY}, got {history!r}")
        given = _definition(definition, overrides, settings)
        self.definition = with_bounds(given) if continuous else given
        self.render_mode = render_mode
        self._feeling = Feeling(history, orientation)
        self._moves = AnyMoves(self.definition) if continuous else ListedMoves(self.definition)
        self.observation_space, self.action_space = self._feeling.space, self._moves.space
        self._first_world = World(self.definition)
        self._seed: int | None = None
        self._episode = -1
        self._decisions = 0
        """Made in this episode."""
        self._asked: Observation | None = None
        """Waits for a step; None before reset and after the end."""
        self._forces_n: list[float] = []
        self._scene: Scene | None = None
        self._watched: Watched | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin an episode, up to its first decision.

        With a ``seed`` a run of that seed begins with its episode 0: start poses and errors of arm and sensor are those
        of ``treenail experiment run`` with it. Without one the run goes on with its next episode;
        ``options={"episode": n}`` takes any. Episodes that end at the first touch, without a decision, are passed over
        and counted in ``info["passed_over"]``; ``info["passed"]`` says how each went. Raises TreenailError when
        it is none but such.
        """
        super().reset(seed=seed)
        if seed is not None or self._seed is None:
            self._begin_run(int(self.np_random.integers(2**31)) if seed is None else seed)
        self._episode = _episode(options, self._episode + 1)
        passed = list[dict[str, Any]]()
        while len(passed) < SKIPPED_AT_MOST:
            self._decisions = 0
            self._forces_n.clear()
            self._feeling.begin()
            reached = make(self._task, self._cell, self._home(), self._see)
            if isinstance(reached.then, Observation):
                self._asked = reached.then
                self._show()
                return self._observe(reached.packet), {
                    **self._info(reached),
                    "passed_over": len(passed),
                    "passed": passed,
                }
            passed.append({key: value for key, value in self._info(reached).items() if key in OF_EPISODE})
            self._episode += 1
        raise TreenailError(
            f"{NAME}: {self.definition.name}: expected something to decide in one of {SKIPPED_AT_MOST} episodes, "
            f"got the end of each at its first touch: {passed[-1]['outcome']}"
        )

    def step(self, action: Any) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Make a move, and go on to the next decision or the end. Raises ResetNeeded after it, InvalidAction."""
        if self._asked is None:
            raise error.ResetNeeded(f"{NAME}: step: expected reset() first, the episode is over or has not begun")
        if not self.action_space.contains(action):
            raise error.InvalidAction(f"{NAME}: step: expected an action of {self.action_space}, got {action!r}")
        asked, self._asked = self._asked, None
        number, increment = self._moves.move(action)
        move = self._task.act(told(asked, number, increment=increment))
        try:
            reached = make(self._task, self._cell, move, self._see)
        except GuardError as refusal:
            return self._observe(self._packet), 0.0, False, True, {**self._info(None, move), "complaint": str(refusal)}
        self._decisions += 1
        self._show(reached)
        reward = 0.0 if reached.reward is None else reached.reward.reward
        info = self._info(reached, move)
        if isinstance(reached.then, Observation):
            self._asked = reached.then
            return self._observe(reached.packet), reward, False, False, info
        terminated = reached.then.outcome in TERMINAL
        return self._observe(reached.packet), reward, terminated, not terminated, info

    def render(self) -> Any:
        """Return a picture, shape (540, 480, 3), with ``rgb_array``; with ``human`` the viewers are served anyway."""
        if self.render_mode != "rgb_array":
            return None
        from experiments.picture.scene import Scene, Shot

        if self._scene is None:
            self._scene = Scene(self.definition)
        if self._seed is None:
            raise error.ResetNeeded(f"{NAME}: render: expected reset() first")
        caption = f"{self.definition.name}, seed {self._seed}, episode {self._episode}"
        return self._scene.picture(Shot(self._cell.world.peg, self._packet.force_n[-1], self._forces_n, caption))

    def close(self) -> None:
        """End; viewers are served no longer."""
        if self._watched is not None:
            self._watched.close()
            self._watched = None
        self._asked = None

    # -- details -------------------------------------------------------------------------------------------------

    def _begin_run(self, seed: int) -> None:
        if not 0 <= seed <= MAX_SEED:
            raise TreenailError(f"{NAME}: seed: expected 0 to {MAX_SEED}, got {seed}")
        self._seed, self._episode = seed, -1
        run = run_id(self.definition, seed)
        # Where parts change in the course of a run, a cell goes on with a world of its own.
        self._cell = SimulatedCell(self.definition, run, seed, self._first_world)
        self._task = Insertion(self.definition, run, seed)

    def _home(self) -> Home:
        # Decisions are numbered within the episode: which were made before it nobody here depends on.
        home = self._task.home(self._episode, 0)
        self._commanded = Pose.from_tilt(home.x_mm, home.y_mm, home.z_mm, home.rx_deg, home.ry_deg, home.rz_deg)
        return home

    def _see(self, moved: Moved, packet: FtPacket) -> None:
        self._packet = packet
        if moved.step:
            centre_mm = self.definition.moves.rotation_centre_mm
            self._commanded = self._commanded.moved(increment_of(moved), centre_mm)
            self._forces_n.append(math.hypot(*packet.force_n[-1]))
        if self.render_mode == "human":
            if self._watched is None:
                from treenail.gym.watching import Watched

                self._watched = Watched(self.definition)
            self._watched.see(moved, packet, self._cell.world, self._seed or 0)

    def _show(self, reached: Reached | None = None) -> None:
        if self._watched is not None:
            self._watched.show(reached)

    def _observe(self, packet: FtPacket) -> Array:
        return self._feeling.feel(packet.force_n[-1], packet.torque_nm[-1], self._commanded)

    def _info(self, reached: Reached | None, move: Move | None = None) -> dict[str, Any]:
        """Return what an agent must not learn from, but who judges it may know; docs/python.md has the list."""
        over = reached.then if reached is not None and isinstance(reached.then, EpisodeSummary) else None
        forces = self._forces_n
        return {
            "seed": self._seed,
            "episode_number": self._episode,
            "decision": self._decisions,
            "moves": len(forces),
            "contact": self._cell.world.contact_state(),
            "peg_mm_quat": np.array(self._cell.world.peg),
            "flange_mm_quat": np.array(self._cell.world.flange),
            "force_n": forces[-1] if forces else 0.0,
            "mean_force_n": math.fsum(forces) / max(len(forces), 1),
            "peak_force_n": max(forces, default=0.0),
            "increment_mm_deg": np.zeros(6) if move is None else np.array(_components(move)),
            "outcome": REFUSED if reached is None else "" if over is None else over.outcome,
            "inserted": over is not None and over.outcome == "inserted",
        }


def _definition(
    definition: str | Definition, overrides: Mapping[str, Setting] | Iterable[str], settings: Mapping[str, Setting]
) -> Definition:
    changes = overrides if isinstance(overrides, Mapping) else list(overrides)
    if isinstance(definition, Definition):
        if changes or settings:
            raise TreenailError(f"{NAME}: expected a definition as it is, or the name of one with changes, got both")
        return definition
    return load(definition, changes, **settings)


def _episode(options: dict[str, Any] | None, following: int) -> int:
    unknown = sorted(set(options or ()) - {"episode"})
    if unknown:
        raise TreenailError(f"{NAME}: options: expected episode, got {', '.join(map(str, unknown))}")
    episode = (options or {}).get("episode", following)
    if not isinstance(episode, int) or not 0 <= episode < LONGEST_RUN:
        raise TreenailError(f"{NAME}: episode: expected 0 to {LONGEST_RUN - 1}, got {episode!r}")
    return episode


def _components(move: Move) -> tuple[float, ...]:
    return (move.dx_mm, move.dy_mm, move.dz_mm, move.rx_deg, move.ry_deg, move.rz_deg)
