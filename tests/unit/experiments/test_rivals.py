"""The earlier controllers, by hand: what each does with simple inputs, and that each is what its seed makes it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import pairwise

import numpy as np
import pytest

from experiments.evaluate.controllers import ACTION, Choice, TipRule
from experiments.evaluate.trial import trial
from experiments.lab.in_process import InProcessRun
from experiments.leaderboard.methods import RIVALS, changed, task_alone
from experiments.oracle.search import Explorer
from experiments.rivals import art1, art_r, artmap, knowledge_base, networks, normals, som, teachers
from experiments.rivals.networks import NetworkController
from experiments.rivals.taught import TAUGHT
from services.agent.policies import probabilities
from services.rules.plugins import Classifier, hears
from services.sim.pose import Pose
from services.wire.actions import INSERT
from services.wire.definition import Definition, Greedy, Parts, Softmax
from services.wire.definition_file import load
from services.wire.errors import TreenailError
from services.wire.messages import Force, Observation, Torque

ROUND, SQUARE = task_alone(load("suite-round")), task_alone(load("suite-square"))
LEVER_M = ROUND.wrist.sensor_height_mm * 1e-3
NO_TORQUE = (0.0, 0.0, 0.0)
SWITCH = Softmax(beta=1.0, beta_per_episode=0.0)
pytest.importorskip("sklearn", reason="scikit-learn, of the extra rivals, is not installed")


def felt(force_n: Force, torque_nm: Torque = NO_TORQUE, step: int = 1) -> Observation:
    return Observation(run="r", episode=0, step=step, decision=step, force_n=force_n, torque_nm=torque_nm)


def pushed(force_n: Force) -> Observation:
    """A load at the tip, as the sensor behind it reads it."""
    fx, fy, _ = force_n
    return felt(force_n, (-LEVER_M * fy, LEVER_M * fx, 0.0))


def row(*values: float) -> artmap.Row:
    return np.array(values)


# Fuzzy ARTMAP


def test_complement_coding_keeps_the_sum_and_refuses_what_is_no_part() -> None:
    assert artmap.complement_coded(row(0.2, 1.0)).tolist() == pytest.approx([0.2, 1.0, 0.8, 0.0])
    assert artmap.complement_coded(row(0.3, 0.7)).sum() == pytest.approx(2.0)
    with pytest.raises(ValueError, match="from 0 to 1"):
        artmap.complement_coded(row(0.2, 1.1))


def test_match_tracking_gives_an_exception_a_box_of_its_own() -> None:
    network = artmap.FuzzyArtmap(1, artmap.Rates())
    assert network.teach(row(0.2), 7) == 0
    assert network.teach(row(0.8), 7) == 0, "vigilance 0: one box holds all of an answer"
    assert network.teach(row(0.5), 9) == 1, "inside the box, with another answer"
    assert network.answers == [7, 9]
    assert network.answer(row(0.5)) == 9, "the smaller box is chosen"
    assert network.answer(row(0.21)) == 7
    assert network.teach(row(0.5), 9) == 1, "and found again, however well the other fits"


def test_match_tracking_goes_past_boxes_that_fit_no_better_than_the_wrong_one() -> None:
    network = artmap.FuzzyArtmap(1, artmap.Rates())
    network.teach(row(0.5), 1)
    network.teach(row(0.9), 2)
    # 0.55 is nearest to the first box, whose match is 0.95; the second, whose match is 0.65, has the answer but must
    # not grow to hold it: vigilance is above 0.95 by then.
    assert network.teach(row(0.55), 2) == 2
    assert network.answer(row(0.9)) == 2


def test_an_ordered_list_is_learnt_until_all_is_right() -> None:
    draws = np.random.Generator(np.random.Philox(key=3)).uniform(size=(40, 3))
    lessons = [(pattern, int(pattern.sum() > 1.5)) for pattern in draws]
    network = artmap.FuzzyArtmap(3, artmap.Rates())
    assert network.learn(lessons, 20) < 20
    assert [network.answer(pattern) for pattern, _ in lessons] == [answer for _, answer in lessons]
    again = artmap.FuzzyArtmap(3, artmap.Rates())
    again.learn(lessons, 20)
    assert again.digest() == network.digest()
    with pytest.raises(ValueError, match="taught something"):
        artmap.FuzzyArtmap(3, artmap.Rates()).answer(draws[0])


def test_boxes_are_those_of_a_library() -> None:
    artlib = pytest.importorskip("artlib")
    draws = np.random.Generator(np.random.Philox(key=5)).uniform(size=(60, 4))
    answers = [int(pattern[0] + pattern[3] > 1.0) for pattern in draws]
    ours = artmap.FuzzyArtmap(4, artmap.Rates(epsilon=1e-7))
    for pattern, answer in zip(draws, answers, strict=True):
        ours.teach(pattern, answer)
    theirs = artlib.SimpleARTMAP(artlib.FuzzyART(rho=0.0, alpha=0.001, beta=1.0))
    theirs.fit(np.hstack([draws, 1.0 - draws]), np.array(answers), match_tracking="MT+", epsilon=1e-7)
    assert [theirs.map[number] for number in range(len(ours.answers))] == ours.answers
    assert np.allclose(np.array(theirs.module_a.W), ours._weights)


def test_knowledge_base_answers_each_load_along_an_axis() -> None:
    controller = knowledge_base.ArtmapController(SQUARE)
    assert controller.decide(felt((0.0, 0.0, -2.0))).action == INSERT
    assert controller.decide(pushed((1.0, 0.0, -1.5))).action == ACTION["+X"]
    assert controller.decide(pushed((0.0, -1.0, -1.5))).action == ACTION["-Y"]
    assert controller.decide(felt((0.0, 0.0, -1.0), (0.05, 0.0, 0.0))).action == ACTION["+RX"]
    assert controller.decide(felt((0.0, 0.0, -1.0), (0.0, 0.0, -0.05))).action == ACTION["-RZ"]
    nine = knowledge_base.ArtmapController(ROUND)
    assert ACTION["+RZ"] not in nine.network.answers and set(nine.network.answers) == set(range(9))


# Fuzzy ART over surface normals


def test_normals_of_a_shape_point_into_the_hole() -> None:
    inwards = {
        (round(surface.normal[0], 3), round(surface.normal[1], 3))
        for surface in normals.surfaces(Parts(shape="square", chamfer_mm=0.0))
        if surface.normal[2] == 0.0
    }
    assert inwards == {(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)}
    triangle = normals.surfaces(Parts(shape="triangle", chamfer_mm=1.0))
    assert len(triangle) == 1 + 2 * 3
    walls = sorted(surface.normal for surface in triangle if surface.normal[2] == 0.0)
    assert walls[0] == pytest.approx((-1.0, 0.0, 0.0)), "one side faces +X, and pushes towards -X"
    assert [normal[0] for normal in walls[1:]] == pytest.approx([0.5, 0.5])
    for surface in triangle:
        assert np.linalg.norm(surface.normal) == pytest.approx(1.0)
        assert surface.normal[2] <= 0.0


def test_peg_moves_away_from_the_surface_that_pushes() -> None:
    controller = normals.NormalsController(SQUARE)
    assert controller.decide(felt((-1.0, 0.1, -1.2))).action == ACTION["-X"], "a chamfer, with some friction"
    assert controller.decide(felt((0.05, 2.0, -0.2))).action == ACTION["+Y"], "a wall"
    assert controller.decide(felt((0.1, 0.0, -2.0))).action == INSERT, "the flat face"
    diagonal = normals.NormalsController(ROUND)
    both = {diagonal.decide(felt((0.7, 0.7, -1.0))).action for _ in range(2)}
    assert both == {ACTION["+X"], ACTION["+Y"]}, "between two axes both, in turn"


# ART1


def test_coarse_inputs_are_bits_above_and_not_above_each_threshold() -> None:
    network = art1.Art1({"levels": 1, "torque_gain_per_m": 0.0})
    bits = network.coarse((3.0, 0.0, -4.0), NO_TORQUE)
    # Thresholds -0.5 and 0.5 on 0.6, 0, -0.8, 0, 0, 0.
    above = [1, 1, 1, 0, 0, 0] + [1, 0] * 3
    assert bits.tolist() == above + [1 - bit for bit in above]


def test_a_class_keeps_the_bits_that_all_its_members_share() -> None:
    network = art1.Art1({"rho": 0.8, "levels": 1, "torque_gain_per_m": 0.0})
    first, second = (1.0, 0.0, -1.0), (0.2, 0.0, -1.0)
    a, b = (network.coarse(vector, NO_TORQUE) for vector in (first, second))
    assert network.learn(first, NO_TORQUE).new
    told = network.learn(second, NO_TORQUE)
    assert (told.state, told.new) == (0, False)
    assert network.prototypes[0].tolist() == np.logical_and(a, b).astype(float).tolist()
    assert a.sum() - network.prototypes[0].sum() == 1.0, "one threshold lies between them"


def test_vigilance_of_art1_is_the_part_of_the_bits_that_are_shared() -> None:
    def classes(rho: float) -> int:
        network = art1.Art1({"rho": rho, "levels": 1, "torque_gain_per_m": 0.0})
        for vector in ((1.0, 0.0, -1.0), (0.2, 0.0, -1.0)):
            network.learn(vector, NO_TORQUE)
        return network.states

    assert classes(11.0 / 12.0) == 1, "11 of 12 bits"
    assert classes(0.93) == 2


# The map


def test_neighbours_are_within_a_radius_on_the_grid() -> None:
    grid = som.Map(som.Settings(rows=3, columns=4))
    assert np.flatnonzero(grid.neighbours(5, 0)).tolist() == [5]
    assert np.flatnonzero(grid.neighbours(0, 1)).tolist() == [0, 1, 4, 5]
    assert np.flatnonzero(grid.neighbours(5, 1)).tolist() == [0, 1, 2, 4, 5, 6, 8, 9, 10]


def test_winner_and_neighbours_go_part_of_the_way_less_and_fewer_as_time_goes_by() -> None:
    settings = som.Settings(rows=1, columns=5, rate=0.5, least_rate=0.1, ordering=100)
    grid, vector = som.Map(settings), row(0.0, 0.7, 0.0)
    assert grid.weights[:, 1].tolist() == pytest.approx([-0.8, -0.4, 0.0, 0.4, 0.8])
    unit, match = grid.winner(vector)
    assert unit == 4 and 0.9 < match < 1.0
    grid.order(unit, vector, 0)
    assert grid.weights[:, 1].tolist() == pytest.approx([-0.8, -0.4, 0.35, 0.55, 0.75]), "radius 2, half of the way"
    grid.order(unit, vector, 1000)
    assert grid.weights[:, 1].tolist() == pytest.approx([-0.8, -0.4, 0.35, 0.55, 0.745]), "itself alone, a tenth"


def test_a_map_comes_into_order() -> None:
    network = som.Som({"rows": 1, "columns": 8, "torque_gain_per_m": 10.0, "ordering": 400})
    draws = np.random.Generator(np.random.Philox(key=2)).uniform(0.02, 0.5, size=1500)
    for torque in draws.tolist():
        network.learn((0.0, 0.0, -1.0), (torque, torque, 0.0))
    line = network._map.weights[:, 1]
    assert all(a < b for a, b in pairwise(line.tolist())), (
        "neighbours on the grid are neighbours in what they stand for"
    )
    assert line.min() > 0.0, "all units are where the vectors are"


def test_position_is_what_was_commanded_and_only_across_and_about_the_axis() -> None:
    network = som.SomWithPosition({"cell_steps": 1})
    assert hears(network) and not hears(som.Som({}))

    def state() -> int:
        return network.learn((0.0, 0.0, -1.0), (0.1, 0.0, 0.0)).state

    network.begin()
    first = state()
    network.took(ACTION["+X"])
    assert state() == first, "one step is still the middle"
    network.took(ACTION["+X"])
    aside = state()
    assert aside != first
    for name in ("+Z", "+RX", "-RY"):
        network.took(ACTION[name])
    assert state() == aside, "neither depth nor tilt counts"
    network.took(ACTION["-X"])
    assert state() == first
    for _ in range(2):
        network.took(ACTION["-RZ"])
    assert state() not in (first, aside)
    network.begin()
    assert state() == first, "an episode begins in the middle"


# ART-R


def test_a_better_reward_than_usual_shifts_the_weights_along_the_gradient() -> None:
    learner = art_r.ArtR(2, {"alpha": 0.5, "beta": 0.25, "reward_limit": 10.0}, SWITCH, 3)
    learner.finish((0, 0, 4.0))
    assert learner.q[0].tolist() == pytest.approx([0.5 * 4.0 * 0.5, -0.5 * 4.0 * 0.5])
    learner.finish((0, 1, 1.0))  # usual is 1.0 by now: nothing to learn
    assert learner.q[0].tolist() == pytest.approx([1.0, -1.0])
    chance = 1.0 / (1.0 + np.exp(-2.0))
    learner.finish((0, 0, -1000.0))  # counts as -10, 11 below what is usual
    assert learner.q[0].tolist() == pytest.approx([1.0 - 5.5 * (1.0 - chance), -1.0 + 5.5 * (1.0 - chance)])
    assert learner.version == 3 and learner.visits.tolist() == [[2, 1]]


def test_it_learns_which_move_pays_at_once() -> None:
    learner = art_r.ArtR(4, {}, SWITCH, 3)
    previous = None
    for step in range(400):
        action = learner.decide(previous, 2, 0, step)
        previous = (2, action, 1.0 if action == 3 else -1.0)
    assert learner.chances(2, 0)[3] > 0.8
    assert learner.chances(2, 0) == pytest.approx(probabilities(learner.values(2), SWITCH, 0))
    greedy = art_r.ArtR(4, {}, Greedy(), 3)
    greedy.restore(learner.snapshot())
    assert greedy.act(2, 0, 0) == 3 and greedy.digest() == learner.digest()


@pytest.mark.parametrize("damage", [{"usual": b""}, {"usual": np.full(3, np.nan).tobytes()}, {"states": 2}, {"x": 1}])
def test_a_wrong_memory_of_art_r_is_refused(damage: Mapping[str, bytes | int]) -> None:
    learner = art_r.ArtR(4, {}, SWITCH, 3)
    learner.finish((2, 1, 1.0))
    before = learner.digest()
    with pytest.raises(ValueError, match="snapshot"):
        learner.restore({**learner.snapshot(), **damage})
    assert learner.digest() == before


# All classifiers


@pytest.mark.parametrize("kind", [art1.Art1, som.Som, som.SomWithPosition])
def test_a_restored_memory_goes_on_bit_for_bit(kind: type[art1.Art1 | som.Som]) -> None:
    draws = np.random.Generator(np.random.Philox(key=4)).standard_normal((200, 6))

    def learn(network: Classifier, rows: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> list[int]:
        return [network.learn(each[:3].tolist(), (each[3:] / 10.0).tolist()).state for each in rows]

    network, copy = kind({}), kind({})
    assert network.prototypes.shape[0] == 0 == network.states
    learn(network, draws[:100])
    copy.restore(network.snapshot())
    assert copy.digest() == network.digest() != kind({}).digest()
    assert learn(copy, draws[100:]) == learn(network, draws[100:])
    assert copy.digest() == network.digest()
    assert network.prototypes.shape[0] == network.states == len(network.counts)
    assert network.counts.sum() == 200
    before = network.digest()
    asked = network.classify(draws[0, :3].tolist(), draws[0, 3:].tolist())
    assert asked.states == network.states and network.digest() == before


@pytest.mark.parametrize(
    "damage",
    [{"states": 3}, {"states": -1}, {"weights": b""}, {"keys": np.array([0, 0]).tobytes()}, {"more": 1}]
    + [{"weights": np.full(72, value).tobytes()} for value in (np.nan, 2.0)]
    + [{"keys": np.array([0, 24]).tobytes()}, {"counts": np.array([1, 0]).tobytes()}],
)
def test_a_map_that_cannot_be_is_refused_and_nothing_changes(damage: Mapping[str, bytes | int]) -> None:
    network = som.Som({})
    for torque in (0.2, -0.2):
        network.learn((0.0, 0.0, -1.0), (torque, 0.0, 0.0))
    before = network.digest()
    assert network.states == 2
    with pytest.raises(ValueError, match="SOM snapshot"):
        network.restore({**network.snapshot(), **damage})
    assert network.digest() == before


# Teachers and their pupils


def test_operator_sees_which_way_the_hole_is() -> None:
    operator, world = teachers.Operator(ROUND), Explorer(ROUND)
    for x_mm, y_mm, move in ((1.5, 0.0, "-X"), (0.0, -1.5, "+Y")):
        world.home(Pose.from_tilt(x_mm, y_mm, 2.1, 0.0, 0.0, 0.0))  # 0.1 mm into the chamfer
        assert operator(felt((0.0, 0.0, -1.0)), world) == ACTION[move]
    world.home(Pose.from_tilt(0.0, 0.0, -0.2, 0.0, 0.0, 0.0))
    assert operator(felt((0.0, 0.0, -1.0)), world) == INSERT


def test_lessons_are_those_of_the_seed_and_of_no_run_that_is_tried() -> None:
    rule = TipRule(ROUND)
    first, again, other = (
        teachers.show(ROUND, teachers.by_rule(rule), seed, 2, rule.begin) for seed in (100, 100, 101)
    )
    assert first == again != other
    met: list[Observation] = []

    class Noting(TipRule):
        def decide(self, felt: Observation) -> Choice:
            met.append(felt)
            return super().decide(felt)

    trial(ROUND, Noting(ROUND), 100, 2)
    assert not {lesson.felt.force_n for lesson in first} & {observation.force_n for observation in met}


@pytest.mark.parametrize("taught", [networks.asada, networks.howarth])
def test_a_network_is_what_its_seed_makes_it(
    taught: Callable[[Definition, int, networks.Lessons], NetworkController],
) -> None:
    how = networks.Lessons(insertions=3, hidden=(12,), rounds=30)
    network, again, other = (taught(ROUND, seed, how) for seed in (7, 7, 8))
    assert network.digest() == again.digest() != other.digest()


@pytest.mark.parametrize("taught", [networks.asada, networks.howarth])
def test_a_network_that_was_shown_enough_inserts(
    taught: Callable[[Definition, int, networks.Lessons], NetworkController],
) -> None:
    network = taught(ROUND, 7, networks.Lessons(insertions=30))
    assert [summary.outcome for summary in trial(ROUND, network, 3, 3).episodes] == ["inserted"] * 3


def test_howarths_network_never_tilts() -> None:
    network = networks.howarth(SQUARE, 7, networks.Lessons(insertions=6, hidden=(12,), rounds=50))
    tilting = {ACTION[name] for name in ("+RX", "-RX", "+RY", "-RY")}
    assert not tilting & set(network._moves)


def test_a_network_needs_more_than_one_move_to_learn() -> None:
    lessons = [teachers.Shown(felt((1.0, 0.0, -1.0)), INSERT)] * 5
    with pytest.raises(TreenailError, match="expected several moves"):
        NetworkController(ROUND, range(6), lessons, networks.USUAL, 1)


# All of them, in the task


@pytest.mark.parametrize("name", ["artmap", "art-normals"])
def test_who_is_taught_by_hand_inserts(name: str) -> None:
    done = trial(ROUND, TAUGHT[name](ROUND, 3), 3, 3)
    assert [summary.outcome for summary in done.episodes] == ["inserted"] * 3


@pytest.mark.parametrize(
    "method", [method for method in RIVALS if method.kind == "learn"], ids=lambda method: method.name
)
def test_who_learns_is_a_fold_of_its_seed(method: object) -> None:
    (rival,) = (each for each in RIVALS if each is method)
    definition = changed(load("suite-square"), rival)

    def learnt(seed: int) -> tuple[str, str]:
        run = InProcessRun(definition, seed)
        list(run.episodes(3))
        return run.agent.learner.digest(), run.classifier.network.digest()

    assert learnt(3) == learnt(3) != learnt(4)
