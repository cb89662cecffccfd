"""Deep learners beside Treenail's own: the same episodes, figures, a second start goes on, one line without torch."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import msgspec
import pytest

pytest.importorskip("gymnasium", reason="the extra gym is not installed")


from experiments.deep import folding, jobs, libraries, methods, page, plan, runner, study
from experiments.deep.episodes import Numbered
from experiments.deep.jobs import Environment, Job, Learnt, Order, key
from experiments.deep.learner import work
from experiments.evaluate.controllers import RandomMoves
from experiments.evaluate.trial import trial
from experiments.lab import pool
from experiments.lab.progress import Lines
from experiments.leaderboard.figures import figures
from experiments.leaderboard.jobs import Outcome
from experiments.reproduce.cache import Cache
from services.wire.definition import Definition
from treenail import load
from treenail.commands import deep as command
from treenail.registration import peg_in_hole

HERE = Environment(peg_in_hole, ("treenail.gym",))
SHORT = {"start.height_mm": 0.4, "limits.success_fraction": 0.3, "limits.move_limit": 60}
QUIET = Lines(lambda _line: None, lambda: 0.0)


@pytest.fixture(name="there")
def _there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the libraries seem to be there: what is tested here does not use them."""
    monkeypatch.setattr(libraries, "require", lambda: None)
    for module in (jobs, study):
        monkeypatch.setattr(module, "versions", lambda: {"torch": "0"})


def short() -> Definition:
    return load("suite-round", SHORT)


def outcome(letters: str, force_n: float = 1.0) -> Outcome:
    count = len(letters)
    return Outcome(letters, [-1.0] * count, [force_n] * count, [2.0] * count, [50] * count, 0, 1.5)


def job(method: str = "ppo", seed: int = 100, episodes: int = 30) -> Job:
    return Job("suite-round", methods.methods([method])[0], load("suite-round"), seed, episodes)


def learnt(letters: str = "c" * 10 + "i" * 20, force_n: float = 1.0) -> Learnt:
    return Learnt(outcome(letters, force_n), outcome("i" * jobs.FROZEN), 1234)


# -- episodes --------------------------------------------------------------------------------------------------------


def test_episodes_are_those_of_every_other_run_whatever_the_library_resets_with() -> None:
    """The same moves as in a trial of ``treenail evaluate``, through the environment, come to the same figures."""
    definition, heard = short(), list[int]()
    numbered = Numbered(peg_in_hole(definition=definition), 5, heard.append)
    choices = RandomMoves(definition, 5)
    expected = trial(definition, RandomMoves(definition, 5), 5, 3).episodes
    for seed in (77, None, 78):
        numbered.reset(seed=seed)
        choices.begin()
        over = False
        while not over:
            *_, terminated, truncated, _ = numbered.step(choices.decide(numbered.unwrapped._asked).action)  # type: ignore[attr-defined]
            over = terminated or truncated
    got = numbered.outcome(3, 0.0)
    assert got.outcomes == "".join(
        {"inserted": "i", "collision": "c", "move_limit": "m"}[one.outcome] for one in expected
    )
    assert (got.returns, got.moves) == ([one.episode_return for one in expected], [one.moves for one in expected])
    assert got.peak_n == [one.peak_force_n for one in expected]
    assert heard == [1, 2, 3] and numbered.steps == sum(one.decisions for one in expected)


def test_an_episode_that_ends_at_its_first_touch_has_its_point_too() -> None:
    """Seed 100 of the round peg begins its episode 11 over the hole: it goes in without a decision."""
    definition = load("suite-round")
    numbered = Numbered(peg_in_hole(definition=definition), 100)
    _, info = numbered.reset(options={"episode": 11})
    assert (info["passed_over"], info["episode_number"], numbered.over) == (1, 12, 1)
    expected = trial(definition, RandomMoves(definition, 100), 100, 12).episodes[11]
    got = numbered.outcome(1, 0.0)
    assert (got.outcomes, expected.outcome, expected.decisions) == ("i", "inserted", 0)
    assert (got.moves, got.returns) == ([expected.moves], [expected.episode_return])
    assert got.peak_n == [expected.peak_force_n] and got.force_n == [pytest.approx(expected.mean_force_n)]


# -- figures ---------------------------------------------------------------------------------------------------------


def test_points_of_a_curve() -> None:
    whole = outcome("c" * 5 + "i" * 5 + "i" * 10 + "ic")
    assert folding.curve(whole) == {"failures": [0.5, 0.0, 0.5], "force_n": [1.0, 1.0, 1.0]}


@pytest.mark.parametrize(
    ("letters", "success", "force_n", "expected"),
    [
        ("i" * 20, 1.0, 9.0, 0),
        ("c" * 7 + "i" * 20, 1.0, 9.0, 7),
        ("c" * 7 + "i" * 20, 0.9, 9.0, 5),
        ("i" * 19, 1.0, 9.0, None),
        ("ic" * 40, 1.0, 9.0, None),
        ("i" * 40, 1.0, 0.9, None),
    ],
)
def test_from_when_on_a_learner_is_as_good(letters: str, success: float, force_n: float, expected: int | None) -> None:
    assert folding.as_good(outcome(letters), success, force_n) == expected


def test_a_row_says_what_each_seed_took() -> None:
    rule = figures({1: outcome("i" * 40, 0.5)}, learns=False)
    made = {100: learnt(force_n=0.4), 101: learnt("c" * 30)}
    row = folding.row("suite-round", "ppo", {seed: of.outcome for seed, of in made.items()}, rule, True, made)
    assert (row["as_sure_after"], row["as_good_after"], row["decisions"]) == ([10, None], [10, None], [1234, 1234])
    assert row["figures"]["success"] == 0.5 and row["force_of_rule"] == pytest.approx(1.4)
    assert row["frozen"] is not None and row["frozen"]["successes"] == row["frozen"]["trials"] == 2 * jobs.FROZEN
    assert page.after(row["as_sure_after"]) == "10, never"


# -- methods ---------------------------------------------------------------------------------------------------------


def test_what_was_chosen_was_tried_and_is_of_the_same_algorithm() -> None:
    tried = {method.name: method for method in methods.TRIED}
    defaults = {method.name: method for method in methods.DEFAULTS}
    assert set(methods.CHOSEN) == {f"{name}-tuned" for name in defaults}
    for name, which in methods.CHOSEN.items():
        assert tried[which].algorithm == defaults[name.removesuffix("-tuned")].algorithm
    assert all(not (method.settings or method.scaled or method.history) for method in methods.DEFAULTS)
    assert not set(plan.TUNING_SEEDS) & set(plan.SEEDS)


def test_requirements_are_pinned_and_are_those_that_are_asked_for() -> None:
    lines = (Path(libraries.__file__).parent / "requirements.txt").read_text().splitlines()
    pins = [line for line in lines if not line.startswith("#")]
    assert all(re.fullmatch(r"[a-z0-9-]+==[0-9.]+", pin) for pin in pins), pins
    assert {pin.partition("==")[0] for pin in pins} == set(libraries.LIBRARIES.values()) - {"gymnasium"}


# -- a second start --------------------------------------------------------------------------------------------------


@pytest.mark.usefixtures("there")
def test_a_run_is_known_by_all_that_decides_it_and_not_by_its_name() -> None:
    first = key(job(), HERE)
    renamed = msgspec.structs.replace(job().method, name="other")
    assert key(msgspec.structs.replace(job(), method=renamed), HERE) == first
    assert (
        len({str(key(one, HERE)) for one in (job(), job(seed=101), job(episodes=31), job("ppo-tuned"), job("dqn"))})
        == 5
    )


@pytest.mark.usefixtures("there")
def test_a_second_start_does_what_is_missing_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kept, wanted = Cache(tmp_path, pytest.fail), [job(seed=seed) for seed in (100, 101)]
    kept.keep(jobs.KIND, key(wanted[0], HERE), learnt(), Learnt)
    begun = list[str]()

    def spread(
        _work: object, orders: Sequence[Order], _jobs: int, name: Callable[[Order], str], _advanced: object
    ) -> Iterator[tuple[int, Learnt]]:
        for index, order in enumerate(orders):
            begun.append(name(order))
            yield index, learnt(force_n=3.0)

    monkeypatch.setattr(pool, "spread", spread)
    made = runner.run(wanted, kept, HERE, 1, QUIET)
    assert begun == ["suite-round, ppo, seed 101, 30 episodes"]
    assert [made[one].outcome.force_n[0] for one in wanted] == [1.0, 3.0]
    assert list(runner.there_is(wanted, kept, HERE)) == wanted
    runner.run(wanted, kept, HERE, 1, QUIET)
    assert len(begun) == 1


# -- the page --------------------------------------------------------------------------------------------------------


def test_what_people_wrote_on_the_page_stays() -> None:
    written = f"# x\n\n{page.FINDINGS}\n\nPPO does it.\n\n- Not DQN.\n\n![y](deep.png)\n\n## z\n"
    assert page.findings_of(written).strip() == f"{page.FINDINGS}\n\nPPO does it.\n\n- Not DQN."
    assert page.findings_of("") == page.findings_of("# another page\n") == ""


@pytest.mark.usefixtures("there")
def test_the_page_of_what_is_there(tmp_path: Path) -> None:
    chosen = methods.methods(["ppo", "ppo-tuned", "sac"])
    wanted = plan.Study((load("suite-round"),), chosen, (100, 101), 30, plan.Longer(chosen[0], 40))
    done = {one.place: learnt() for one in wanted.jobs() if one.method.name != "sac"}
    done |= {one.place: learnt("i" * 40) for one in wanted.longer_jobs()}
    others = {"treenail": {100: outcome("i" * 30, 0.2)}, "rule-tip": {100: outcome("i" * 40, 0.3)}}
    deep = {name: {100: outcome("c" * 30), 101: outcome("i" * 30)} for name in ("ppo", "ppo-tuned")}
    made = study.Made({"suite-round": {**others, **deep}}, done)
    (tmp_path / "deep.md").write_text(f"# old\n\n{page.FINDINGS}\n\nStill true.\n\n## methods\n")
    tried = [page.Tried(methods.TRIED[0], 0.5, 1.0)]
    written = study.tell(wanted, made, tried, tmp_path, "treenail deep").read_text()
    assert "Still true." in written and written.count(page.FINDINGS) == 1
    assert "| `ppo` | 10 (20) | 50.0 % (" in written and "| `ppo-tuned` | never, 0 | never, never |" in written
    assert "`ppo` for longer" in written and "| `dqn-a` |" in written and "`sac` |" not in written
    assert (tmp_path / "deep.png").read_bytes()[:4] == b"\x89PNG"
    told = json.loads((tmp_path / "deep.json").read_text())
    assert [row["method"] for row in told["rows"]] == ["treenail", "rule-tip", "ppo", "ppo-tuned"]
    assert told["longer"][0]["figures"]["episodes"] == 40 and told["tried"][0]["method"]["name"] == "dqn-a"


# -- the command -----------------------------------------------------------------------------------------------------


def test_without_its_libraries_one_line_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "sb3_contrib", None)
    assert command.main(["--out", str(tmp_path / "nowhere")]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1 and said.startswith("treenail deep: expected gymnasium, torch, ")
    assert "sb3-contrib; in Treenail's folder: pip install" in said and f"-r {libraries.REQUIREMENTS}" in said
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("there")
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--methods", "a2c"), "--methods: expected some of dqn, "),
        (("--tasks", "nothing"), "--tasks: expected some of "),
        (("--seeds", "5", "3..6"), "--seeds: expected every seed once, got 5 3 4 5 6"),
        (("--longer", "ppo", "many"), "--longer: expected a whole number from 1, got 'many'"),
        (("--page-only",), "nothing has been run yet"),
    ],
)
def test_what_is_wrong_is_said_before_anything_runs(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, words: tuple[str, ...], said: str
) -> None:
    assert command.main([*words, "--out", str(tmp_path)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and lines[0].startswith(f"treenail deep: {said}"), lines


def test_the_page_names_the_command_that_made_it() -> None:
    words = "--tasks suite-round --methods dqn ppo --seeds 100 101 --episodes 50 --longer ppo 90 --page docs"
    assert command.command(command._parser().parse_args(words.split())) == f"treenail deep {words}"
    assert command.command(command._parser().parse_args(["--jobs", "1"])) == "treenail deep --tasks suite-round"


# -- with the libraries ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", ["dqn", "recurrent-ppo-tuned", "sac-tuned"])
def test_it_learns_and_twice_the_same(method: str) -> None:
    for module in ("torch", "stable_baselines3", "sb3_contrib"):
        pytest.importorskip(
            module, reason=f"{module} is not installed: no part of Treenail, see {libraries.REQUIREMENTS}"
        )
    told = list[int]()

    def tell(count: int) -> bool:
        told.append(count)
        return True

    order = Order(Job("suite-round", methods.methods([method])[0], short(), 7, 3), HERE)
    first, second = work(order, tell), work(order, lambda _: True)
    assert len(first.outcome.outcomes) == 3 and len(first.frozen.outcomes) == jobs.FROZEN
    assert told == [1, 2, 3, *range(1, jobs.FROZEN + 1)] and first.decisions > 20
    for name in ("outcomes", "returns", "force_n", "peak_n", "moves"):
        assert getattr(first.outcome, name) == getattr(second.outcome, name), name
        assert getattr(first.frozen, name) == getattr(second.frozen, name), name
