"""What becomes of each message on its way to the screen."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec import structs

from services.rules.hole import standing
from services.viewer import record
from services.viewer.recent import Pace, duration
from services.viewer.record import About, Bars, Item, Lines, Placement, Push, Recorder, Series
from services.wire.definition import Definition, Limits
from services.wire.definition_world import Hole
from services.wire.errors import BadPayloadError
from services.wire.messages import (
    Action,
    EpisodeSummary,
    Experiment,
    Force,
    FtPacket,
    Outcome,
    QTable,
    Reward,
    State,
    Truth,
)

MS = 1_000_000


def packet(*forces: Force) -> FtPacket:
    torques = tuple((fx / 100, fy / 100, fz / 100) for fx, fy, fz in forces)
    return FtPacket(sequence=1, t_ns=1, force_n=forces, torque_nm=torques)


def summary(
    episode: int, episode_return: float = -10.0, outcome: Outcome = "inserted", run: str = "r1"
) -> EpisodeSummary:
    return EpisodeSummary(
        run=run,
        episode=episode,
        episode_return=episode_return,
        moves=60,
        decisions=20,
        mean_force_n=0.5,
        peak_force_n=2.25,
        mean_torque_nm=0.01,
        peak_torque_nm=0.02,
        states=8,
        outcome=outcome,
    )


def experiment(run: str = "r1", limit_n: float = 7.5) -> Experiment:
    return Experiment(
        run=run,
        seed=1,
        definition=Definition(name="x", limits=Limits(collision_force_n=limit_n)),
        definition_sha256="0" * 64,
        skill_sha256=None,
        first_policy_version=0,
        episodes=10,
        episodes_done=0,
        decisions=0,
        phase="running",
    )


def series(items: list[Item], entity: str) -> Series:
    (found,) = [item for item in items if isinstance(item, Series) and item.entity == entity]
    return found


def test_nothing_came_nothing_is_sent() -> None:
    assert Recorder().flush(0, 50 * MS) == []


def test_a_packet_becomes_force_torque_and_magnitude() -> None:
    recorder = Recorder()
    recorder.experiment(experiment())
    recorder.ft(packet((3.0, 0.0, -4.0), (0.0, 0.0, 1.0)))
    items = recorder.flush(0, 50 * MS)
    force = series(items, record.FORCE)
    assert force.values.tolist() == [[3.0, 0.0, -4.0], [0.0, 0.0, 1.0]]
    assert force.times_ns.tolist() == [25 * MS, 50 * MS]
    assert series(items, record.TORQUE).values.tolist() == [[0.03, 0.0, -0.04], [0.0, 0.0, 0.01]]
    assert series(items, record.MAGNITUDE).values.tolist() == [[5.0, 7.5], [1.0, 7.5]]


def test_a_packet_with_a_torque_missing_is_refused_whole() -> None:
    recorder = Recorder()
    with pytest.raises(BadPayloadError, match="got 2 forces and 1 torques"):
        recorder.ft(FtPacket(sequence=1, t_ns=1, force_n=((0.0,) * 3,) * 2, torque_nm=((0.0,) * 3,)))
    assert recorder.flush(0, 50 * MS) == []


def test_without_an_experiment_the_limit_is_left_out() -> None:
    recorder = Recorder()
    recorder.ft(packet((3.0, 0.0, -4.0)))
    magnitude, limit = series(recorder.flush(0, 50 * MS), record.MAGNITUDE).values[0]
    assert magnitude == 5.0
    assert math.isnan(limit)


def test_a_second_at_full_speed_becomes_two_rows_a_bucket_with_its_peak() -> None:
    recorder = Recorder()
    for sample in range(1000):
        recorder.ft(packet((0.1, 0.0, -11.0 if sample == 617 else 0.2)))
    items = recorder.flush(0, 1000 * MS)
    force = series(items, record.FORCE)
    assert len(force.values) == 20
    assert force.values[:, 2].min() == -11.0
    assert series(items, record.MAGNITUDE).values[:, 0].max() == pytest.approx(math.hypot(0.1, 11.0))


def test_what_was_flushed_is_not_sent_again() -> None:
    recorder = Recorder()
    recorder.ft(packet((1.0, 0.0, 0.0)))
    recorder.state(State(run="r1", episode=0, step=1, decision=0, state=3, states=4, match=0.99))
    recorder.episode(summary(0))
    assert recorder.flush(0, 50 * MS) != []
    assert recorder.flush(50 * MS, 100 * MS) == []


def test_states_and_actions_are_marked_once_each_and_rewards_keep_their_extremes() -> None:
    recorder = Recorder()
    for step, state in enumerate((2, 7, 2, 2)):
        recorder.state(State(run="r1", episode=0, step=step, decision=step, state=state, states=8, match=0.99))
        recorder.action(Action(run="r1", episode=0, step=step, decision=step, state=state, action=4, policy_version=1))
        value = -100.0 if step == 2 else -1.0
        recorder.reward(Reward(run="r1", episode=0, step=step, decision=step, reward=value, terminal=None))
    items = recorder.flush(0, 50 * MS)
    assert series(items, record.STATE).values.tolist() == [[7.0], [2.0]]
    assert series(items, record.ACTION).values.tolist() == [[4.0]]
    assert sorted(series(items, record.REWARD).values[:, 0]) == [-100.0, -1.0]


def test_an_episode_becomes_return_failures_and_a_line() -> None:
    recorder = Recorder()
    recorder.episode(summary(4, -10.0))
    recorder.episode(summary(5, -120.0, "collision"))
    items = recorder.flush(0, 50 * MS)
    returns = series(items, record.RETURN)
    assert returns.values.tolist() == [[-10.0, -10.0], [-120.0, -65.0]]
    assert returns.episodes == (4, 5)
    assert series(items, record.FAILURES).values.tolist() == [[0.0], [1.0]]
    (lines,) = [item for item in items if isinstance(item, Lines)]
    assert lines.episodes == (4, 5)
    assert lines.levels == ("INFO", "WARN")
    assert lines.texts[1].split() == ["collision", "-120.0", "0.50", "2.25", "N"]


def test_an_episode_told_twice_is_shown_once() -> None:
    recorder = Recorder()
    for number in (0, 1, 1, 0):
        recorder.episode(summary(number))
    assert series(recorder.flush(0, 50 * MS), record.RETURN).episodes == (0, 1)


def test_averages_cover_ten_episodes() -> None:
    recorder = Recorder()
    for number in range(15):
        outcome: Outcome = "no_progress" if number < 8 else "inserted"
        recorder.episode(summary(number, float(-number), outcome))
    items = recorder.flush(0, 50 * MS)
    assert series(items, record.RETURN).values[-1].tolist() == [-14.0, -9.5]
    assert series(items, record.FAILURES).values[:, 0].tolist() == [1, 2, 3, 4, 5, 6, 7, 8, 8, 8, 7, 6, 5, 4, 3]


def test_another_run_starts_its_averages_and_its_curve_afresh() -> None:
    recorder = Recorder()
    recorder.episode(summary(7, -200.0))
    recorder.experiment(experiment("r2"))
    recorder.episode(summary(0, -10.0, run="r2"))
    assert series(recorder.flush(0, 50 * MS), record.RETURN).values[-1].tolist() == [-10.0, -10.0]
    about, bars = recorder.whole_run(1)
    assert isinstance(about, About) and isinstance(bars, Bars)
    assert bars.values.tolist() == [-10.0]


def test_what_is_seen_has_a_name() -> None:
    recorder = Recorder("bench-2")
    whole = structs.replace(experiment(), episodes=Definition(name="x").episodes)
    for told, quick in ((whole, ""), (structs.replace(whole, episodes=20), ", quick: 20 of 2000 episodes")):
        recorder.experiment(told)
        recorder.episode(summary(told.episodes - 3))
        (about,) = [item for item in recorder.whole_run(1) if isinstance(item, About)]
        name = f"{told.definition.name}, seed {told.seed}, cell bench-2{quick}"
        assert record.name(told, "bench-2") == name
        assert about.text.startswith(f"{name}\nepisode {told.episodes - 2} of {told.episodes}") or quick


def test_a_cell_that_rests_moves_no_time_along() -> None:
    recorder = Recorder()
    recorder.episode(summary(0))
    recorder.flush(0, 50 * MS)
    answer = q_table((-1.0, 0.0))
    assert recorder.whole_run(1)
    assert recorder.table(answer, 1) is not None
    assert recorder.flush(50 * MS, 100 * MS) == []
    assert not recorder.whole_run(2)
    assert recorder.table(answer, 2) is None
    assert recorder.table(structs.replace(answer, decisions=2), 2) is not None, "what changes is shown"
    recorder.ft(packet((1.0, 0.0, 0.0)))
    recorder.flush(100 * MS, 150 * MS)
    assert recorder.whole_run(3), "for those who attach later"
    assert recorder.table(answer, 3) is not None


def test_only_the_newest_true_pose_is_shown() -> None:
    recorder = Recorder()
    for z in (-1.0, 2.5):
        pose = (0.1, 0.2, z, 0.8, 0.6, 0.0, 0.0)
        recorder.truth(Truth(run="r1", episode=0, step=1, flange=pose, peg=pose, contact=""))
    assert recorder.flush(0, 9) == [
        Placement(entity, 9, (0.1, 0.2, 2.5), (0.6, 0.0, 0.0, 0.8)) for entity in (record.PEG, record.FLANGE)
    ]


def q_table(*q: tuple[float, ...]) -> QTable:
    return QTable(
        run="r1",
        decisions=1,
        policy_version=1,
        actions=("+X", "-X"),
        q=q,
        visits=tuple((1, 0) for _ in q),
        best_action=tuple(0 for _ in q),
        digest="0" * 64,
    )


def test_the_q_table_stands_with_a_row_an_action_and_a_column_a_state() -> None:
    shown = Recorder().table(q_table((-1.0, 0.0), (-2.0, 0.0), (-3.0, 0.0)), 5)
    assert shown is not None
    assert shown.values.tolist() == [[-1.0, -2.0, -3.0], [0.0, 0.0, 0.0]]
    assert shown.visited.tolist() == [[True] * 3, [False] * 3]


def test_an_empty_q_table_is_not_shown() -> None:
    assert Recorder().table(q_table(), 5) is None


def test_a_run_of_any_length_fits_into_bounded_bars_of_equal_width() -> None:
    recorder = Recorder()
    assert not recorder.whole_run(0)
    returns = np.random.default_rng(1).uniform(-100.0, 0.0, 1000)
    for number, value in enumerate(returns.tolist()):
        recorder.episode(summary(number, value))
    recorder.flush(0, 50 * MS)
    (bars,) = recorder.whole_run(3)
    assert isinstance(bars, Bars)
    assert (bars.time_ns, bars.width, len(bars.values)) == (3, 4, 250)
    assert bars.firsts.tolist() == list(range(0, 1000, 4))
    assert bars.values == pytest.approx(returns.reshape(250, 4).mean(axis=1))


def test_a_tilted_hole_is_shown_tilted_and_a_straight_peg_straight() -> None:
    recorder, upright = Recorder(), (0.5, 0.0, -2.0, 1.0, 0.0, 0.0, 0.0)
    leaning = structs.replace(
        experiment(), definition=Definition(name="x", hole=Hole(rx_deg=10.0, tilt_spread_deg=2.0))
    )
    recorder.experiment(leaning)
    for episode in (0, 1):
        stands = standing(leaning.definition.hole, 1, episode)
        assert stands is not None
        pose = stands.in_hole(upright)
        recorder.truth(Truth(run="r1", episode=episode, step=1, flange=pose, peg=pose, contact=""))
        hole, *bodies = [item for item in recorder.flush(0, 9) if isinstance(item, Placement)]
        w, x, y, z = stands.turn
        assert hole == Placement(record.HOLE, 9, (0.0, 0.0, 0.0), (x, y, z, w))
        assert [body.entity for body in bodies] == [record.PEG, record.FLANGE]
        for body in bodies:
            assert body.translation == pytest.approx((0.5, 0.0, -2.0))
            assert body.quaternion == pytest.approx((0.0, 0.0, 0.0, 1.0))


def test_after_a_tilted_hole_an_upright_one_is_put_upright() -> None:
    recorder, pose = Recorder(), (0.5, 0.0, -2.0, 1.0, 0.0, 0.0, 0.0)
    for run, hole in (("r1", Hole(rx_deg=10.0)), ("r2", Hole())):
        recorder.experiment(structs.replace(experiment(run), definition=Definition(name="x", hole=hole)))
        recorder.truth(Truth(run=run, episode=0, step=1, flange=pose, peg=pose, contact=""))
        shown = {item.entity: item for item in recorder.flush(0, 9) if isinstance(item, Placement)}[record.HOLE]
        assert (shown.quaternion == (0.0, 0.0, 0.0, 1.0)) is (run == "r2")


def test_the_time_that_is_left_is_told_at_the_pace_of_late() -> None:
    pace = Pace()
    assert pace.left(0, 0, 100) == "", "nobody can tell yet"
    assert pace.left(2 * 10**9, 10, 100) == "18 s"
    assert pace.left(9 * 10**9, 10, 100) == "18 s", "none came since"
    assert pace.left(12 * 10**9, 20, 100) == "48 s"
    assert pace.left(13 * 10**9, 100, 100) == ""
    assert [duration(seconds) for seconds in (0.2, 99, 100, 5999, 11_100)] == [
        "1 s",
        "99 s",
        "2 min",
        "1 h 40 min",
        "3 h 5 min",
    ]


def test_what_pushes_is_an_arrow_where_the_peg_is() -> None:
    truth = Truth(run="r", episode=0, step=1, flange=(0, 0, 1, 1, 0, 0, 0), peg=(0, 0, 0.9, 1, 0, 0, 0), contact="")

    def pushes(force_n: tuple[float, float, float], truly: bool = True) -> list[Push]:
        recorder = Recorder()
        recorder.ft(FtPacket(sequence=1, t_ns=1, force_n=((9.0, 9.0, 9.0), force_n), torque_nm=((0, 0, 0), (0, 0, 0))))
        if truly:
            recorder.truth(truth)
        return [item for item in recorder.flush(0, 10**9) if isinstance(item, Push)]

    assert pushes((2.0, 0.0, -1.0)) == [Push(10**9, (6.0, 0.0, -3.0), "2.2 N")]
    assert pushes((0.0, 0.0, -40.0)) == [Push(10**9, (0.0, 0.0, -30.0), "40.0 N")]
    assert pushes((0.01, 0.0, 0.0)) == [Push(10**9, None, "")]
    assert pushes((2.0, 0.0, 0.0), truly=False) == [], "nobody knows where the peg of a real arm is"
