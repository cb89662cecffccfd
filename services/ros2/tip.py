"""Where the tip is commanded to, followed from what is decided: exact, or nothing is said. Pure.

Between two decisions of an episode are steps of guidance, known by their number. Who has missed a decision does not
know where the tip is until the next episode begins.
"""

from __future__ import annotations

from services.rules.poses import Pose
from services.rules.start_pose import start_pose
from services.rules.workspace import rotation
from services.wire.actions import Increment, guidance, increments
from services.wire.messages import Action, Experiment


class Tip:
    """The commanded tip of one run, in the frame of the hole as it stands upright."""

    def __init__(self, experiment: Experiment) -> None:
        self.run = experiment.run
        self._definition, self._seed = experiment.definition, experiment.seed
        moves = experiment.definition.moves
        self._increments, self._guidance = increments(moves), guidance(moves)
        self._centre_mm = moves.rotation_centre_mm
        self._episode = -1
        self._next = 0
        """Number of the decision that comes next; a run's first is 0."""
        self._first = 0
        """Of the episode under way."""
        self._at: tuple[Pose, int] | None = None
        """Commanded pose, and the motions before it."""

    def decided(self, action: Action) -> Pose | None:
        """Return where the tip is commanded to by a decision; None while that is not known."""
        decision, follows = action.decision, action.decision == self._next
        if action.episode != self._episode:
            # Who hears the first decision of an episode knows it by its number, or by having heard the one before.
            self._at = self._begun(action.episode) if follows else None
            self._episode, self._first = action.episode, decision
        elif decision == self._first and self._at is not None:
            self._at = self._begun(action.episode)  # an episode that begins again
        elif not follows:
            self._at = None
        self._next = decision + 1
        if self._at is None or action.action >= len(self._increments) or action.step < self._at[1]:
            self._at = None
            return None
        pose, made = self._at
        for _ in range(action.step - made):
            pose = pose.after(self._guidance, self._centre_mm)
        listed, other = self._increments[action.action], action.increment
        pose = pose.after(listed if other is None else Increment(*other), self._centre_mm)
        self._at = pose, action.step + 1
        return pose

    def _begun(self, episode: int) -> tuple[Pose, int]:
        home = start_pose(self._definition, self.run, self._seed, episode)
        turn = rotation(home.rx_deg, home.ry_deg, home.rz_deg)
        return Pose((home.x_mm, home.y_mm, home.z_mm), turn), 0
