"""Where a board's results are: one file a finished run, named by all that it depends on, and what each has learnt.

Several boards, and several processes that each do some of the seeds, may share a folder: files are written whole or
not at all, and nobody overwrites what is not the same.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from experiments.leaderboard.jobs import Job, Outcome, key
from experiments.reproduce.cache import Cache
from services.rules import skill as skill_file
from services.rules.skill import NamedSkill, SkillError
from services.wire.errors import TreenailError

KIND = "leaderboard run"
RUNS, SKILLS = "runs", "skills"


class Folder:
    """The results of one ``--out``."""

    def __init__(self, path: Path, say: Callable[[str], None]) -> None:
        """Look into ``path``, which is made when something is kept. ``say`` hears what is wrong in it."""
        self.path = path
        self._cache = Cache(path / RUNS, say)
        self._say = say

    def outcome(self, job: Job) -> Outcome | None:
        """Return what came of a job, if it was done before; of one that learns, what was learnt is there too."""
        outcome = self._cache.load(KIND, key(job), Outcome)
        if outcome is not None and outcome.skill_sha256 is not None and not self._skill_path(outcome).exists():
            return None
        return outcome

    def keep(self, job: Job, outcome: Outcome, skill: bytes | None) -> None:
        """Keep what came of a job. A disk that takes nothing is reported."""
        if skill is not None:
            path = self._skill_path(outcome)
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                skill_file.write(path, skill_file.parse(skill), force=True)
            except (OSError, SkillError) as error:
                self._say(f"{path}: cannot be kept ({error})")
                return
        self._cache.keep(KIND, key(job), outcome, Outcome)

    def skill(self, outcome: Outcome) -> NamedSkill:
        """Return what was learnt in a run. Raises SkillError."""
        return skill_file.read(self._skill_path(outcome))

    @property
    def empty(self) -> bool:
        """Return whether no run is there."""
        return next((self.path / RUNS).rglob("*.json"), None) is None

    def prepare(self) -> None:
        """See that results can be kept. Raises TreenailError."""
        probe = self.path / RUNS / ".probe"
        try:
            probe.parent.mkdir(parents=True, exist_ok=True)
            probe.write_bytes(b"")
            probe.unlink(missing_ok=True)  # another process may have been faster
        except OSError as error:
            raise TreenailError(f"--out: expected a folder to write to, got {self.path}: {error.strerror}") from error

    def _skill_path(self, outcome: Outcome) -> Path:
        return self.path / SKILLS / f"{(outcome.skill_sha256 or '')[:24]}.skill"
