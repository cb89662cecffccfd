"""A learnt skill in a live cell: taken up between episodes, refused when it does not fit, exact whatever dies."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from experiments.lab.in_process import InProcessRun
from experiments.lab.run import run_seed
from services.rules import skill as skills
from services.rules.skill import NamedSkill
from services.wire.codec import encode, encoding_of
from services.wire.definition_file import load, run_id
from services.wire.keys import LATEST
from services.wire.messages import Skill

EPISODES = 40
"""Long enough for a run to be still under way when a command has come up, asked, and ended."""
LEARNT_IN = 6
OTHER_ACTIONS = "moves.actions=11"

Command = Callable[..., Any]
Reference = Callable[..., dict[str, str]]


@pytest.fixture(scope="module")
def learnt(small: Path) -> NamedSkill:
    """What seed 5 learns in six episodes."""
    run = InProcessRun(load(str(small)), 5)
    list(run.episodes(LEARNT_IN))
    assert run.learnt().version > 20
    return run.learnt()


@pytest.fixture(scope="module")
def misfit(small: Path) -> NamedSkill:
    """A skill of a robot with more actions."""
    run = InProcessRun(load(str(small), [OTHER_ACTIONS]), 5)
    list(run.episodes(1))
    return run.learnt()


@pytest.fixture(scope="module")
def expected(small: Path, learnt: NamedSkill) -> dict[str, str]:
    """How the cell's run has to end that begins with the skill."""
    digests = run_seed(load(str(small)), 1, EPISODES, lambda _: None, learnt).result.digests
    return {name: str(value) for name, value in digests.items()}


@pytest.fixture
def file(learnt: NamedSkill, tmp_path: Path) -> Path:
    skills.write(tmp_path / "learnt.skill", learnt)
    return tmp_path / "learnt.skill"


@pytest.fixture
def checkpoint(house: Any, run_module: Callable[..., Any]) -> Command:
    """Run ``treenail checkpoint`` on the cell; return the process, which has ended as it should."""

    def run(*words: str, status: int = 0) -> Any:
        process = run_module("treenail.__main__", "checkpoint", *words, "--connect", house.endpoint)
        assert process.end() == status, process.out + process.err
        assert (status == 0) == (process.err == "")
        return process

    return run


def give(live: Any, wait_until: Callable[..., None], skill: NamedSkill, name: str = LATEST) -> None:
    """Put a skill into the store as any client could."""
    key, payload = live.keys.skill(name), encode(skill.skill)
    live.session.put(key, payload, encoding=encoding_of(Skill))

    def kept() -> bool:
        return [reply.ok.payload.to_bytes() for reply in live.session.get(key) if reply.ok is not None] == [payload]

    wait_until("the store has it", kept)


def restart(live: Any, *names: str) -> None:
    for name in names:
        live.processes[name].popen.kill()
        live.processes[name].end()
    live.start_loop(EPISODES, *names)


def test_running_cell_begins_another_run_and_ends_it_exactly(
    live: Any, checkpoint: Command, file: Path, learnt: NamedSkill, expected: dict[str, str], small: Path
) -> None:
    live.start_loop(EPISODES)
    live.wait_actions(30)
    said = checkpoint("import", str(file), "--yes").out
    name = run_id(load(str(small)), 1, learnt.sha256)
    began = f"run {name} began with skill {learnt.sha256[:12]}: "
    blank = run_id(load(str(small)), 1)
    kept = f"run {blank} stays in the store: treenail checkpoint export FILE --run {blank}\n"
    assert re.fullmatch(rf"{began}\d+ of {EPISODES} episodes done\n(?:{kept})?", said), said
    experiment = live.experiment()
    assert (experiment.run, experiment.skill_sha256) == (name, learnt.sha256)
    assert experiment.first_policy_version == learnt.version
    assert live.digests() == expected
    assert live.refused("task") == {}


def test_whatever_is_killed_comes_back_to_the_same_run(
    live: Any, checkpoint: Command, file: Path, expected: dict[str, str]
) -> None:
    live.start_loop(EPISODES)
    live.wait_actions(20)
    refusal = one_line(checkpoint("import", str(file), status=2))
    assert "is under way" in refusal and "expected --yes to give it up" in refusal
    checkpoint("import", str(file), "--yes")
    run = live.experiment().run
    for victims in (("agent",), ("task",), ("classifier", "sim"), ("task", "agent", "classifier")):
        live.wait_actions(9)
        restart(live, *victims)
        live.wait_alive(*victims)
        live.wait_until("the task answers", live.experiment)
        assert live.experiment().run == run
    assert live.digests() == expected


def test_skill_is_forgotten_and_taken_up_again_where_each_run_was(
    live: Any, checkpoint: Command, file: Path, learnt: NamedSkill, expected: dict[str, str], reference: Reference
) -> None:
    live.start_loop(EPISODES)
    live.wait_actions(20)
    blank = live.experiment()
    checkpoint("import", str(file), "--yes")
    live.wait_actions(20)
    assert f"run {blank.run} began with nothing learnt: " in checkpoint("import", "--none", "--yes").out
    assert live.experiment().run == blank.run
    assert live.experiment().episodes_done >= blank.episodes_done
    assert live.digests() == reference(EPISODES)
    checkpoint("import", str(file))  # also after the end
    assert live.digests() == expected
    assert live.experiment().skill_sha256 == learnt.sha256
    said = checkpoint("import", str(file)).out
    assert said.endswith(f"began with skill {learnt.sha256[:12]}: {EPISODES} of {EPISODES} episodes done\n")


def test_without_a_task_the_next_one_begins_with_it(
    live: Any, checkpoint: Command, file: Path, expected: dict[str, str]
) -> None:
    assert checkpoint("import", str(file)).out.startswith("no task is running in cell a: the next one will begin with ")
    live.start_loop(EPISODES)
    assert live.digests() == expected


def test_skill_that_does_not_fit_is_refused_and_the_run_goes_on(
    live: Any, wait_until: Callable[..., None], learnt: NamedSkill, misfit: NamedSkill, expected: dict[str, str]
) -> None:
    give(live, wait_until, learnt)
    live.start_loop(EPISODES)
    live.wait_actions(10)
    give(live, wait_until, misfit)
    wait_until("it is refused", lambda: live.refused("task") == {"SkillError": 1})
    assert "SkillError): skill: expected the actions" in live.processes["task"].out
    restart(live, "task")  # which finds a skill that does not fit, and has to know what it worked on
    live.wait_alive("task")
    wait_until("it is refused again", lambda: live.refused("task") == {"SkillError": 1})
    assert live.experiment().skill_sha256 == learnt.sha256
    assert live.digests() == expected


def test_skill_that_does_not_fit_leaves_a_new_cell_blank(
    live: Any, wait_until: Callable[..., None], misfit: NamedSkill, reference: Reference
) -> None:
    give(live, wait_until, misfit)
    live.start_loop(EPISODES)
    assert live.digests() == reference(EPISODES)
    assert live.refused("task") == {"SkillError": 1}


def test_garbage_is_refused_by_store_and_task(
    live: Any, wait_until: Callable[..., None], learnt: NamedSkill, reference: Reference
) -> None:
    live.start_loop(EPISODES)
    live.wait_actions(10)
    sound = encode(learnt.skill)
    bad = (b"", b"\xc1", sound[:-1], encode(replace(learnt.skill, contract_sha256="0" * 64)), sound + b"\0")
    for payload in bad:
        live.session.put(live.keys.skill(LATEST), payload, encoding=encoding_of(Skill))
    live.session.put(live.keys.skill(LATEST), sound, encoding="text/plain")
    live.session.put(live.keys.skill("0" * 64), sound, encoding=encoding_of(Skill))
    live.session.put(live.keys.skill("some-name"), b"text", encoding="text/plain")
    wait_until("the store refuses all", lambda: sum(live.refused("store").values()) == len(bad) + 3)
    wait_until("the task refuses all", lambda: sum(live.refused("task").values()) == len(bad) + 1)
    assert live.experiment().skill_sha256 is None
    assert live.digests() == reference(EPISODES)


def test_worker_never_acts_without_the_skill_that_the_run_began_with(
    live: Any, wait_until: Callable[..., None], learnt: NamedSkill, expected: dict[str, str]
) -> None:
    give(live, wait_until, learnt)
    live.start_loop(EPISODES)
    live.wait_actions(10)
    live.session.delete(live.keys.skill(learnt.sha256))
    restart(live, "agent")
    wait_until("the agent waits", lambda: live.phase("agent").startswith("waiting for store"))
    assert f"expected skill {learnt.sha256[:12]} in the store, got none" in live.processes["agent"].out
    give(live, wait_until, learnt, learnt.sha256)
    assert live.digests() == expected


def test_store_that_dies_does_not_pass_for_one_without_a_skill(
    live: Any, wait_until: Callable[..., None], learnt: NamedSkill, expected: dict[str, str]
) -> None:
    give(live, wait_until, learnt)
    live.start_loop(EPISODES)
    for _ in range(2):
        live.wait_actions(9)
        live.processes["store"].popen.kill()
        live.processes["store"].end()
        wait_until("the task misses it", lambda: live.phase("task").startswith("waiting for store"))
        restart(live, "task")
        wait_until("the new task waits", lambda: live.phase("task").startswith("waiting for store"))
        live.start_store()
        live.wait_alive("store", "task")
        assert live.experiment().skill_sha256 == learnt.sha256
    assert live.digests() == expected


def test_export_is_exact_at_any_episode(
    live: Any, checkpoint: Command, small: Path, learnt: NamedSkill, tmp_path: Path, wait_until: Callable[..., None]
) -> None:
    episodes = 23  # more than between two checkpoints
    give(live, wait_until, learnt)
    live.start_loop(episodes)
    live.digests()
    run = InProcessRun(load(str(small)), 1, remember=True, skill=learnt)
    after = [run.learnt(), *(run.learnt() for _ in run.episodes(episodes))]
    for episode in (0, 3, 20, 22):
        checkpoint("export", str(tmp_path / f"{episode}"), "--episode", str(episode))
        assert skills.read(tmp_path / f"{episode}") == after[episode]
    said = checkpoint("export", str(tmp_path / "0"), "--force", "--run", run.run).out
    assert skills.read(tmp_path / "0") == after[-1]
    assert f"skill {after[-1].sha256[:12]} of run {run.run} after episode {episodes}" in said
    listed = json.loads(checkpoint("list", "--json").out)
    places = [(row["run"], row["service"], row["episodes"], row["newest"]) for row in listed["runs"]]
    assert places == [(run.run, "task", 23, True), (run.run, "agent", 20, True), (run.run, "classifier", 20, True)]
    assert [(row["skill"], row["chosen"]) for row in listed["skills"]] == [(learnt.sha256, True)]
    digests = {"q_table": run.agent.learner.digest(), "art2": run.classifier.network.digest()}
    for words in ((), (run.run,), (str(tmp_path / "0"),)):
        shown = json.loads(checkpoint("show", *words, "--json").out)
        assert {name: shown[name] for name in digests} == digests
        assert (shown["skill"], shown["experiment"], shown["seed"]) == (after[-1].sha256, "small", 1)
        assert (shown["episodes"], shown["began_with"]) == (LEARNT_IN + episodes, learnt.sha256)
    assert json.loads(checkpoint("show", learnt.sha256[:9], "--json").out)["skill"] == learnt.sha256
    assert learnt.sha256[:12] in checkpoint("list").out
    assert learnt.sha256 in checkpoint("show", learnt.sha256[:9]).out


def one_line(process: Any) -> str:
    (line,) = process.err.splitlines()
    assert line.startswith(("treenail checkpoint: ", "treenail checkpoint export: argument "))
    return str(line)


def test_what_cannot_be_is_said_in_one_line(
    live: Any, checkpoint: Command, misfit: NamedSkill, file: Path, tmp_path: Path
) -> None:
    def refused(*words: str) -> str:
        return one_line(checkpoint(*words, status=2))

    out = str(tmp_path / "out")
    assert "cell a: expected a run, got none" in refused("export", out)
    assert json.loads(checkpoint("list", "--json").out) == {"runs": [], "skills": [], "left_out": {}}
    live.start_loop(2)
    live.digests()
    assert ", got 'none'" in refused("export", out, "--run", "none")
    assert "--episode: expected 0 to 2, where run " in refused("export", out, "--episode", "3")
    assert "--episode: expected a whole number from 0" in refused("export", out, "--episode", "-1")
    assert f"{tmp_path}/no/x: cannot be written: No such file" in refused("export", f"{tmp_path}/no/x")
    before = file.read_bytes()
    assert f"{file}: expected no such file yet" in refused("export", str(file))
    assert file.read_bytes() == before
    assert "none: expected a file with a skill, got none" in refused("import", f"{tmp_path}/none")
    (tmp_path / "cut").write_bytes(before[:-1])
    assert f"expected {len(before.split(bytes([10]), 4)[4])} bytes after the header" in refused(
        "import", f"{tmp_path}/cut"
    )
    skills.write(tmp_path / "misfit", misfit)
    assert "expected the actions +X,-X,+Y,-Y,+Z,+RX,-RX,+RY,-RY, got +X," in refused("import", f"{tmp_path}/misfit")
    assert "nobody.skill: expected a file with a skill, got none" in refused("show", "nobody.skill")
    assert "expected a file, or a run or skill that the store knows (" in refused("show", "0123456789ab")
    assert live.experiment().skill_sha256 is None
    assert live.refused("task") == {}


def test_without_a_store_nothing_is_promised(house: Any, checkpoint: Command, file: Path, tmp_path: Path) -> None:
    assert "cell 'a': nobody is alive" in one_line(checkpoint("export", str(tmp_path / "out"), status=2))
    assert "store: expected it to keep checkpoint/skill/" in one_line(checkpoint("import", str(file), status=2))
