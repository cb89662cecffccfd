"""The skill that comes with Treenail: sound, small, given each task's moves, refused in words where it says nothing."""

from __future__ import annotations

from pathlib import Path

import pytest

from services.rules import shipped_skill
from services.rules.shipped_skill import BUILTIN, builtin, for_task, named_or_file
from services.rules.skill import SkillError, file_bytes, fits, named, parse, parse_own, write
from services.rules.skill_memory import untried
from services.wire.actions import action_names
from services.wire.codec import contract_sha256
from services.wire.definition_file import load, shipped
from services.wire.errors import BadPayloadError

LEARNT_OTHERWISE = [
    name for name in shipped() if name.startswith(("suite-chamferless", "suite-turned")) or not name.startswith("suite")
]


def test_it_is_small_and_of_todays_contract() -> None:
    assert shipped_skill.FILE.stat().st_size < 100_000
    assert builtin().skill.contract_sha256 == contract_sha256()
    assert builtin().skill.skill_sha256 is None, "it was learnt from nothing"
    assert parse(file_bytes(builtin())) == builtin()


def test_a_contract_that_changed_since_does_not_make_it_strange(monkeypatch: pytest.MonkeyPatch) -> None:
    content = shipped_skill.FILE.read_bytes()
    tomorrow = "ab" * 32
    monkeypatch.setattr("services.rules.skill.contract_sha256", lambda: tomorrow)
    with pytest.raises(BadPayloadError, match=f"expected contract {tomorrow[:12]}"):
        parse(content)
    own = parse_own(content)
    assert own.skill.contract_sha256 == tomorrow
    assert own.skill.agent == builtin().skill.agent and own.skill.classifier == builtin().skill.classifier


def test_it_is_asked_for_by_name_and_a_file_by_its_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert named_or_file(BUILTIN) is builtin()
    with pytest.raises(SkillError, match="expected a file with a skill, got none"):
        named_or_file("./builtin/x")
    write(tmp_path / "mine.skill", builtin())
    assert named_or_file("mine.skill") == builtin()


@pytest.mark.parametrize(
    "name", sorted(name for name in shipped() if name.startswith("suite") and name not in LEARNT_OTHERWISE)
)
def test_it_is_given_the_moves_of_every_task_that_feels_alike(name: str) -> None:
    task = load(name)
    given = for_task(builtin(), task)
    fits(given.skill, task)
    assert given.skill.actions == action_names(task.moves)
    assert not untried(given.skill.agent), "every move of the suite was learnt"
    assert given.skill.episodes == builtin().skill.episodes, "it draws as little as after all of its episodes"
    assert for_task(builtin(), task).sha256 == given.sha256


@pytest.mark.parametrize("name", LEARNT_OTHERWISE)
def test_a_task_that_feels_or_learns_otherwise_is_refused_in_one_line(name: str) -> None:
    with pytest.raises(SkillError) as error:
        for_task(builtin(), load(name))
    said = str(error.value)
    assert said.startswith(f"builtin: does not fit {name}: skill: expected ") and "\n" not in said


def test_any_other_skill_is_changed_by_nobody(tmp_path: Path) -> None:
    other = for_task(builtin(), load("suite-round"))
    assert for_task(other, load("suite-round")) is other
    with pytest.raises(SkillError, match=r"^skill: expected the actions"):
        for_task(other, load("suite-square"))


def test_a_damaged_one_says_how_it_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    damaged = tmp_path / "builtin.skill"
    damaged.write_bytes(shipped_skill.FILE.read_bytes()[:-1])
    monkeypatch.setattr(shipped_skill, "FILE", damaged)
    with pytest.raises(SkillError, match=r"^builtin: .*builtin\.skill: expected .* bytes .*`make skill`"):
        builtin.__wrapped__()
    damaged.unlink()
    with pytest.raises(SkillError, match=r"^builtin: .*cannot be read: No such file"):
        builtin.__wrapped__()
    assert named(builtin().skill) == builtin()
