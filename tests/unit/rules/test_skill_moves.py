"""A skill carried over to other moves: what is kept, what is unknown, and when nothing can be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from experiments.evaluate.controllers import Choice
from experiments.evaluate.frozen import FrozenSkill
from experiments.evaluate.trial import trial
from experiments.lab.in_process import InProcessRun
from services.agent.felt import FeltLearner
from services.agent.fold import learner_of
from services.rules import skill as skill_file
from services.rules.command_line import Parser
from services.rules.skill import NamedSkill, SkillError
from services.rules.skill_memory import untried
from services.rules.skill_moves import carried
from services.rules.wrench import Wrench
from services.wire.actions import ACTION_NAMES
from services.wire.definition import Definition, Moves, NamedMove, Plugin
from services.wire.definition_file import load
from services.wire.messages import Observation
from treenail.commands import checkpoint

ROUND, SQUARE = load("suite-round"), load("suite-square")
TABLE, TABLE_SQUARE = load("chamfered-q-softmax"), load("square-q-softmax")
FELT = Wrench((0.4, -0.3, -1.2), (0.02, 0.05, -0.01))


def learnt(definition: Definition, episodes: int = 4) -> NamedSkill:
    run = InProcessRun(definition, 3)
    list(run.episodes(episodes))
    return run.learnt()


@pytest.fixture(scope="module")
def round_skill() -> NamedSkill:
    return learnt(ROUND)


@pytest.fixture(scope="module")
def table_skill() -> NamedSkill:
    return learnt(TABLE)


def columns(skill: NamedSkill, name: str, kind: str) -> np.ndarray:
    block = skill.skill.agent[name]
    assert isinstance(block, bytes)
    return np.frombuffer(block, kind).reshape(-1, len(skill.skill.actions))


def test_a_table_keeps_the_columns_of_moves_that_both_have(table_skill: NamedSkill) -> None:
    made = carried(table_skill, TABLE_SQUARE)
    skill_file.fits(made.skill.skill, TABLE_SQUARE)
    assert made.skill.skill.actions == ACTION_NAMES
    assert made.unknown == ("+RZ", "-RZ") and not made.left_out
    assert made.kept[0] == "+X (0.2 to 0.1)" and "+Z" in made.kept
    for name, kind in (("q", "<f8"), ("visits", "<i8")):
        before, after = columns(table_skill, name, kind), columns(made.skill, name, kind)
        assert (after[:, :9] == before).all() and not after[:, 9:].any()
    assert made.skill.version == table_skill.version and made.skill.states == table_skill.states
    assert untried(made.skill.skill.agent) == (9, 10)


def test_what_is_thought_of_a_kept_move_is_what_it_was(round_skill: NamedSkill) -> None:
    made = carried(round_skill, SQUARE)
    opinions = []
    for skill in (round_skill, made.skill):
        learner = learner_of(skill.skill.definition, 0)
        assert isinstance(learner, FeltLearner)
        learner.restore(skill.skill.agent)
        opinions.append(learner.opinion(1, FELT, 0))
    before, after = opinions
    assert after.values[:9].tolist() == before.values.tolist()
    assert after.deviation[:9].tolist() == before.deviation.tolist()
    blank = learner_of(SQUARE, 0)
    assert isinstance(blank, FeltLearner)
    unknown = blank.opinion(1, FELT, 0)
    assert after.values[9:].tolist() == unknown.values[9:].tolist()
    assert after.deviation[9:].tolist() == unknown.deviation[9:].tolist()


def test_moves_in_another_order_and_of_several_sizes_are_told_by_name(round_skill: NamedSkill) -> None:
    moves = (
        NamedMove(name="+Z", z_mm=0.2),
        NamedMove(name="far", x_mm=0.4),
        NamedMove(name="-X", x_mm=-0.1),
        NamedMove(name="+X", x_mm=0.1),
        NamedMove(name="+Y", x_mm=0.2),
    )
    made = carried(round_skill, replace(ROUND, moves=Moves(list=moves)))
    assert made.kept == ("+Z", "-X (0.2 to 0.1)", "+X (0.2 to 0.1)")
    assert made.unknown == ("far", "+Y"), "of the name, but another way"
    assert set(made.left_out) == set(ACTION_NAMES[:9]) - {"+Z", "-X", "+X"}
    before, after = learner_of(ROUND, 0), learner_of(made.skill.skill.definition, 0)
    assert isinstance(before, FeltLearner) and isinstance(after, FeltLearner)
    before.restore(round_skill.skill.agent)
    after.restore(made.skill.skill.agent)
    theirs, ours = before.opinion(0, FELT, 0), after.opinion(0, FELT, 0)
    assert ours.values[[0, 2, 3]] == pytest.approx(theirs.values[[4, 1, 0]])


def test_it_is_a_sound_skill_with_the_same_bytes_each_time_and_says_whence_it_came(round_skill: NamedSkill) -> None:
    made = carried(round_skill, SQUARE).skill
    assert skill_file.parse(skill_file.file_bytes(made)) == made
    assert carried(skill_file.parse(skill_file.file_bytes(round_skill)), SQUARE).skill == made
    inside = made.skill
    assert inside.skill_sha256 == round_skill.sha256
    assert inside.definition.source.startswith(f"skill {round_skill.sha256[:12]} of suite-round, with the moves of")
    assert "unknown +RZ -RZ" in inside.definition.source
    assert inside.definition == replace(ROUND, moves=SQUARE.moves, source=inside.definition.source)


def test_a_run_goes_on_with_it_and_learns_the_moves_that_are_new(round_skill: NamedSkill) -> None:
    made = carried(round_skill, SQUARE).skill
    run = InProcessRun(SQUARE, 5, skill=made)
    list(run.episodes(2))
    assert untried(run.learnt().skill.agent) == ()
    assert run.learnt().skill.episodes == round_skill.skill.episodes + 2


class Heard(FrozenSkill):
    """A frozen skill whose moves are noted."""

    def __init__(self, skill: NamedSkill, definition: Definition) -> None:
        super().__init__(skill, definition, 7)
        self.moves = set[int]()

    def decide(self, felt: Observation) -> Choice:
        choice = super().decide(felt)
        self.moves.add(choice.action)
        return choice


def test_frozen_it_never_makes_a_move_that_it_does_not_know(round_skill: NamedSkill, table_skill: NamedSkill) -> None:
    """An unknown move is worth 0, more than any that costs."""
    for skill, task in ((round_skill, SQUARE), (table_skill, TABLE_SQUARE)):
        controller = Heard(carried(skill, task).skill, task)
        trial(task, controller, 7, 1)
        assert controller.moves and max(controller.moves) < 9


def test_where_nothing_is_kept_it_says_so(round_skill: NamedSkill) -> None:
    other = replace(ROUND, moves=Moves(list=(NamedMove(name="in", z_mm=0.2), NamedMove(name="+X", x_mm=-0.2))))
    with pytest.raises(SkillError, match=r"expected a move of suite-round that it has learnt \(\+X, .*\), got in, \+X"):
        carried(round_skill, other)


def test_a_memory_that_only_a_plug_in_knows_is_not_taken_apart(round_skill: NamedSkill) -> None:
    inside = replace(round_skill.skill.definition, learner=Plugin(name="elsewhere"))
    skill = NamedSkill(round_skill.sha256, replace(round_skill.skill, definition=inside))
    with pytest.raises(SkillError, match="got the plug-in elsewhere"):
        carried(skill, SQUARE)


def mapped(*words: str) -> None:
    parser = Parser(prog="treenail checkpoint")
    checkpoint.add_arguments(parser)
    checkpoint.act(parser.parse_args(["map", *words]))


def test_the_command_writes_a_file_that_fits(
    tmp_path: Path, round_skill: NamedSkill, capsys: pytest.CaptureFixture[str]
) -> None:
    source, made, other = (str(tmp_path / name) for name in ("a.skill", "b.skill", "c.skill"))
    skill_file.write(Path(source), round_skill)
    mapped(source, made, "--experiment", "suite-square")
    assert "suite-square: kept +X (0.2 to 0.1)" in capsys.readouterr().out
    skill_file.fits(skill_file.read(Path(made)).skill, SQUARE)
    with pytest.raises(SkillError, match="--force"):
        mapped(source, made, "--experiment", "suite-square")
    with pytest.raises(SkillError, match="expected learner"):
        mapped(source, other, "--experiment", "square-q-softmax")
    assert not Path(other).exists()
