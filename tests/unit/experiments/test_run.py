"""Runs in processes of their own, and the command as its user meets it."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from experiments.lab.pool import PieceError
from experiments.lab.progress import LINE_EVERY_S, Lines, Runs, table
from experiments.lab.run import TimedRun, run_seed, run_seeds
from experiments.lab.skills import digests
from services.rules import skill as skill_file
from services.rules.results import Digests, RunResult, RunSummary, run_summary
from services.wire import definition_file
from services.wire.messages import EpisodeSummary
from treenail.commands.experiment import main

NAME = "chamfered-q-softmax"
SHORT = "limits.move_limit=25"
"""A setting with which an episode takes no time worth mentioning."""
FULL = ("classifier.capacity=1", "classifier.when_full=refuse")
"""Settings with which a run fails as soon as a second contact state is felt."""
REPOSITORY = Path(__file__).parents[3]
PROGRAM = [sys.executable, "-m", "treenail.commands.experiment"]
DEADLINE_S = 60.0
NONE_LEARNT: Any = None


class Heard:
    """A listener that keeps what it hears."""

    def __init__(self) -> None:
        self.events: list[tuple[str, int, int]] = []

    def started(self, seed: int) -> None:
        self.events.append(("started", seed, 0))

    def advanced(self, seed: int, episodes: int) -> None:
        self.events.append(("advanced", seed, episodes))

    def finished(self, seed: int) -> None:
        self.events.append(("finished", seed, 0))

    def of(self, seed: int) -> list[tuple[str, int]]:
        return [(what, episodes) for what, of_seed, episodes in self.events if of_seed == seed]


def spawned_by(pid: int) -> list[int]:
    """Return the processes for runs that a process has started."""
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return [int(child) for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the command, as a process, ran seeds 4 and 1 for three episodes."""
    folder = tmp_path_factory.mktemp("command")
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY), "COLUMNS": "100"}
    line = [
        sys.executable,
        "-m",
        "treenail.commands.experiment",
        "run",
        NAME,
        "--set",
        SHORT,
        "--seed-list",
        "4,1",
        "--episodes",
        "3",
    ]
    done = subprocess.run(line, cwd=folder, env=environment, capture_output=True, text=True, timeout=DEADLINE_S)
    assert done.returncode == 0, done.stderr
    assert done.stderr.splitlines()[0] == "all: 6 episodes"
    assert {"seed 1: 3 episodes", "seed 4: 3 episodes"} <= set(done.stderr.splitlines())
    (folder / "stdout").write_text(done.stdout)
    return folder


def results_of(folder: Path) -> Path:
    sha256 = definition_file.definition_sha256(definition_file.load(NAME, [SHORT]))
    return folder / "runs" / "experiments" / f"{NAME}-{sha256[:8]}"


def test_same_seed_gives_the_same_run_in_every_process_and_order(folder: Path) -> None:
    heard = Heard()
    definition = definition_file.load(NAME, [SHORT])
    again = run_seeds(definition, [1, 4], 3, 1, heard)
    here = run_seed(definition, 4, 3, lambda _: None)
    assert here.result == again[1].result
    written = json.loads((results_of(folder) / "summary.json").read_text())
    assert [run_summary(run.result) for run in again] == written["runs"]
    assert written["runs"][0]["digests"] != written["runs"][1]["digests"]
    assert [event[1] for event in heard.events] == sorted(event[1] for event in heard.events), "one after the other"
    for seed in (1, 4):
        first, *between, last = heard.of(seed)
        assert (first, last) == (("started", 0), ("finished", 0))
        assert between == sorted(set(between))
        assert between[-1] == ("advanced", 3)


def test_command_leaves_results_and_a_table(folder: Path) -> None:
    results = results_of(folder)
    names = {"summary.json", "episodes.csv", "definition.toml", "return.png", "force.png", "torque.png", "failures.png"}
    assert {path.name for path in results.iterdir()} == {*names, "seed1.skill", "seed4.skill"}
    assert definition_file.load(str(results / "definition.toml")).episodes == 3, "what ran, not the definition's 2000"
    written = json.loads((results / "summary.json").read_text())
    assert [(run["seed"], run["episodes"]) for run in written["runs"]] == [(1, 3), (4, 3)]
    stdout = (folder / "stdout").read_text()
    for expected in ("steady from", "force [N]", "collisions", "moves/s", "median", str(results.relative_to(folder))):
        assert expected in stdout


def test_each_seed_leaves_what_it_has_learnt(folder: Path) -> None:
    for run in json.loads((results_of(folder) / "summary.json").read_text())["runs"]:
        skill = skill_file.read(results_of(folder) / f"seed{run['seed']}.skill").skill
        assert (skill.seed, skill.episodes) == (run["seed"], 3)
        assert dict(digests(skill)) == {name: run["digests"][name] for name in ("q_table", "art2")}


def test_figures_are_drawn_again_from_the_episodes(folder: Path) -> None:
    figure = results_of(folder) / "return.png"
    before = figure.read_bytes()
    figure.unlink()
    assert main(["plot", str(results_of(folder))]) == 0
    assert figure.read_bytes() == before


def test_failing_seed_ends_all_and_is_named() -> None:
    with pytest.raises(PieceError, match=r"^seed [38]: observation: decision \d+: classes: expected at most 1 "):
        run_seeds(definition_file.load(NAME, FULL), [8, 3], 50, 2, Heard())


def test_child_that_dies_is_a_failure_of_its_seed() -> None:
    class Killer(Heard):
        def advanced(self, seed: int, episodes: int) -> None:
            (child,) = spawned_by(os.getpid())
            os.kill(child, signal.SIGKILL)

    with pytest.raises(PieceError, match=r"^seed 6: its process ended without a result, signal 9$"):
        run_seeds(definition_file.load(NAME), [6], 100_000, 1, Killer())


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        pytest.param(
            ("run", NAME, "--seed-list", "7", *(part for setting in FULL for part in ("--set", setting))),
            r"seed 7: observation: decision [0-9]+: classes: .*; traceback in runs/.*/error\.log",
            id="failing seed",
        ),
        pytest.param(("run", NAME, "--set", "moves.actions=7"), r".*moves\.actions.*", id="wrong setting"),
        pytest.param(("show", "chamfered-q-sofmax"), r".*did you mean 'chamfered-q-softmax'\?", id="wrong name"),
        pytest.param(("run", NAME, "--out", "taken"), r"taken: cannot hold results: .*", id="folder is a file"),
        pytest.param(("run", NAME, "--out", "other"), r"other/summary\.json: .*--force.*", id="other definition"),
        pytest.param(("plot", "nowhere"), r"nowhere/episodes\.csv: cannot be read: .*", id="nothing to draw"),
    ],
)
def test_error_is_one_line_and_status_2(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: tuple[str, ...],
    complaint: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").touch()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "summary.json").write_text(json.dumps({"definition_sha256": "0" * 64}))
    assert main(arguments) == 2
    stdout, stderr = capsys.readouterr()
    assert stdout == ""
    said = [line for line in stderr.splitlines() if not re.fullmatch(r"seed \d+: \d+ episodes", line)]
    assert len(said) == 1
    assert re.fullmatch("treenail experiment: " + complaint, said[0])
    assert not list(tmp_path.glob("runs/**/summary.json"))


FAULTY = """
from services.classifier.fuzzy_art import FuzzyArt

class Faulty(FuzzyArt):
    def learn(self, force_n, torque_nm):
        if self.states:
            self.loose = 1 // 0
        return super().learn(force_n, torque_nm)
"""


def test_a_plug_in_that_fails_is_named_with_its_place_and_leaves_a_traceback(tmp_path: Path) -> None:
    site = tmp_path / "site"
    (site / "faulty-1.dist-info").mkdir(parents=True)
    (site / "faulty.py").write_text(FAULTY)
    (site / "faulty-1.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: faulty\nVersion: 1\n")
    (site / "faulty-1.dist-info" / "entry_points.txt").write_text("[treenail.classifiers]\nfaulty = faulty:Faulty\n")
    plugged = ("--set", "classifier.kind=plugin", "--set", "classifier.name=faulty")
    done = subprocess.run(
        [*PROGRAM, "run", NAME, *plugged, "--episodes", "2", "--out", "out", "--debug"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": f"{site}:{REPOSITORY}"},
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        check=False,
    )
    assert done.returncode == 2
    place = rf"{site}/faulty\.py:7 in learn"
    said = done.stderr.splitlines()[-1]
    expected = rf"treenail experiment: seed 0: ZeroDivisionError: .* \({place}\); traceback in out/error\.log"
    assert re.fullmatch(expected, said)
    trace = (tmp_path / "out" / "error.log").read_text()
    assert "self.loose = 1 // 0" in trace and trace in done.stderr


@pytest.mark.parametrize(
    "arguments",
    [("--seed-list", "1,1"), ("--seed-list", "1,x"), ("--seed-list", "-1"), ("--episodes", "0"), ("--jobs", "x")],
)
def test_impossible_numbers_are_refused(capsys: pytest.CaptureFixture[str], arguments: tuple[str, str]) -> None:
    option, value = arguments
    with pytest.raises(SystemExit) as ended:
        main(["run", NAME, f"{option}={value}"])
    assert ended.value.code == 2
    assert f"argument {option}: expected " in capsys.readouterr().err.splitlines()[-1]


def test_list_and_show(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    listed = capsys.readouterr().out.splitlines()
    assert [line.split("  ")[0].strip() for line in listed] == list(definition_file.shipped())
    assert main(["show", NAME, "--set", "learner.alpha=0.125"]) == 0
    shown = capsys.readouterr().out
    definition = definition_file.load(NAME, ["learner.alpha=0.125"])
    assert shown.startswith(f"# definition_sha256: {definition_file.definition_sha256(definition)}\n")
    (tmp_path / "shown.toml").write_text(shown)
    assert definition_file.load(str(tmp_path / "shown.toml")) == definition


def living(group: int) -> list[int]:
    """Return the processes of a group that have not ended (a zombie has)."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            state, _, its_group = stat.read_text().rpartition(")")[2].split()[:3]
        except (FileNotFoundError, ProcessLookupError):
            continue
        if int(its_group) == group and state != "Z":
            found.append(int(stat.parent.name))
    return found


def wait_until(holds: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + DEADLINE_S
    while not holds():
        assert time.monotonic() < deadline, f"waited in vain until {what}"
        os.sched_yield()


def test_interrupt_keeps_the_episodes_so_far(tmp_path: Path) -> None:
    line = [*PROGRAM, "run", NAME, "--set", SHORT, "--seeds", "3", "--jobs", "1", "--episodes", "100000"]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    with subprocess.Popen(
        [*line, "--out", "out"],
        cwd=tmp_path,
        env=environment,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        assert process.stderr is not None
        for said in process.stderr:
            if re.match(r"seed 0: \d+ of 100000 episodes", said):
                break
        os.killpg(process.pid, signal.SIGINT)
        *_, last = process.stderr
        assert process.wait(DEADLINE_S) == 130
    written = json.loads((tmp_path / "out" / "summary.json").read_text())
    (run,) = written["runs"]
    said = f"interrupted; of 100000 episodes kept {run['episodes']} of seed 0, in out"
    assert last == f"treenail experiment: {said}\n"
    assert written["interrupted"] == {"seeds": [0, 1, 2], "episodes": 100000}
    again = run_seed(definition_file.load(NAME, [SHORT]), 0, run["episodes"], lambda _: None)
    assert again.result.digests == run["digests"]
    assert skill_file.read(tmp_path / "out" / "seed0.skill").sha256 == again.skill.sha256
    assert main(["plot", str(tmp_path / "out")]) == 0
    wait_until(lambda: not living(process.pid), "no process is left")


@pytest.mark.parametrize("moment", ["children starting", "terminated"])
def test_interrupt_ends_every_process_without_results(tmp_path: Path, moment: str) -> None:
    line = [
        sys.executable,
        "-m",
        "treenail.commands.experiment",
        "run",
        NAME,
        "--seeds",
        "3",
        "--jobs",
        "2",
        "--out",
        "out",
    ]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    with subprocess.Popen(
        line, cwd=tmp_path, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        assert process.stderr is not None
        assert process.stderr.readline().startswith("all: ")
        wait_until(lambda: len(spawned_by(process.pid)) == 2, "both are starting")
        if moment == "terminated":
            process.terminate()
        else:
            os.killpg(process.pid, signal.SIGINT)
        said = [line for line in process.stderr if not re.fullmatch(r"seed \d: \d+ episodes\n", line)]
        assert said == ["treenail experiment: interrupted, no results written\n"]
        assert process.wait(DEADLINE_S) == 130
    wait_until(lambda: not living(process.pid), "no process is left")
    assert list((tmp_path / "out").iterdir()) == []


def test_runs_end_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    line = [*PROGRAM, "run", NAME, "--seeds", "2", "--jobs", "2"]
    environment = {**os.environ, "PYTHONPATH": str(REPOSITORY)}
    with subprocess.Popen(
        line, cwd=tmp_path, env=environment, stderr=subprocess.DEVNULL, start_new_session=True
    ) as process:
        wait_until(lambda: sum("sapien" in maps_of(pid) for pid in living(process.pid)) == 2, "both have physics")
        process.kill()
        process.wait(DEADLINE_S)
    wait_until(lambda: not living(process.pid), "no process is left")


def maps_of(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/maps").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return ""


def test_log_hears_of_progress_now_and_then() -> None:
    said: list[str] = []
    now_s = 0.0
    lines = Lines(said.append, lambda: now_s)
    runs = Runs(lines, 1, 50)
    runs.started(3)
    for episodes, at in [(1, 1.0), (7, LINE_EVERY_S), (8, LINE_EVERY_S + 1), (20, 2 * LINE_EVERY_S), (50, 60.0)]:
        now_s = at
        runs.advanced(3, episodes)
    runs.finished(3)
    assert said == [
        "seed 3: 50 episodes",
        "seed 3: 7 of 50 episodes, about 92 s left",
        "seed 3: 20 of 50 episodes, about 45 s left",
        "seed 3: done in 60 s",
    ]


def test_what_is_there_from_before_tells_nothing_of_the_time_left() -> None:
    said: list[str] = []
    now_s = 0.0
    reach = Lines(said.append, lambda: now_s).begin("cliff", 10, "pieces", 8)
    now_s = 600.0
    reach(9)
    reach(10)
    assert said == [
        "cliff: 10 pieces, 8 of them from before",
        "cliff: 9 of 10 pieces, about 10 min left",
        "cliff: done in 10 min",
    ]


def test_several_seeds_are_counted_together_too() -> None:
    said: list[str] = []
    now_s = 0.0
    runs = Runs(Lines(said.append, lambda: now_s), 2, 10)
    for seed in (0, 1):
        runs.started(seed)
    now_s = 20.0
    for seed in (0, 1):
        runs.advanced(seed, 5)
    assert "all: 5 of 20 episodes, about 60 s left" in said


def summaries(seed: int, count: int) -> TimedRun:
    digests: Digests = {"q_table": "", "art2": "", "episodes": ""}
    one = EpisodeSummary(
        run=f"{'0' * 16}-s{seed}",
        episode=0,
        episode_return=-10.0 * seed,
        moves=60,
        decisions=30,
        mean_force_n=0.25 * seed,
        peak_force_n=2.0,
        mean_torque_nm=0.1,
        peak_torque_nm=0.2,
        states=seed,
        outcome="inserted",
    )
    return TimedRun(RunResult(seed, (one,) * count, digests), NONE_LEARNT, 2.0)


def cells(count: int, seeds: list[int]) -> list[list[str]]:
    timed = [summaries(seed, count) for seed in seeds]
    runs: list[RunSummary] = [run_summary(run.result) for run in timed]
    made = table("by hand", runs, [run.moves_per_s for run in timed])
    return [list(map(str, row)) for row in zip(*(column.cells for column in made.columns), strict=True)]


def test_table_has_a_row_a_seed_and_their_median() -> None:
    assert cells(100, [1, 2, 6]) == [
        ["1", "0", "-10.0", "0.25", "100.0%", "0", "1", "3000"],
        ["2", "0", "-20.0", "0.50", "100.0%", "0", "2", "3000"],
        ["6", "0", "-60.0", "1.50", "100.0%", "0", "6", "3000"],
        ["median", "0", "-20.0", "0.50", "100.0%", "0", "2", "3000"],
    ]
    assert cells(10, [4]) == [["4", "-", "-40.0", "1.00", "100.0%", "0", "4", "300"]]
