"""The Gymnasium environment: accepted by both checkers, to the bit like any other run, and clear when misused."""

from __future__ import annotations

import itertools
import subprocess
import sys
import warnings
from typing import Any

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium", reason="the extra gym is not installed")

from gymnasium.utils.env_checker import check_env  # noqa: E402

import treenail  # noqa: E402
from experiments.evaluate.controllers import ComplianceRule  # noqa: E402
from experiments.evaluate.trial import trial  # noqa: E402
from services.rules.guard import Guard  # noqa: E402
from services.wire.actions import INSERT, Increment, increments  # noqa: E402
from services.wire.force_bound import ForceBound  # noqa: E402
from services.wire.messages import Observation  # noqa: E402
from treenail.gym.environment import PegInHole  # noqa: E402
from treenail.gym.spaces import AnyMoves, with_bounds  # noqa: E402

NAME = "treenail/PegInHole-v0"
SHORT = {"start.height_mm": 0.4, "limits.success_fraction": 0.3, "limits.move_limit": 60}
"""Changes that make an episode a matter of some twenty decisions."""


def environment(definition: str = "suite-round", **settings: Any) -> PegInHole:
    return PegInHole(definition, overrides=SHORT, **settings)


def walk(env: PegInHole, seed: int, steps: int, dice: int = 0) -> list[Any]:
    """Return all that an environment says in so many steps at random, as plain values."""
    env.action_space.seed(dice)
    told: list[Any] = [plain(env.reset(seed=seed))]
    for _ in range(steps):
        *_, terminated, truncated, _ = said = env.step(env.action_space.sample())
        told.append(plain(said))
        if terminated or truncated:
            told.append(plain(env.reset()))
    return told


def plain(said: Any) -> Any:
    if isinstance(said, dict):
        return {name: plain(value) for name, value in said.items()}
    if isinstance(said, tuple):
        return [plain(value) for value in said]
    return said.tobytes() if isinstance(said, np.ndarray) else said


def test_it_is_registered_whichever_is_loaded_first() -> None:
    for order in ("treenail, gymnasium", "gymnasium, treenail"):
        code = f"import {order}; print(gymnasium.spec('{NAME}').id)"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        assert (done.stdout.strip(), done.stderr) == (NAME, "")


@pytest.mark.parametrize(
    "settings", [{}, {"history": 2, "orientation": True}, {"continuous": True}, {"render_mode": "rgb_array"}]
)
def test_gymnasiums_checker_has_nothing_to_say(settings: dict[str, Any]) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(NAME, definition="suite-round", overrides=SHORT, **settings)
        check_env(env.unwrapped)
        env.close()


@pytest.mark.parametrize("settings", [{}, {"continuous": True, "history": 1}])
def test_nor_has_the_one_of_stable_baselines3(settings: dict[str, Any]) -> None:
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="stable-baselines3 is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checker.check_env(environment(**settings), warn=True)


@pytest.mark.parametrize("settings", [{}, {"continuous": True, "orientation": True}])
def test_the_same_seed_and_actions_give_the_same_bits(settings: dict[str, Any]) -> None:
    one, another = environment(**settings), environment(**settings)
    first = walk(one, 7, 60)
    assert walk(another, 7, 60) == first == walk(one, 7, 60), "neither a process nor an episode before matters"
    assert walk(one, 8, 60) != first


def test_two_in_one_process_do_not_disturb_each_other() -> None:
    alone = [walk(environment(name), 3, 25) for name in ("suite-round", "suite-square")]
    both = [environment(name) for name in ("suite-round", "suite-square")]
    told = [[plain(env.reset(seed=3))] for env in both]
    for env in both:
        env.action_space.seed(0)
    for _ in range(25):
        for env, so_far in zip(both, told, strict=True):
            *_, terminated, truncated, _ = said = env.step(env.action_space.sample())
            so_far.append(plain(said))
            if terminated or truncated:
                so_far.append(plain(env.reset()))
    assert told == alone


def test_it_is_the_task_of_every_other_run() -> None:
    """The hand-written rule does in the environment, to the bit, what it does in a trial of ``treenail evaluate``."""
    env = environment()
    rule, episodes = ComplianceRule(env.definition), 6
    expected = trial(env.definition, rule, 5, episodes).episodes
    expected = tuple(summary for summary in expected if summary.decisions)  # the others are passed over
    got: list[Any] = []
    for summary in expected:
        rule.begin()
        _, info = env.reset(seed=None if got else 5)
        total, over = 0.0, False
        while not over:
            asked = env._asked
            assert isinstance(asked, Observation)
            _, reward, terminated, truncated, info = env.step(rule.decide(asked).action)
            total, over = total + reward, terminated or truncated
        got.append((info["outcome"], total, info["moves"], info["decision"], info["peak_force_n"]))
        assert info["mean_force_n"] == pytest.approx(summary.mean_force_n, rel=1e-12)
        assert terminated == (info["outcome"] in ("inserted", "collision"))
        assert info["inserted"] == (info["outcome"] == "inserted") and info["episode_number"] == summary.episode
    assert got == [(s.outcome, s.episode_return, s.moves, s.decisions, s.peak_force_n) for s in expected]


def test_what_is_observed() -> None:
    env = environment(history=1, orientation=True)
    first, _ = env.reset(seed=1)
    asked = env._asked
    assert asked is not None and first.shape == (15,)
    felt = np.array([*asked.force_n, *asked.torque_nm], dtype=np.float32)
    assert (first[:6] == felt).all() and not first[6:12].any()
    assert first[12:].tolist() == pytest.approx(np.radians([1.8, 0.4, 0.0]), abs=0.08)
    second, *_ = env.step(INSERT)
    assert (second[6:12] == felt).all()


def test_limits_cut_and_only_the_tasks_own_ends_terminate() -> None:
    env = PegInHole("initial", overrides={"limits.move_limit": 15, "limits.no_progress_moves": 0})
    env.reset(seed=0)
    for _ in itertools.repeat(None, 15):
        *_, terminated, truncated, info = env.step(0 if env._decisions % 2 else 1)
        if terminated or truncated:
            break
    assert (terminated, truncated, info["outcome"]) == (False, True, "move_limit")


def test_a_motion_that_the_guard_refuses_ends_the_episode_and_says_why() -> None:
    env = PegInHole("suite-round", overrides={"limits.workspace_mm": 4.0})
    rule = ComplianceRule(env.definition)
    env.reset(seed=0)
    over = False
    while not over:
        assert env._asked is not None
        _, reward, terminated, truncated, info = env.step(rule.decide(env._asked).action)
        over = terminated or truncated
    assert (reward, terminated, truncated, info["outcome"]) == (0.0, False, True, "refused")
    assert info["complaint"].startswith("guard: ")
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(0)


def test_continuous_moves_stay_within_those_of_the_list() -> None:
    definition = with_bounds(treenail.load("suite-round"))
    moves, bound, guard = AnyMoves(definition), ForceBound(definition), Guard(definition)
    lowest, highest = moves.move(-np.ones(5)), moves.move(np.ones(5))
    assert lowest[1] is not None and lowest[1].dz_mm == 0.0 and lowest[0] != INSERT
    for corner in itertools.product((-1.0, 0.0, 1.0), repeat=5):
        number, increment = moves.move(np.array(corner))
        assert increment is not None and bound.added_n(increment) <= bound.largest_n + 1e-9
        assert all(
            low - 1e-12 <= value <= high + 1e-12
            for value, (low, high) in zip(increment, guard._steps.values(), strict=True)
        )
        assert number < len(increments(definition.moves))
    alone = moves.move(np.array([0.0, 0.0, 1.0, 0.0, 0.0]))
    assert alone == (INSERT, Increment(dz_mm=definition.moves.insertion_mm)) and highest[1] is not None


def test_a_picture_shows_the_peg() -> None:
    env = environment(render_mode="rgb_array")
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
        env.render()
    env.reset(seed=0)
    before = env.render()
    env.step(0)
    after = env.render()
    assert before.shape == (540, 480, 3) and before.dtype == np.uint8
    assert (before != after).any()


def test_people_watch_it_in_rerun(capsys: pytest.CaptureFixture[str]) -> None:
    env = environment(render_mode="human")
    env.reset(seed=0)
    said = capsys.readouterr().err
    assert said.startswith("watch with: rerun rerun+http://127.0.0.1:") and "browser: http://127.0.0.1:" in said
    for _ in range(3):
        env.step(INSERT)
    assert env.render() is None
    env.close()


@pytest.mark.parametrize("start_method", ["spawn", "forkserver"])
def test_several_in_processes(start_method: str) -> None:
    settings = {"definition": "suite-round", "overrides": SHORT, "start_method": start_method}
    envs = gymnasium.make_vec(NAME, num_envs=2, **settings)
    try:
        assert envs.metadata["autoreset_mode"] == gymnasium.vector.AutoresetMode.NEXT_STEP
        observed, infos = envs.reset(seed=4)
        single = environment()
        for place in range(2):
            assert (observed[place] == single.reset(seed=4 + place)[0]).all()
        ends = 0
        for _ in range(25):
            _, _, terminated, truncated, infos = envs.step(np.array([INSERT, INSERT]))
            ends += int((terminated | truncated).sum())
        assert ends > 0 and infos["episode_number"].max() > 0
    finally:
        envs.close()


@pytest.mark.parametrize(
    ("settings", "complaint"),
    [
        ({"definition": "suite-rund"}, "shipped experiment's name .* did you mean 'suite-round'"),
        ({"histroy": 3}, "histroy: unknown key; did you mean|histroy: unknown key"),
        ({"overrides": {"limits.move_limit": 3}}, "limits.move_limit: .*expected"),
        ({"limits.move_limit": 3}, "limits.move_limit: .*expected"),
        ({"history": -1}, "history: expected 0 to 1000, got -1"),
        ({"definition": treenail.load("initial"), "episodes": 3}, "expected a definition as it is"),
        ({"render_mode": "ansi"}, "render_mode: expected rgb_array or human, got 'ansi'"),
    ],
)
def test_what_cannot_be_is_refused(settings: dict[str, Any], complaint: str) -> None:
    with pytest.raises(treenail.TreenailError, match=complaint) as caught:
        PegInHole(**settings)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("action", [9, -1, 0.5, "+X", None, np.array([0.0, 1.0])])
def test_a_wrong_action_is_refused_and_nothing_moves(action: object) -> None:
    env = environment()
    env.reset(seed=0)
    before = env._cell.world.flange
    with pytest.raises(gymnasium.error.InvalidAction, match=r"step: expected an action of Discrete\(9\), got "):
        env.step(action)
    assert env._cell.world.flange == before
    env.step(0)


def test_a_step_too_early_or_too_late_is_refused() -> None:
    env = environment()
    with pytest.raises(gymnasium.error.ResetNeeded, match="expected reset"):
        env.step(0)
    env.reset(seed=0)
    over = False
    while not over:
        *_, terminated, truncated, _ = env.step(INSERT)
        over = terminated or truncated
    with pytest.raises(gymnasium.error.ResetNeeded, match="expected reset"):
        env.step(0)
    for options, complaint in (({"episode": -1}, "episode: expected 0 to"), ({"sede": 1}, "options: expected episode")):
        with pytest.raises(treenail.TreenailError, match=complaint):
            env.reset(options=options)


def test_a_task_without_anything_to_decide_is_refused() -> None:
    straight = {"start.xy_spread_mm": 0.0, "start.tilt_spread_deg": 0.0, "noise.scale": 0.0}
    env = PegInHole("suite-round", overrides={**SHORT, **straight})
    with pytest.raises(treenail.TreenailError, match="expected something to decide in one of 100 episodes"):
        env.reset(seed=0)


def test_an_episode_can_be_chosen() -> None:
    env = environment()
    env.reset(seed=2)
    env.reset()
    third, info = env.reset()
    assert info["episode_number"] >= 2
    again, told = environment().reset(seed=2, options={"episode": info["episode_number"]})
    assert (third == again).all() and told["episode_number"] == info["episode_number"]
