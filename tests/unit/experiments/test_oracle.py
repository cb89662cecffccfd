"""The oracle: what it reports can be made again, is what is obviously best where that is obvious, and is possible."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path

import pytest

from experiments.lab import result_files
from experiments.lab.rehearsal import Attempt, Rehearsal
from experiments.oracle import __main__ as oracle
from experiments.oracle.search import Effort, Explorer, Front, _opposite, corridor_moves, search, variants
from services.rules import results
from services.sim.cell import SimulatedCell
from services.sim.geometry import geometry_of
from services.sim.pose import Pose
from services.task.insertion import Insertion
from services.wire import definition_file
from services.wire.actions import ACTION_NAMES, INSERT, increments
from services.wire.definition import Definition
from services.wire.errors import TreenailError
from services.wire.messages import Action, EpisodeSummary, Observation

EASY = """
name = "easy"
[parts]
clearance_mm = 0.5
[start]
x_mm = 0.7
y_mm = 0.0
height_mm = 1.0
rx_deg = 0.0
ry_deg = 0.0
[wrist]
sensor_height_mm = 90.0
"""
LITTLE = Effort(beam=2, attempts=10)


def silent(stage: str, done: int, most: int) -> None:
    pass


@pytest.fixture(scope="module")
def easy_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("oracle") / "easy.toml"
    path.write_text(EASY)
    return path


@pytest.fixture(scope="module")
def easy(easy_file: Path) -> Definition:
    return definition_file.load(str(easy_file))


@pytest.fixture(scope="module")
def front(easy: Definition) -> list[Attempt]:
    return search(easy, LITTLE, silent)


def made_again(definition: Definition, actions: list[int]) -> tuple[EpisodeSummary, float, list[float]]:
    """Make an episode without any code of the oracle: its summary, the rewards told, the force after each motion."""
    run = definition_file.run_id(definition, 5)
    task, cell = Insertion(definition, run, 5), SimulatedCell(definition, run, 5)
    moved, packet = cell.home(task.home(3, 70))
    told, forces, left = 0.0, list[float](), list(actions)
    while True:
        felt = task.feel(moved, packet.force_n[-1], packet.torque_nm[-1])
        told += felt.reward.reward if felt.reward is not None else 0.0
        move = felt.then
        if isinstance(move, EpisodeSummary):
            assert left == []
            return move, told, forces
        if isinstance(move, Observation):
            seen = move
            move = task.act(
                Action(
                    run=run,
                    episode=seen.episode,
                    step=seen.step,
                    decision=seen.decision,
                    state=0,
                    action=left.pop(0),
                    policy_version=0,
                )
            )
        moved, packet = cell.move(move)
        forces.append(math.hypot(*packet.force_n[-1]))


def test_what_is_reported_can_be_made_again(easy: Definition, front: list[Attempt]) -> None:
    for attempt in front:
        reported = oracle.entry(attempt)
        done, told, forces = made_again(easy, [ACTION_NAMES.index(name) for name in reported["actions"]])
        assert done.outcome == "inserted"
        assert (reported["return"], reported["moves"]) == (done.episode_return, done.moves) == (told, len(forces))
        assert reported["decisions"] == done.decisions == len(reported["actions"])
        assert reported["mean_force_n"] == done.mean_force_n == pytest.approx(sum(forces) / len(forces), rel=1e-12)
        assert reported["peak_force_n"] == done.peak_force_n == max(forces)


def test_an_easy_start_needs_no_move_but_insertion(front: list[Attempt]) -> None:
    # 0.2 mm more than the gap, and 10 N bend the wrist by 0.67 mm: the chamfer alone can guide the peg in.
    assert front[0].summary.episode_return == 0.0
    assert set(front[0].actions) == {INSERT}


def test_an_easy_start_needs_two_moves_for_almost_no_force(front: list[Attempt]) -> None:
    # 0.2 mm too far in X: the first touch takes one step back, a second clears the corridor's edge.
    least = front[-1]
    assert [ACTION_NAMES[a] for a in least.actions if a != INSERT] in (["-X"], ["-X", "-X"])
    assert least.summary.mean_force_n < 0.05


def test_nothing_beats_what_is_possible(easy: Definition, front: list[Attempt]) -> None:
    depth_mm, steps = -easy.start.height_mm, 0
    while depth_mm < easy.limits.success_fraction * easy.parts.peg_height_mm:
        depth_mm, steps = depth_mm + easy.moves.insertion_mm, steps + 1
    for attempt in front:
        done = attempt.summary
        assert done.episode_return == -sum(action != INSERT for action in attempt.actions) <= 0.0
        assert done.moves == steps - done.episode_return
        assert 0.0 <= done.mean_force_n <= done.peak_force_n < easy.limits.collision_force_n


def test_less_force_costs_return(front: list[Attempt]) -> None:
    assert len(front) >= 2
    for better, gentler in itertools.pairwise(front):
        assert better.summary.episode_return > gentler.summary.episode_return
        assert better.summary.mean_force_n > gentler.summary.mean_force_n


def test_the_same_search_finds_the_same(easy: Definition, front: list[Attempt]) -> None:
    assert search(easy, LITTLE, silent) == front


def test_a_collision_limit_that_forbids_pressing_is_kept(easy_file: Path) -> None:
    gentle = definition_file.load(str(easy_file), ["limits.collision_force_n=1.5", "moves.insertion_mm=0.1"])
    for attempt in search(gentle, LITTLE, silent):
        assert attempt.summary.peak_force_n < 1.5
        assert attempt.summary.episode_return < 0.0


@pytest.mark.parametrize("setting", ["start.xy_spread_mm", "start.tilt_spread_deg", "noise.force_n", "noise.torque_nm"])
def test_chance_is_refused(easy_file: Path, setting: str) -> None:
    definition = definition_file.load(str(easy_file), [f"{setting}=0.5"])
    with pytest.raises(TreenailError, match=f"{setting}: expected 0, .* got 0.5"):
        Rehearsal(definition)


def test_a_replay_with_other_decisions_than_the_episode_takes_is_refused(
    easy: Definition, front: list[Attempt]
) -> None:
    actions = front[0].actions
    rehearsal = Rehearsal(easy)
    assert rehearsal.replay(actions) == front[0].summary
    for wrong in (actions[:-1], (*actions, INSERT)):
        with pytest.raises(TreenailError, match=f"expected an episode of {len(wrong)} decisions, got {len(actions)}"):
            rehearsal.replay(wrong)


def test_following_its_own_motions_gives_an_attempt_again(easy: Definition, front: list[Attempt]) -> None:
    rehearsal = Rehearsal(easy)
    for attempt in front:
        assert rehearsal.follow(attempt.motions) == attempt


def test_a_world_put_back_goes_on_nearly_as_if_nothing_had_happened(easy: Definition) -> None:
    moves, down = increments(easy.moves), increments(easy.moves)[INSERT]
    world = Explorer(easy)
    world.home(Pose(0.7, 0.0, -1.0))
    while world.snapshot().at_flange:
        world.move(down)
    there = world.snapshot()
    straight_on = world.move(down)
    world.resume(there)
    put_back = world.move(down)
    assert math.hypot(*straight_on.force_n) > 0.5
    assert math.dist(put_back.force_n, straight_on.force_n) < 0.05
    for move in moves:
        world.move(move)
    world.resume(there)
    assert world.snapshot() == there
    assert world.move(down) == put_back


def test_moves_left_to_the_corridor(easy: Definition) -> None:
    # 0.3 mm beyond a gap of 0.5 mm, straight: one and a half moves of 0.2 mm along X, more when aslant.
    geometry = geometry_of(easy.parts)
    (turns, overlap, per_mm), *_ = corridor_moves(geometry, Pose(0.8, 0.0, 1.0), 9.8, easy)
    assert turns == 0.0
    assert overlap * per_mm == pytest.approx(1.5, abs=0.01)
    aslant = corridor_moves(geometry, Pose(0.8 * math.sqrt(0.5), 0.8 * math.sqrt(0.5), 1.0), 9.8, easy)
    assert aslant[0][1] * aslant[0][2] == pytest.approx(1.5 * math.sqrt(2), abs=0.01)
    tilted = corridor_moves(geometry, Pose.from_tilt(0.0, 0.0, 1.0, 2.0, -1.0), 9.8, easy)
    assert [turns for turns, _, _ in tilted] == pytest.approx([0.0, 3.75, 7.5, 11.25, 15.0], rel=1e-3)
    assert tilted[-1][1] == 0.0


def attempt_of(episode_return: float, mean_force_n: float, motions: tuple[int, ...] = ()) -> Attempt:
    summary = EpisodeSummary(
        run="0123456789abcdef-s0",
        episode=0,
        episode_return=episode_return,
        moves=60,
        decisions=len(motions),
        mean_force_n=mean_force_n,
        peak_force_n=2.0,
        mean_torque_nm=0.1,
        peak_torque_nm=0.2,
        states=1,
        outcome="inserted",
    )
    return Attempt(motions, (True,) * len(motions), summary)


def test_the_front_keeps_what_nothing_else_covers() -> None:
    front = Front()
    assert front.add(attempt_of(-10, 1.0))
    assert not front.add(attempt_of(-10, 1.0))
    assert not front.add(attempt_of(-11, 1.5))
    assert front.add(attempt_of(-12, 0.5))
    assert front.add(attempt_of(-9, 2.0))
    assert front.add(attempt_of(-10, 0.4))
    assert not front.add(None)
    assert [(a.summary.episode_return, a.summary.mean_force_n) for a in front.attempts] == [(-9, 2.0), (-10, 0.4)]


def test_variants_change_one_thing() -> None:
    motions = (INSERT, 1, INSERT)
    plans = list(variants(attempt_of(-1, 1.0, motions), 5))
    assert plans[0] == (INSERT, INSERT)
    assert (1, INSERT, INSERT) in plans
    assert (INSERT, 2, INSERT) in plans
    assert (INSERT, INSERT, INSERT) in plans
    assert (0, *motions) in plans
    assert motions not in plans
    assert len(set(plans)) == len(plans)


def test_opposites() -> None:
    pairs = {frozenset((a, b)) for a in range(11) if (b := _opposite(a)) is not None}
    named = {frozenset(ACTION_NAMES[a] for a in pair) for pair in pairs}
    assert named == {frozenset({f"+{axis}", f"-{axis}"}) for axis in ("X", "Y", "RX", "RY", "RZ")}


def test_what_is_best_for_a_force_and_for_a_return() -> None:
    front = [oracle.entry(attempt_of(r, f)) for r, f in ((-9, 3.0), (-12, 0.4), (-14, 0.1))]
    within = [oracle.best_within(front, force_n) for force_n in (5.0, 0.4, 0.39, 0.05)]
    assert [one and one["return"] for one in within] == [-9, -12, -14, None]
    least = [oracle.least_force(front, episode_return) for episode_return in (-8, -9, -20)]
    assert [one and one["mean_force_n"] for one in least] == [None, 3.0, 0.1]


def learnt_folder(folder: Path, definition: Definition) -> Path:
    runs = []
    for seed in (0, 1, 2):
        runs.append(
            results.RunResult(
                seed,
                tuple(
                    EpisodeSummary(
                        run=definition_file.run_id(definition, seed),
                        episode=episode,
                        episode_return=-100.0 if episode < 3 else -2.0 - seed,
                        moves=60,
                        decisions=10,
                        mean_force_n=5.0 if episode < 3 else 0.5 + seed,
                        peak_force_n=9.0,
                        mean_torque_nm=0.1,
                        peak_torque_nm=0.2,
                        states=4,
                        outcome="inserted",
                    )
                    for episode in range(4)
                ),
                {"q_table": "0" * 64, "art2": "0" * 64, "episodes": "0" * 64},
            )
        )
    sha256 = definition_file.definition_sha256(definition)
    result_files.prepare(folder, sha256)
    result_files.write(folder, definition, results.summary(definition, sha256, runs), runs, {})
    return folder


def test_the_command_reports_front_and_gap(
    easy_file: Path, easy: Definition, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    learnt = learnt_folder(tmp_path / "learnt", easy)
    words = [str(easy_file), "--beam", "2", "--attempts", "0", "--learnt", str(learnt), "--out", str(tmp_path / "out")]
    assert oracle.main([*words, "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["front"] == json.loads((tmp_path / "out" / "oracle.json").read_text())["front"]
    assert [(row["seed"], row["episode_return"], row["mean_force_n"]) for row in told["learnt"]] == [
        ("0", -2.0, 0.5),
        ("1", -3.0, 1.5),
        ("2", -4.0, 2.5),
        ("median", -3.0, 1.5),
    ]
    assert all(row["oracle_return_at_this_force"] >= row["episode_return"] for row in told["learnt"])
    assert oracle.main(words) == 0
    assert "Learnt, and what the oracle found" in capsys.readouterr().out


def test_results_of_another_task_are_refused(
    easy_file: Path, easy: Definition, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    learnt = learnt_folder(tmp_path, easy)
    assert oracle.main([str(easy_file), "--set", "contact.friction=0.1", "--learnt", str(learnt)]) == 2
    complaint = capsys.readouterr().err
    assert "contact: expected Contact(friction=0.1, " in complaint
    assert "got Contact(friction=0.3, " in complaint


def test_decisions_are_written_shortly() -> None:
    assert oracle.short(["+Z", "+Z", "-X", "+Z"]) == "2*+Z -X +Z"
