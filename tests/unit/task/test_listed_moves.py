"""Moves as a list in the definition: what the task, the guard and a whole run make of them."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from experiments.journal.checks import step_troubles, summary_troubles
from experiments.lab.in_process import InProcessRun
from services.rules.guard import Guard
from services.rules.skill import SkillError, fits
from services.task.insertion import Insertion
from services.wire.actions import action_names, increments, lines, repeatable
from services.wire.definition import Definition, Limits, Moves, NamedMove
from services.wire.definition_file import definition_sha256, load, parse
from services.wire.definition_rules import contradiction
from services.wire.errors import DefinitionError
from services.wire.messages import Action, EpisodeSummary, FtPacket, Home, Move, Moved, Observation

LIST = """
name = "mine"
[moves]
insertion_mm = 0.2
[[moves.list]]
name = "right"
x_mm = 0.2
[[moves.list]]
name = "left"
x_mm = -0.2
[[moves.list]]
name = "down"
z_mm = 0.2
[[moves.list]]
name = "up"
z_mm = -0.2
[[moves.list]]
name = "screw"
z_mm = 0.1
rz_deg = 0.5
"""
RIGHT, LEFT, DOWN, UP, SCREW = range(5)
RUN = "mine-s0"
FORCE, TORQUE = (0.0, 0.0, -2.0), (0.0, 0.01, 0.0)


def definition(text: str = LIST, **limits: float) -> Definition:
    made = parse(text.encode(), "mine.toml")
    return replace(made, limits=Limits(**limits))  # type: ignore[arg-type]


def test_they_are_read_in_their_order() -> None:
    moves = definition().moves
    assert moves.count == 5
    assert action_names(moves) == ("right", "left", "down", "up", "screw")
    assert increments(moves)[SCREW] == (0.0, 0.0, 0.1, 0.0, 0.0, 0.5)
    assert repeatable(moves) == (True, True, False, False, False)
    assert lines(moves) == ((0, 0, 1, 1, 2), (1.0, -1.0, 1.0, -1.0, 1.0))


def test_the_numbered_ones_lie_on_lines_too() -> None:
    line, size = lines(Moves(actions=11))
    assert line == (0, 0, 1, 1, 2, 3, 3, 4, 4, 5, 5)
    assert size == (1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0)


@pytest.mark.parametrize(
    ("more", "complaint"),
    [
        ('[[moves.list]]\nname = "up"\nx_mm = 0.1\n', "moves.list: expected names that differ, got 'up' twice"),
        ('[[moves.list]]\nname = "rest"\n', "moves.list: expected moves that go somewhere, got 'rest', which does not"),
        ('[[moves.list]]\nname = "far"\nx_mm = 5\n', "x_mm: expected"),
    ],
)
def test_a_list_that_makes_no_sense_is_refused(more: str, complaint: str) -> None:
    with pytest.raises(DefinitionError, match=complaint):
        parse((LIST + more).encode(), "mine.toml")


def test_a_list_without_a_way_in_is_refused() -> None:
    conflict = contradiction(Definition(name="mine", moves=Moves(list=(NamedMove(name="up", z_mm=-0.1),))))
    assert conflict is not None and conflict[0] == "moves.list"


def test_a_definition_without_a_list_has_the_name_it_had() -> None:
    plain = load("initial")
    assert definition_sha256(plain) == definition_sha256(replace(plain, moves=replace(plain.moves, list=())))


def packet(sequence: int = 0) -> FtPacket:
    return FtPacket(sequence=sequence, t_ns=sequence, force_n=(FORCE,), torque_nm=(TORQUE,))


@pytest.mark.parametrize(
    ("changes", "passes"),
    [
        ({"dx_mm": 0.2}, True),
        ({"dz_mm": -0.2}, True),
        ({"dz_mm": 0.1, "rz_deg": 0.5}, True),
        ({"dz_mm": 0.2}, True),
        ({"dx_mm": 0.1}, False),
        ({"dx_mm": 0.2, "dz_mm": 0.2}, False),
        ({"dy_mm": 0.2}, False),
        ({"dz_mm": -0.4}, False),
        ({"rz_deg": 0.5}, False),
    ],
)
def test_the_guard_takes_what_is_listed_and_nothing_else(changes: dict[str, float], passes: bool) -> None:
    guard = Guard(definition())
    guard.homed(Home(run=RUN, episode=0, x_mm=1.6, y_mm=-2.2, z_mm=-1.0, rx_deg=1.8, ry_deg=0.4, rz_deg=0.0))
    complaint = guard.moving(Move(run=RUN, episode=0, step=1, **changes), packet(), 0.0)
    assert (complaint is None) == passes, complaint


class Pressed:
    """A task that always feels the same force: every motion is a decision's."""

    def __init__(self, made: Definition) -> None:
        self.definition = made
        self.task = Insertion(made, RUN, 0)
        self.task.home(0, 0)
        self.then = self.task.feel(Moved(run=RUN, episode=0, step=0, arrived_t_ns=0), FORCE, TORQUE).then

    def decide(self, action: int) -> Observation | EpisodeSummary:
        felt = self.then
        assert isinstance(felt, Observation)
        move = self.task.act(
            Action(
                run=RUN,
                episode=0,
                step=felt.step,
                decision=felt.decision,
                state=0,
                action=action,
                policy_version=0,
            )
        )
        dx_mm, _, dz_mm, _, _, rz_deg = increments(self.definition.moves)[action]
        assert (move.dx_mm, move.dz_mm, move.rz_deg) == (dx_mm, dz_mm, rz_deg)
        moved = Moved(run=RUN, episode=0, step=move.step, arrived_t_ns=0, dx_mm=dx_mm, dz_mm=dz_mm, rz_deg=rz_deg)
        then = self.task.feel(moved, FORCE, TORQUE).then
        assert isinstance(then, Observation | EpisodeSummary)
        self.then = then
        return then


def test_going_up_and_down_again_is_no_progress() -> None:
    pressed = Pressed(definition(no_progress_moves=7))
    assert isinstance(pressed.decide(DOWN), Observation)
    for turn in range(4):
        for action in (UP, DOWN):
            then = pressed.decide(action)
            if isinstance(then, EpisodeSummary):
                assert (turn, action) == (3, DOWN)
                assert then.outcome == "no_progress"
                return
    raise AssertionError("it went on for ever")


def test_deeper_than_before_is_progress() -> None:
    pressed = Pressed(definition(no_progress_moves=3))
    for _ in range(6):
        for action in (UP, DOWN, SCREW):
            assert isinstance(pressed.decide(action), Observation)


def test_the_previous_decision_is_told_beside_the_sample() -> None:
    pressed = Pressed(definition())
    assert isinstance(pressed.then, Observation) and pressed.then.previous_action is None
    then = pressed.decide(UP)
    assert isinstance(then, Observation) and then.previous_action == UP


def test_a_whole_run_keeps_its_promises() -> None:
    felt = (
        'learner={kind="felt"}',
        'policy={kind="thompson"}',
        "shaping={price_per_n=2.0, gamma=1.0}",
        'felt={torque="lever", lever_mm=-130.0}',
        "limits.move_limit=200",
        "limits.no_progress_moves=40",
        "moves.list=[{name='+X',x_mm=0.2},{name='-X',x_mm=-0.2},{name='+Y',y_mm=0.2},{name='-Y',y_mm=-0.2},"
        "{name='+Z',z_mm=0.2},{name='-Z',z_mm=-0.2},{name='+RX',rx_deg=0.2},{name='-RX',rx_deg=-0.2},"
        "{name='+RY',ry_deg=0.2},{name='-RY',ry_deg=-0.2},{name='slant',x_mm=0.1,z_mm=0.1}]",
    )
    made = load("suite-round", felt)
    run = InProcessRun(made, 11)
    for summary in run.episodes(4):
        record = run.task.record()
        steps, known = record.steps, max(step.state or 0 for step in record.steps) + 1
        assert not [*summary_troubles(made, steps, summary, known)]
        for index in range(len(steps)):
            assert not [*step_troubles(made, steps, index)]
    names = {action_names(made.moves)[step.action or 0] for step in run.task.record().steps}
    assert names
    skill = run.learnt().skill
    fits(skill, made)
    with pytest.raises(SkillError, match="actions"):
        fits(skill, load("suite-round"))
