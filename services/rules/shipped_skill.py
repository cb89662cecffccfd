"""The skill that comes with Treenail, which ``make skill`` made; a command is told it by the name ``builtin``.

A task with other moves begins with it all the same: it is given that task's own.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path

from services.rules.skill import NamedSkill, SkillError, fits, parse_own, read
from services.rules.skill_moves import carried
from services.wire.definition import Definition
from services.wire.errors import ContractError

BUILTIN = "builtin"
"""Its name; a file that is called so is ``./builtin``."""
FILE = Path(__file__).with_name("skills") / f"{BUILTIN}.skill"


@cache
def builtin() -> NamedSkill:
    """Return the skill that comes with Treenail, as it was learnt. Raises SkillError when the installation lacks it."""
    try:
        return parse_own(FILE.read_bytes())
    except OSError as error:
        raise SkillError(f"{BUILTIN}: {FILE}: cannot be read: {error.strerror}") from error
    except (ContractError, SkillError) as error:
        raise SkillError(f"{BUILTIN}: {FILE}: {error}; `make skill` makes it again") from error


def named_or_file(what: str | Path) -> NamedSkill:
    """Return the skill that a command was told: ``builtin``, or a file. Raises SkillError."""
    return builtin() if str(what) == BUILTIN else read(Path(what))


def for_task(skill: NamedSkill, definition: Definition) -> NamedSkill:
    """Return what a run of a definition begins with: the skill itself where it fits.

    The one that comes with Treenail is given the task's moves where these are others: what was learnt of a move that
    both have is kept, the rest is unknown (``services.rules.skill_moves``). Any other skill is so changed only by
    somebody who asks for it. Raises SkillError when it does not fit.
    """
    try:
        fits(skill.skill, definition)
        return skill
    except SkillError:
        if skill.sha256 != builtin().sha256:
            raise
    try:
        mapped = carried(skill, definition).skill
        fits(mapped.skill, definition)
        return mapped
    except SkillError as error:
        raise SkillError(f"{BUILTIN}: does not fit {definition.name}: {error}") from None
