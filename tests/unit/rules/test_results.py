"""Figures of a run on hand-made series, and the folder they are kept in."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from experiments.lab import result_files
from experiments.lab.result_files import ResultsError
from services.rules.results import (
    Digests,
    RunResult,
    episodes_digest,
    failures_per_10,
    last_quarter,
    run_summary,
    steady_from,
    summary,
)
from services.wire import codec, definition_file
from services.wire.definition import Definition, EpsilonAnnealed, ForceChangeReward, Policy, Reward
from services.wire.definition_world import Change
from services.wire.messages import EpisodeSummary, Outcome

DEFINITION = Definition(name="by-hand")
SHA256 = definition_file.definition_sha256(DEFINITION)
DIGESTS: Digests = {"q_table": "a" * 64, "art2": "b" * 64, "episodes": "c" * 64}


def episode(
    number: int = 0,
    outcome: Outcome = "inserted",
    episode_return: float = -16.0,
    mean_force_n: float = 0.5,
    states: int = 3,
    seed: int = 0,
) -> EpisodeSummary:
    return EpisodeSummary(
        run=definition_file.run_id(DEFINITION, seed),
        episode=number,
        episode_return=episode_return,
        moves=60,
        decisions=30,
        mean_force_n=mean_force_n,
        peak_force_n=4 * mean_force_n,
        mean_torque_nm=mean_force_n / 10,
        peak_torque_nm=mean_force_n / 3,
        states=states,
        outcome=outcome,
    )


def good(count: int, episode_return: float = -16.0) -> list[EpisodeSummary]:
    return [episode(episode_return=episode_return)] * count


def failed(count: int, outcome: Outcome = "collision", episode_return: float = -16.0) -> list[EpisodeSummary]:
    return [episode(outcome=outcome, episode_return=episode_return)] * count


def write(folder: Path, runs: Sequence[RunResult], figures: dict[str, bytes] | None = None) -> None:
    result_files.write(folder, DEFINITION, summary(DEFINITION, SHA256, runs), runs, figures or {})


@pytest.mark.parametrize(
    ("episodes", "expected"),
    [
        pytest.param(good(400), 0, id="steady from the first episode"),
        pytest.param(failed(40) + good(360), 38, id="two failures of the window are allowed"),
        pytest.param(failed(1) * 3 + good(397), 1, id="the third failure is not"),
        pytest.param(good(98) + failed(2) + good(300), 0, id="exactly 98"),
        pytest.param(good(97) + failed(3) + good(300), 98, id="97 are not enough"),
        pytest.param(failed(400), None, id="never"),
        pytest.param(good(99), None, id="a window too short"),
        pytest.param(good(100), 0, id="one window"),
        pytest.param(failed(3) + good(97), None, id="one window, not steady"),
        pytest.param(failed(3) + good(98), 1, id="the last window of a short run"),
        pytest.param([], None, id="no episodes"),
        pytest.param(good(200) + (good(9) + failed(1)) * 20, 0, id="a run that gets worse was steady before"),
        pytest.param(good(100, -20.0) + good(300, -16.0), 0, id="return at the tolerance"),
        pytest.param(good(100, -20.5) + good(300, -16.0), 12, id="return beyond the tolerance at first"),
        pytest.param(good(100, -12.0) + good(300, -16.0), 0, id="better, within the tolerance"),
        pytest.param(good(200, -11.0) + good(200, -16.0), 120, id="better, beyond the tolerance"),
        pytest.param(good(200, -1.0) + good(200, 0.0), 200, id="only zero agrees with zero"),
    ],
)
def test_steady_from(episodes: list[EpisodeSummary], expected: int | None) -> None:
    assert steady_from(episodes) == expected


@pytest.mark.parametrize("outcome", ["collision", "no_progress", "move_limit"])
def test_every_outcome_but_insertion_is_a_failure(outcome: Outcome) -> None:
    assert failures_per_10(good(3) + failed(2, outcome)) == [2]
    assert steady_from(failed(3, outcome) + good(97)) is None


@given(st.lists(st.booleans(), min_size=1, max_size=260))
def test_steady_from_is_the_first_window_with_98_successes(successes: list[bool]) -> None:
    episodes = [episode(outcome="inserted" if success else "collision") for success in successes]
    windows = [n for n in range(len(successes) - 99) if sum(successes[n : n + 100]) >= 98]
    assert steady_from(episodes) == (windows[0] if windows else None)


def test_last_block_of_failures_has_what_is_left() -> None:
    assert failures_per_10(failed(10) + good(9) + failed(1) + good(2) + failed(1)) == [10, 1, 1]


@pytest.mark.parametrize(("count", "quarter"), [(1, 1), (4, 1), (5, 2), (8, 2), (2000, 500)])
def test_last_quarter_is_rounded_up(count: int, quarter: int) -> None:
    numbered = [episode(number) for number in range(count)]
    assert list(last_quarter(numbered)) == numbered[-quarter:]


def test_summary_has_exactly_this_shape() -> None:
    episodes = [episode(0, "collision", -100.0, 2.0, 1)] * 10 + [episode(1, states=7)] * 2 + failed(2, "move_limit")
    assert summary(DEFINITION, SHA256, [RunResult(5, tuple(episodes), DIGESTS)]) == {
        "experiment": "by-hand",
        "definition_sha256": SHA256,
        "runs": [
            {
                "seed": 5,
                "episodes": 14,
                "steady_from": None,
                "failures_per_10": [10, 2],
                "states": 3,
                "first_10": {"return": -100.0, "force_n": 2.0, "torque_nm": 0.2, "success": 0.0},
                "last_quarter": {"return": -16.0, "force_n": 0.5, "torque_nm": 0.05, "success": 0.5},
                "collisions": 10,
                "digests": DIGESTS,
            }
        ],
    }


def test_run_without_episodes_has_no_summary() -> None:
    with pytest.raises(ValueError, match="seed 3: expected at least one episode"):
        run_summary(RunResult(3, (), DIGESTS))


def test_episodes_digest_is_that_of_the_wire_bytes_in_order() -> None:
    first, second = episode(0), episode(1)
    assert episodes_digest([first, second]) == hashlib.sha256(codec.encode(first) + codec.encode(second)).hexdigest()
    assert episodes_digest([second, first]) != episodes_digest([first, second])


def test_files_read_back_as_written(tmp_path: Path) -> None:
    runs = [
        RunResult(
            seed, tuple(episode(n, episode_return=-n / 3, mean_force_n=0.1 * n, seed=seed) for n in range(4)), DIGESTS
        )
        for seed in (2, 11)
    ]
    write(tmp_path, runs, {"return.png": b"picture"})
    table = result_files.read_episodes(tmp_path / "episodes.csv")
    assert (table.experiment, table.definition_sha256) == ("by-hand", SHA256)
    assert table.episodes == {run.seed: run.episodes for run in runs}
    assert json.loads((tmp_path / "summary.json").read_text()) == summary(DEFINITION, SHA256, runs)
    assert definition_file.load(str(tmp_path / "definition.toml")) == replace(DEFINITION, episodes=4)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"definition.toml", "episodes.csv", "return.png", "summary.json"}


def test_csv_says_what_it_holds_and_nothing_else() -> None:
    first, *rows = result_files.episodes_csv([RunResult(7, (episode(),), DIGESTS)]).splitlines()
    assert first == (
        "seed,episode,outcome,return,moves,decisions,mean_force_n,peak_force_n,mean_torque_nm,peak_torque_nm,states"
    )
    assert rows == [f"7,0,inserted,-16.0,60,30,0.5,2.0,0.05,{0.5 / 3},3"]


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("inserted", "vanished", r"episodes\.csv:2: Invalid enum value 'vanished'"),
        (",60,", ",", r"episodes\.csv:2: expected 11 values, got 10"),
        (",60,", ",-60,", r"episodes\.csv:2: Expected `int` >= 0"),
        ("mean_force_n,", "", r"episodes\.csv:1: expected columns seed,"),
        ("\n7,0,", "\n0_7,0,", r"episodes\.csv:2: expected a whole number from 0 to"),
        (",60,", ",6_0,", r"episodes\.csv:2: Expected `int`"),
        (",60,", ",\u0666,", r"episodes\.csv:2: Expected `int`"),
        (",-16.0,", ",1_6.0,", r"episodes\.csv:2: Expected `float`"),
        ("\n7,1,", "\n8,1,", "expected equally many episodes of every seed, got seed 7 2, seed 8 1"),
    ],
)
def test_spoilt_csv_is_refused_with_file_and_line(tmp_path: Path, old: str, new: str, complaint: str) -> None:
    run = RunResult(7, (episode(0), episode(1), episode(2)), DIGESTS)
    write(tmp_path, [run])
    path = tmp_path / "episodes.csv"
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(ResultsError, match=complaint):
        result_files.read_episodes(path)


def test_what_an_editor_adds_to_a_csv_is_passed_over(tmp_path: Path) -> None:
    run = RunResult(7, (episode(0), episode(1)), DIGESTS)
    path = tmp_path / "episodes.csv"
    write(tmp_path, [run])
    path.write_text(result_files.episodes_csv([run]) + "\n", encoding="utf-8-sig")
    assert [summary.episode for summary in result_files.read_episodes(path).episodes[7]] == [0, 1]


def test_a_file_of_old_with_comments_at_its_top_is_read(tmp_path: Path) -> None:
    run = RunResult(7, (episode(0, seed=7), episode(1, seed=7)), DIGESTS)
    comments = f"# experiment: by-hand\n# definition_sha256: {SHA256}\n# force in N\n"
    path = tmp_path / "episodes.csv"
    path.write_text(comments + result_files.episodes_csv([run]))
    table = result_files.read_episodes(path)
    assert (table.experiment, table.definition_sha256, table.episodes[7]) == ("by-hand", SHA256, run.episodes)
    path.write_text(result_files.episodes_csv([run]))
    with pytest.raises(ResultsError, match=r"expected summary\.json beside it that says the experiment, got none"):
        result_files.read_episodes(path)


def test_interrupted_runs_may_be_of_any_length(tmp_path: Path) -> None:
    runs = [RunResult(7, (episode(0), episode(1)), DIGESTS), RunResult(8, (episode(0, seed=8),), DIGESTS)]
    part = summary(DEFINITION, SHA256, runs)
    part["interrupted"] = {"seeds": [7, 8, 9], "episodes": 5}
    result_files.write(tmp_path, DEFINITION, part, runs, {})
    episodes = result_files.read_episodes(tmp_path / "episodes.csv").episodes
    assert {seed: len(of_seed) for seed, of_seed in episodes.items()} == {7: 2, 8: 1}
    assert {seed: len(of_seed) for seed, of_seed in result_files.in_step(dict(episodes)).items()} == {7: 1, 8: 1}


def test_results_of_another_definition_stay(tmp_path: Path) -> None:
    write(tmp_path, [RunResult(0, (episode(),), DIGESTS)])
    result_files.prepare(tmp_path, SHA256)
    other = "f" * 64
    with pytest.raises(ResultsError, match=f"expected results of definition ffffffff, got {SHA256[:8]}; .*--force"):
        result_files.prepare(tmp_path, other)
    result_files.prepare(tmp_path, other, force=True)


@pytest.mark.parametrize("content", ["", "[]", "{}", '{"definition_sha256": 3}'])
def test_unreadable_summary_is_not_replaced_unasked(tmp_path: Path, content: str) -> None:
    (tmp_path / "summary.json").write_text(content)
    with pytest.raises(ResultsError, match="got no hash"):
        result_files.prepare(tmp_path, SHA256)


def test_folder_that_is_a_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "taken").touch()
    with pytest.raises(ResultsError, match="taken: cannot hold results: "):
        result_files.prepare(tmp_path / "taken", SHA256)


def test_no_summary_stands_beside_episodes_that_could_not_be_written(tmp_path: Path) -> None:
    run = RunResult(0, (episode(),), DIGESTS)
    write(tmp_path, [run])
    (tmp_path / "episodes.csv").unlink()
    (tmp_path / "episodes.csv").mkdir()
    with pytest.raises(ResultsError, match="results cannot be written"):
        write(tmp_path, [run])
    assert {path.name for path in tmp_path.iterdir()} == {"definition.toml", "episodes.csv"}


@given(
    title=st.text(st.characters(codec="utf-8"), max_size=200),
    alpha=st.floats(1e-12, 1),
    policy=st.sampled_from([DEFINITION.policy, EpsilonAnnealed(mu=0.25)]),
    reward=st.sampled_from([DEFINITION.reward, ForceChangeReward(rose=-7.0)]),
)
def test_definition_survives_toml(
    tmp_path_factory: pytest.TempPathFactory, title: str, alpha: float, policy: Policy, reward: Reward
) -> None:
    learner = msgspec.structs.replace(DEFINITION.learner, alpha=alpha)
    changes = tuple(Change(episode=7, key="contact.friction", value=alpha) for _ in range(8))
    definition = Definition(name="by-hand", title=title, learner=learner, policy=policy, reward=reward, changes=changes)
    path = tmp_path_factory.mktemp("toml") / "definition.toml"
    path.write_bytes(result_files.definition_toml(definition).encode())
    assert definition_file.load(str(path)) == definition
