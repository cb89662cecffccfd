"""Benchmarks: reports are well-formed and count what really passed; no test looks at how long anything took."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from experiments.bench.__main__ import lines, main
from experiments.bench.bare_chain import BareChain, ChainTimes, Decision, Motion, Rewarded, bare_processes
from experiments.bench.cell import Subject
from experiments.bench.loop import Round, report
from experiments.bench.parts import ART2_CASES
from experiments.bench.pattern import Pattern, Timed, pattern, timed
from experiments.bench.values import Value, spread
from experiments.lab.in_process import InProcessRun
from services.bus.routing import open_router
from services.bus.session import open_client
from services.cell.traffic import percentile
from services.wire.definition_file import load
from services.wire.errors import NoAnswerError

NAME = "chamfered-q-softmax"
SHORT = ("limits.move_limit=30", "start.height_mm=0.2")
SEED, EPISODES = 3, 4
UNITS = ("_us", "_s", "_per_s")


@pytest.fixture(scope="module")
def plan() -> Pattern:
    return pattern(load(NAME, SHORT), SEED, EPISODES)


def test_the_pattern_has_every_message_of_the_counted_episodes(plan: Pattern) -> None:
    expected = tuple(InProcessRun(load(NAME, SHORT), SEED).episodes(1 + EPISODES))[1:]
    assert plan.summaries == expected
    assert plan.decisions == sum(summary.decisions for summary in expected) > 0
    assert plan.motions == sum(summary.moves + 1 for summary in expected), "one homing an episode"
    rewards = sum(isinstance(exchange, Rewarded) for exchange in plan.exchanges)
    assert rewards == plan.decisions, "every decision is rewarded once"


def test_the_pattern_has_the_order_of_the_loop(plan: Pattern) -> None:
    letters = "".join({Motion: "m", Decision: "d", Rewarded: "r"}[type(exchange)] for exchange in plan.exchanges)
    # Homing and guidance first; a decision's motion, guidance while there is no contact, and then the reward.
    assert re.fullmatch(r"(m+(dm+r)*)+", letters)
    assert all(size > 4 for exchange in plan.exchanges for size in exchange), "room for the chain's header"


def test_timed_counts_what_the_pattern_counts(plan: Pattern) -> None:
    found = timed(load(NAME, SHORT), SEED, EPISODES)
    assert (found.motions, found.decisions) == (plan.motions, plan.decisions)
    assert 0 < found.physics_s < found.total_s


class Router(NamedTuple):
    endpoint: str


@pytest.fixture
def router(short_path: object) -> Iterator[Router]:
    endpoint = f"unixsock-stream/{short_path}/z"
    session = open_router([endpoint])
    yield Router(endpoint)
    session.close()  # type: ignore[no-untyped-call]


def test_the_bare_chain_plays_a_pattern_through_real_processes(
    router: Router, plan: Pattern, wait_until: Callable[..., None]
) -> None:
    session = open_client([router.endpoint])
    try:
        with bare_processes(router.endpoint) as running:
            chain = BareChain(session)
            chain.wait(running)
            sizes: list[tuple[str, int]] = []
            watcher = session.declare_subscriber(
                "treenail/bare/*", lambda sample: sizes.append((str(sample.key_expr), len(sample.payload.to_bytes())))
            )
            found = chain.play([Motion(90, 70, 80), Rewarded(40), Decision(50, 60, 20)])
            wait_until("all five are seen", lambda: len(sizes) == 5)
            watcher.undeclare()  # type: ignore[no-untyped-call]
            assert found.total_s == pytest.approx(found.motions_s + found.decisions_s)
            seen = {key.rpartition("/")[2]: size for key, size in sizes}
            assert seen == {"ft": 70, "reward": 40, "observation": 50, "state": 60, "action": 20}
            assert chain.play(plan.exchanges[:20]).total_s > 0
    finally:
        session.close()  # type: ignore[no-untyped-call]


def test_a_bare_chain_without_its_processes_says_so(router: Router) -> None:
    session = open_client([router.endpoint])

    def ended() -> None:
        raise NoAnswerError("robot ended")

    try:
        with pytest.raises(NoAnswerError, match="robot ended"):
            BareChain(session).wait(ended)
    finally:
        session.close()  # type: ignore[no-untyped-call]


def test_the_ratio_is_of_one_round_and_the_report_gives_its_median(plan: Pattern) -> None:
    def one(physics_s: float, chain_s: float, distributed_s: float) -> Round:
        timing = Timed(plan.motions, plan.decisions, 2 * physics_s, physics_s)
        return Round(timing, ChainTimes(chain_s, 0.4 * chain_s, 0.6 * chain_s), distributed_s)

    found = report(Subject(NAME, SHORT, SEED), plan, [one(1.0, 1.0, 2.5), one(1.0, 2.0, 6.0), one(2.0, 1.0, 5.0)])
    assert found["ratio"] == {"median": 2.5, "min": 1.5, "max": 3.0}
    assert found["target_met"] is False
    physics_us = found["physics_us"]
    assert isinstance(physics_us, Mapping)
    assert physics_us["median"] == pytest.approx(1e6 / plan.decisions)
    assert report(Subject(NAME, SHORT, SEED), plan, [one(1.0, 1.0, 3.0)])["target_met"] is True


def test_what_security_costs_is_reported_where_it_was_measured(plan: Pattern) -> None:
    timing = Timed(plan.motions, plan.decisions, 2.0, 1.0)
    chain = ChainTimes(1.0, 0.4, 0.6)
    found = report(
        Subject(NAME, SHORT, SEED),
        plan,
        [Round(timing, chain, without_s, with_s) for without_s, with_s in ((2.0, 2.2), (4.0, 6.0), (1.0, 1.25))],
    )
    assert found["secured_ratio"] == {"median": 1.25, "min": 1.1, "max": 1.5}
    assert found["secured_target_met"] is False
    alone = report(Subject(NAME, SHORT, SEED), plan, [Round(timing, chain, 2.0)])
    assert "secured_ratio" not in alone and "together_us" not in alone


def test_a_cell_of_one_process_is_reported_beside_the_other(plan: Pattern) -> None:
    timing, chain = Timed(plan.motions, plan.decisions, 2.0, 1.0), ChainTimes(1.0, 0.4, 0.6)
    rounds = [Round(timing, chain, 2.0, together_s=seconds) for seconds in (1.0, 2.0, 4.0)]
    per_s = report(Subject(NAME, SHORT, SEED), plan, rounds)["together_decisions_per_s"]
    assert per_s == {"median": plan.decisions / 2, "min": plan.decisions / 4, "max": plan.decisions / 1}


def _figures(value: object, name: str = "") -> Iterator[tuple[str, Mapping[str, float]]]:
    """Give all measured figures of a report."""
    if isinstance(value, dict):
        if "median" in value:
            yield name, value
        else:
            for key, part in value.items():
                yield from _figures(part, key)
    elif isinstance(value, list):
        for part in value:
            yield from _figures(part, name)


@pytest.mark.parametrize(
    ("words", "figures"),
    [
        (("sim", "--moves", "200", "--episodes", "1", "--set", SHORT[0]), 4),
        (("art2", "--steps", "5"), 3 * len(ART2_CASES)),
        (("learner", "--steps", "20"), 3),
    ],
)
def test_a_report_is_json_with_machine_and_units(
    words: tuple[str, ...], figures: int, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*words, "--rounds", "2", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["bench"] == words[0]
    assert found["results"]["rounds"] == 2
    assert {"cpu", "cores", "usable_cores", "python", "versions"} <= set(found["machine"])
    assert {"treenail", "eclipse-zenoh", "numpy"} <= set(found["machine"]["versions"])
    measured = [(name, figure) for name, figure in _figures(found["results"]) if "mujoco" not in name]
    assert len(measured) == figures
    for name, value in measured:
        assert name.endswith(UNITS)
        assert 0 < value["min"] <= value["median"] <= value["max"]


def test_all_installed_classifiers_are_measured_on_the_same_vectors(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("classifiers", "--vectors", "60", "--episodes", "1", "--rounds", "2", "--set", SHORT[0], "--json")
    assert main([*words]) == 0
    found = {one["classifier"]: one for one in json.loads(capsys.readouterr().out)["results"]["classifiers"]}
    assert {"art2", "fuzzy-art"} <= set(found)
    for one in found.values():
        assert 0 < one["step_median_us"]["min"] <= one["step_median_us"]["max"]
        assert 1 <= one["classes"]["min"] <= one["classes"]["max"] < 60
        assert 0 < one["purity"]["median"] <= 1
        assert -1 <= one["adjusted_rand_index"]["median"] <= 1
        assert 0 <= one["success_last_quarter"]["median"] <= 1
    assert found["art2"]["classes"] != found["fuzzy-art"]["classes"], "they are not one and the same"


def test_a_report_is_text_too(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["learner", "--steps", "20", "--rounds", "1"]) == 0
    said = capsys.readouterr().out
    assert re.search(r"updates_per_s +\S+  \(\S+ to \S+\)", said)
    assert re.search(r"python +3\.", said)


def test_text_shows_every_kind_of_value() -> None:
    found: dict[str, Value] = {
        "a": {"median": 1.0, "min": 0.5, "max": 2.0},
        "met": True,
        "part": {"n": 3},
        "cases": [{"x": 1}, {"x": 2}],
    }
    text = lines(found)
    assert text[0] == "a      1  (0.5 to 2)"
    assert text[1] == "met    yes"
    assert text[2:4] == ["part", "  n  3"]
    assert text.count("x  1") == text.count("x  2") == 1


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("loop", "--episodes", "1"), "from 2"),
        (("loop", "--rounds", "0"), "from 1"),
        (("sim", "--moves", "x"), "'x'"),
        (("nothing",), "nothing"),
    ],
)
def test_what_cannot_be_measured_is_said_in_one_line(
    words: tuple[str, ...], expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert expected in line


def test_an_unknown_experiment_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["sim", "--experiment", "no-such-thing"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("treenail bench: ")
    assert "no-such-thing" in line


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=50), st.floats(0, 100))
def test_percentiles_are_values_and_grow(values: list[float], percent: float) -> None:
    found = percentile(values, percent)
    assert found in values
    assert min(values) == percentile(values, 0) <= found <= percentile(values, 100) == max(values)
    assert sum(value <= found for value in values) >= percent / 100 * len(values) * (1 - 1e-12)


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=20))
def test_the_spread_holds_the_median(values: list[float]) -> None:
    found = spread(values)
    assert found["min"] <= found["median"] <= found["max"]
    assert sum(value <= found["median"] for value in values) * 2 >= len(values)
