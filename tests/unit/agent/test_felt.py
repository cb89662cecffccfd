"""The felt learner: what it learns of a move and of what follows, how it chooses, and that it is a fold."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
import pytest
from msgspec.structs import replace

from experiments.lab.in_process import InProcessRun
from services.agent.felt import FeltLearner
from services.agent.fold import AgentFold, learner_of
from services.classifier.fold import ClassifierFold
from services.rules import skill as skill_file
from services.rules.plugins import Lesson, feels
from services.rules.wrench import Wrench
from services.wire.definition import FeltModel, Greedy, Moves, NamedMove, Policy, Softmax, Thompson
from services.wire.definition_file import load
from services.wire.errors import TreenailError

MOVES = Moves()
INSERT = 4
USUAL = FeltModel()
PRESSED = Wrench((0.0, 0.0, -2.0), (0.0, 0.0, 0.0))
LEFT = Wrench((1.5, 0.0, -1.0), (0.0, 0.1, 0.0))
WIDE = Thompson(width=5.0, width_fade=0.0)


def learner(policy: Policy = WIDE, seed: int = 3, settings: FeltModel = USUAL, moves: Moves = MOVES) -> FeltLearner:
    return FeltLearner(moves, settings, policy, seed)


def felt_at(draws: np.random.Generator) -> Wrench:
    fx, fy, fz, tx, ty, tz = draws.normal(0.0, 1.0, 6).tolist()
    return Wrench((fx, fy, fz - 1.0), (0.1 * tx, 0.1 * ty, 0.1 * tz))


def run(subject: FeltLearner, episodes: int, first: int = 0) -> list[int]:
    """Teach made-up episodes, in which moves along the lateral force are worth most; return all that it decided."""
    decided = []
    for episode in range(first, first + episodes):
        draws = np.random.default_rng(episode)
        previous: Lesson | None = None
        for step in range(12):
            state, felt = int(draws.integers(5)), felt_at(draws)
            action = subject.decide_felt(previous, state, felt, episode, step)
            decided.append(action)
            gain = (felt.force_n[0], -felt.force_n[0], felt.force_n[1], -felt.force_n[1])
            reward = gain[action] if action < 4 else -1.0
            previous = Lesson(state, action, reward, felt)
        assert previous is not None
        outcome: Literal["inserted", "collision"] = "inserted" if episode % 3 else "collision"
        subject.finish_felt(previous._replace(outcome=outcome, reward=-100.0 if outcome == "collision" else 0.0))
    return decided


def test_it_is_a_learner_that_feels() -> None:
    assert feels(learner())


def test_what_a_move_earns_is_learnt_by_what_is_felt_also_where_it_never_was() -> None:
    subject = learner()
    run(subject, 60)
    assert subject.opinion(0, LEFT, 0).model[:2].argmax() == 0
    mirrored = Wrench((-1.5, 0.0, -1.0), (0.0, -0.1, 0.0))
    assert subject.opinion(999, mirrored, 0).model[:2].argmax() == 1


def test_what_one_move_teaches_its_opposite_knows() -> None:
    subject = learner()
    for _ in range(20):
        subject.finish_felt(Lesson(0, 0, 3.0, LEFT, "inserted"))
    opinion = subject.opinion(0, LEFT, 0)
    assert opinion.model[0] == pytest.approx(3.0, abs=0.1)
    assert opinion.model[1] != 0.0
    assert opinion.model[2] == 0.0  # another line
    assert opinion.deviation[1] < opinion.deviation[2]


def test_the_table_learns_what_follows() -> None:
    subject = learner(settings=FeltModel(gamma=0.5, follow=1.0, alpha=0.5, alpha_least=0.25))
    subject.finish_felt(Lesson(7, INSERT, 4.0, PRESSED, "inserted"))
    best = subject.opinion(7, PRESSED, 0).values.max()
    subject.decide_felt(Lesson(3, 0, -1.0, LEFT), 7, PRESSED, 0, 1)
    first = 0.5 * 0.5 * best  # the model of +X changed, that of the best move, +Z, did not
    assert subject.values(3)[0] == pytest.approx(first)
    subject.decide_felt(Lesson(3, 0, -1.0, LEFT), 7, PRESSED, 0, 1)
    assert subject.values(3)[0] == pytest.approx(first + 0.5 * (0.5 * best - first))
    subject.decide_felt(Lesson(3, 0, -1.0, LEFT), 7, PRESSED, 0, 1)
    assert subject.visits[3, 0] == 3
    assert subject.version == 4


def test_what_follows_counts_within_its_limit() -> None:
    subject = learner(settings=FeltModel(follow=1.0, alpha=1.0, value_limit=2.0))
    for _ in range(30):
        subject.finish_felt(Lesson(7, INSERT, 15.0, PRESSED, "inserted"))
    subject.decide_felt(Lesson(3, 0, -1.0, LEFT), 7, PRESSED, 0, 1)
    assert subject.values(3)[0] == 2.0


def test_what_follows_counts_less_with_each_insertion_in_a_row_until_an_episode_fails() -> None:
    subject = learner(settings=FeltModel(follow=0.5, follow_fade=0.1, alpha=1.0, alpha_least=1.0, value_limit=2.0))
    counted = []
    for outcome in ("inserted", "inserted", "collision", "inserted", "no_progress", "inserted"):
        subject.finish_felt(Lesson(7, INSERT, 100.0, PRESSED, "inserted"))
        subject.finish_felt(Lesson(7, INSERT, 100.0, PRESSED, outcome))
        subject.decide_felt(Lesson(3, 0, -1.0, LEFT), 7, PRESSED, 0, 1)
        counted.append(subject.values(3)[0])
    in_a_row = [2, 4, 0, 2, 0, 2]
    assert counted == pytest.approx([2.0 * 0.5 * math.exp(-0.1 * count) for count in in_a_row])


def test_a_part_of_what_follows_never_fades() -> None:
    settings = FeltModel(follow=0.5, follow_fade=0.1, follow_least=0.4, alpha=1.0, alpha_least=1.0, value_limit=2.0)
    subject, counted = learner(settings=settings), []
    for _ in range(60):
        subject.finish_felt(Lesson(7, INSERT, 100.0, PRESSED, "inserted"))
        subject.decide_felt(Lesson(3, 0, -1.0, LEFT), 7, PRESSED, 0, 1)
        counted.append(subject.values(3)[0])
    assert counted == pytest.approx([2.0 * 0.5 * (0.4 + 0.6 * math.exp(-0.1 * count)) for count in range(1, 61)])


def test_a_move_that_leads_back_is_worth_less() -> None:
    subject = learner(Greedy(), settings=FeltModel(revisit=5.0))
    for _ in range(400):
        for action in range(9):
            subject.finish_felt(Lesson(0, action, {0: 3.0, 2: 1.0}.get(action, -1.0), LEFT, "inserted"))
    assert {subject.decide_felt(None, 0, LEFT, 0, step) for step in range(20)} == {0}  # always further: nothing to pay
    for _ in range(400):
        subject.finish_felt(Lesson(0, 1, 2.9, PRESSED, "inserted"))
    there, back = subject.decide_felt(None, 0, LEFT, 1, 0), subject.decide_felt(None, 0, PRESSED, 1, 1)
    assert (there, back) == (0, 1)  # the start is no place that it came to
    assert subject.decide_felt(None, 0, LEFT, 1, 2) == 2  # there it was
    assert subject.decide_felt(None, 0, LEFT, 2, 0) == 0  # but in another episode
    before = subject.snapshot()
    subject.restore(before)
    assert subject.decide_felt(None, 0, LEFT, 2, 0) == 0  # an episode that is begun again
    assert subject.opinion(0, LEFT, 2).values == pytest.approx(subject.opinion(0, LEFT, 3).values)


def test_a_move_that_nothing_is_known_of_is_thought_to_leave_the_force_as_it_is() -> None:
    subject = FeltLearner(MOVES, FeltModel(force_stays=True), Greedy(), 3, force_per_n=4.0)
    assert subject.opinion(0, PRESSED, 0).model.tolist() == [-8.0] * 9
    pressed_more = Wrench((3.0, 0.0, -4.0), (9.0, 0.0, 0.0))  # its torque costs nothing
    assert subject.opinion(0, pressed_more, 0).model.tolist() == [-20.0] * 9
    for _ in range(30):  # a move that changes nothing teaches nothing about any force
        subject.finish_felt(Lesson(0, 0, -8.0, PRESSED, "inserted"))
    assert subject.opinion(0, pressed_more, 0).model.tolist() == pytest.approx([-20.0] * 9)
    for _ in range(200):  # one that takes half of it away
        subject.finish_felt(Lesson(0, 2, -4.0, PRESSED, "inserted"))
    assert subject.opinion(0, PRESSED, 0).model[2] == pytest.approx(-4.0, abs=0.1)
    assert subject.decide_felt(None, 0, PRESSED, 0, 0) == 2


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ((), 0.0),
        (("learner.force_stays=true",), -4.0 * 2.0),
        (("learner.force_stays=true", "reward.force_per_n=1.5"), -1.5 * 2.0),
        (("learner.force_stays=true", 'reward={kind="force_change"}'), 0.0),
    ],
)
def test_what_force_costs_is_known_from_the_reward(changes: tuple[str, ...], expected: float) -> None:
    subject = learner_of(load("suite-round", changes), 3)
    assert isinstance(subject, FeltLearner)
    assert subject.opinion(0, PRESSED, 0).model.tolist() == [expected] * 9


def test_caution_prefers_the_surer_of_good_moves() -> None:
    bold, cautious = learner(Greedy()), learner(Greedy(), settings=FeltModel(caution=5.0))
    for subject in (bold, cautious):
        for _ in range(200):
            subject.finish_felt(Lesson(0, 0, 2.0, LEFT, "inserted"))
        for _ in range(3):
            subject.finish_felt(Lesson(0, 2, 3.0, LEFT, "inserted"))
    opinion = bold.opinion(0, LEFT, 0)
    assert opinion.model[2] > opinion.model[0]
    assert opinion.deviation[2] > opinion.deviation[0]
    assert bold.decide_felt(None, 0, LEFT, 0, 0) == bold.opinion(0, LEFT, 0).chances.argmax() == 2
    assert cautious.decide_felt(None, 0, LEFT, 0, 0) == cautious.opinion(0, LEFT, 0).chances.argmax() == 0
    assert cautious.opinion(0, LEFT, 0).values.tolist() == opinion.values.tolist(), "what it thinks is the same"


def test_a_collision_tells_the_model_its_limit_and_the_table_the_rest() -> None:
    subject = learner(settings=FeltModel(reward_limit=20.0, alpha=1.0, ridge=1e-6))
    subject.finish_felt(Lesson(2, INSERT, -90.0, PRESSED, "collision"))
    opinion = subject.opinion(2, PRESSED, 0)
    assert opinion.model[INSERT] == pytest.approx(-20.0, abs=1e-3)
    assert opinion.table[INSERT] == -70.0
    assert opinion.values[INSERT] == pytest.approx(-90.0, abs=1e-3)


def test_no_progress_is_none_of_the_last_moves_doing() -> None:
    subject = learner(settings=FeltModel(alpha=1.0))
    subject.finish_felt(Lesson(2, 0, -10.0, LEFT, "no_progress"))
    assert subject.opinion(2, LEFT, 0).model.tolist() == [0.0] * 9
    assert subject.values(2)[0] == -10.0


def test_thompson_draws_by_what_is_known() -> None:
    subject = learner(Thompson(width=1.0, width_fade=0.1))
    new = [subject.decide_felt(None, 0, LEFT, 0, step) for step in range(300)]
    assert set(new) == set(range(9))
    for _ in range(400):
        for action in range(9):
            subject.finish_felt(Lesson(0, action, 2.0 if action == 0 else -2.0, LEFT, "inserted"))
    learnt = [subject.decide_felt(None, 0, LEFT, 0, step) for step in range(300)]
    assert set(learnt) == {0}
    sure = learner(Thompson(width=1.0, width_fade=0.1))
    assert {sure.decide_felt(None, 0, LEFT, 10_000, step) for step in range(50)} == {0}  # all are as good: the first


def test_the_chances_are_those_of_the_draws() -> None:
    subject = learner(Thompson(width=1.0, width_fade=0.0))
    run(subject, 4)
    chances = subject.opinion(1, LEFT, 0).chances
    drawn = np.bincount([subject.decide_felt(None, 1, LEFT, 0, step) for step in range(4000)], minlength=9) / 4000
    assert chances.sum() == pytest.approx(1.0)
    assert chances == pytest.approx(drawn, abs=0.04)


FADING = FeltModel(follow_fade=0.3)


@pytest.mark.parametrize("settings", [USUAL, FADING, FeltModel(revisit=0.5)])
@pytest.mark.parametrize("policy", [Greedy(), Softmax(beta=1.0), Softmax(repeat=0.5), WIDE])
def test_a_restored_learner_goes_on_bit_for_bit(policy: Policy, settings: FeltModel) -> None:
    whole, first = learner(policy, settings=settings), learner(policy, settings=settings)
    decided = run(whole, 10)
    assert run(first, 6) == decided[:72]
    snapshot, second = first.snapshot(), learner(policy, settings=settings)
    second.restore(snapshot)
    assert second.digest() == first.digest()
    assert second.snapshot() == snapshot
    assert run(second, 4, 6) == decided[72:]
    assert second.digest() == whole.digest()


def test_insertions_in_a_row_are_remembered_only_where_something_depends_on_them() -> None:
    usual, fading = learner(), learner(settings=FADING)
    run(usual, 3)
    run(fading, 3)
    assert "in_a_row" not in usual.snapshot()
    assert fading.snapshot()["in_a_row"] == 2
    before = usual.digest()
    usual.restore({**usual.snapshot(), "in_a_row": 2})  # of a skill that was learnt with it
    assert usual.digest() == before
    fading.restore(usual.snapshot())
    assert fading.snapshot()["in_a_row"] == 0


def test_a_memory_is_small() -> None:
    subject = learner()
    run(subject, 10)
    size = sum(len(value) if isinstance(value, bytes) else 8 for value in subject.snapshot().values())
    assert size < 20_000


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("lines", 4),
        ("features", 26),
        ("theta", b""),
        ("covariances", b"\0" * 8),
        ("theta", np.nan),
        ("covariances", -1.0),
        ("in_a_row", -1),
        ("in_a_row", True),
        ("in_a_row", 1 << 60),
        ("in_a_row", b"2"),
    ],
)
def test_a_memory_that_does_not_fit_is_refused(name: str, value: object) -> None:
    subject, other = learner(), learner()
    run(subject, 2)
    snapshot: dict[str, object] = {**subject.snapshot()}
    if isinstance(value, float):
        size = len(subject.snapshot()[name])  # type: ignore[arg-type]
        snapshot[name] = np.full(size // 8, value).tobytes()
    else:
        snapshot[name] = value
    before = other.digest()
    with pytest.raises(ValueError, match="snapshot"):
        other.restore(snapshot)
    assert other.digest() == before


@pytest.mark.parametrize(
    "felt", [Wrench((math.nan, 0.0, 0.0), (0.0, 0.0, 0.0)), Wrench((0.0, 0.0, 1e9), (0.0, 0.0, 0.0))]
)
def test_what_cannot_be_felt_is_refused_and_nothing_learnt(felt: Wrench) -> None:
    subject = learner()
    run(subject, 1)
    before = subject.digest()
    for previous in (None, Lesson(0, 0, 1.0, LEFT)):
        with pytest.raises(ValueError, match="force and torque"):
            subject.decide_felt(previous, 0, felt, 1, 0)
    for lesson in (
        Lesson(0, 0, 1.0, felt, "inserted"),
        Lesson(0, 0, math.inf, LEFT, "inserted"),
        Lesson(0, 9, 1.0, LEFT),
    ):
        with pytest.raises(ValueError, match=r"force and torque|reward|action"):
            subject.finish_felt(lesson)
    assert subject.digest() == before


def test_moves_of_several_sizes_share_a_line() -> None:
    moves = Moves(
        list=(
            NamedMove(name="big", x_mm=0.4),
            NamedMove(name="small", x_mm=-0.1),
            NamedMove(name="down", z_mm=0.2),
            NamedMove(name="up", z_mm=-0.2),
            NamedMove(name="screw", z_mm=0.1, rz_deg=0.5),
        )
    )
    subject = learner(moves=moves)
    assert subject.actions == 5
    assert subject.snapshot()["lines"] == 3
    subject.finish_felt(Lesson(0, 0, 5.0, LEFT, "inserted"))
    model = subject.opinion(0, LEFT, 0).model
    assert (model != 0.0).tolist() == [True, True, False, False, False]


def test_a_run_is_rebuilt_from_its_journal_and_from_any_checkpoint() -> None:
    definition = load("suite-round")
    whole = InProcessRun(definition, 21)
    entries, checkpoints = [], []
    for _ in range(6):
        checkpoints.append((whole.agent.snapshot(), whole.classifier.snapshot()))
        next(whole.episodes(1))
        entries.append(whole.task.record())
    for begun in range(6):
        agent = AgentFold(definition, whole.run, 21)
        classifier = ClassifierFold(definition, whole.run)
        agent.restore(checkpoints[begun][0])
        classifier.restore(checkpoints[begun][1])
        # What a process that was killed in the last episode finds: the task knows of half of it.
        half = replace(entries[-1], steps=entries[-1].steps[: len(entries[-1].steps) // 2], summary=None)
        for entry in (*entries[begun:-1], half, entries[-1]):
            agent.replay(entry)
            classifier.replay(entry)
        assert agent.snapshot() == whole.agent.snapshot()
        assert classifier.snapshot() == whole.classifier.snapshot()


def test_a_skill_of_it_fits_what_feels_the_same_only() -> None:
    run = InProcessRun(load("suite-round"), 22)
    list(run.episodes(2))
    learnt = skill_file.parse(skill_file.file_bytes(run.learnt())).skill
    skill_file.fits(learnt, load("suite-round-tight"))
    table = ["shaping.price_per_n=0.0", "policy.kind=softmax", "learner.kind=q_learning"]
    for changes in (
        ["felt.torque=tip", "felt.lever_mm=0.0"],
        ["learner.unit_n=2.0"],
        ["learner.force_stays=true"],
        table,
    ):
        with pytest.raises(skill_file.SkillError, match=r"torques|unit_n|force_stays|learner\.kind"):
            skill_file.fits(learnt, load("suite-round", changes))
    goes_on = InProcessRun(load("suite-round"), 23, skill=run.learnt())
    assert goes_on.agent.learner.digest() == run.agent.learner.digest()
    list(goes_on.episodes(1))


def test_a_memory_that_no_learner_can_have_is_no_skill() -> None:
    run = InProcessRun(load("suite-round"), 22)
    list(run.episodes(1))
    skill = skill_file.parse(skill_file.file_bytes(run.learnt())).skill
    assert skill.agent["in_a_row"] == 1
    size = len(skill.agent["theta"])  # type: ignore[arg-type]
    for change in (
        {"theta": b""},
        {"theta": np.full(size // 8, np.inf).tobytes()},
        {"lines": 2},
        {"features": 0},
        {"in_a_row": -1},
        {"in_a_row": 1 << 60},
    ):
        broken = replace(skill, agent={**skill.agent, **change})
        with pytest.raises(TreenailError, match="skill: "):
            skill_file.parse(skill_file.file_bytes(skill_file.named(broken)))
