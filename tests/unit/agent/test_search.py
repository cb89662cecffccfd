"""Search over a flat face: where it looks, what it learns, and that what was learnt is kept to the byte."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.evaluate.frozen import FrozenSkill
from experiments.evaluate.trial import trial
from experiments.lab.in_process import InProcessRun
from services.agent.fold import learner_of
from services.agent.search import FlatFace, FlatSearch
from services.rules.skill import file_bytes, parse
from services.rules.skill_memory import check_felt
from services.rules.wrench import Wrench
from services.wire.actions import INSERT, lateral_moves
from services.wire.definition import FeltModel, Moves, NamedMove
from services.wire.definition_file import load
from services.wire.errors import BadPayloadError, DefinitionError

RADIUS = 4
FLAT = Wrench((0.0, 0.0, -2.0), (0.0, 0.0, 0.0))


def walk(search: FlatSearch, count: int) -> list[tuple[int, int]]:
    """Return the places that an episode of so many moves over a flat face comes to."""
    search.begin()
    places = [search.place]
    for _ in range(count):
        search.look()
        search.took(search.next_move())
        places.append(search.place)
    return places


def test_with_nothing_learnt_it_goes_round_the_start_and_looks_nowhere_twice_while_there_is_room() -> None:
    places = walk(FlatSearch(Moves(), RADIUS), 40)
    near = [place for place in places[:25] if max(map(abs, place)) <= 2]
    assert len(near) >= 15
    assert len(set(places[:25])) == 25


def test_where_the_peg_went_in_it_looks_first_in_the_next_episode() -> None:
    search = FlatSearch(Moves(), RADIUS)
    search.begin()
    for action in (0, 0, 0, 3, 3):
        search.look()
        search.took(action)
    search.finish(inserted=True)
    assert walk(search, 5)[-1] == (3, -2)


def test_where_it_looked_in_vain_it_looks_less_in_the_next_episode() -> None:
    search = FlatSearch(Moves(), RADIUS)
    first = set(walk(search, 20))
    search.finish(inserted=False)
    assert len(set(walk(search, 20)) - first) >= 10


def test_a_memory_is_restored_to_the_byte_and_one_that_does_not_fit_is_refused() -> None:
    search = FlatSearch(Moves(), RADIUS)
    walk(search, 9)
    search.finish(inserted=True)
    other = FlatSearch(Moves(), RADIUS)
    other.restore(search.snapshot())
    assert other.snapshot() == search.snapshot()
    assert walk(other, 9) == walk(search, 9)
    wider = FlatSearch(Moves(), RADIUS + 2)
    wider.restore(search.snapshot())
    assert wider.found.sum() == search.found.sum()
    other.restore(wider.snapshot())
    assert other.snapshot() == search.snapshot()
    with pytest.raises(ValueError, match="search_found"):
        other.restore({**search.snapshot(), "search_found": bytes(8 * 16)})
    with pytest.raises(ValueError, match="search_tried"):
        other.restore({**search.snapshot(), "search_tried": b"\xff" * len(search.snapshot()["search_tried"])})


def test_friction_alone_is_searched_a_push_aside_is_not() -> None:
    values = np.zeros(Moves().count)
    face = FlatFace(Moves(), FeltModel(search_moves=RADIUS))
    assert face.decide(5, values, FLAT, 0) in lateral_moves(Moves()).values()
    assert face.decide(5, values, Wrench((1.5, 0.0, -2.0), (0.0, 0.0, 0.0)), 0) == 5


def test_pressed_lightly_it_steps_in_and_a_turn_that_is_worth_it_comes_first() -> None:
    values = np.zeros(Moves().count)
    face = FlatFace(Moves(), FeltModel(search_moves=RADIUS, search_press_n=1.0, search_turn=1.0))
    assert face.decide(0, values, Wrench((0.0, 0.0, -0.6), (0.0, 0.0, 0.0)), 0) == INSERT
    values[6] = 1.5
    assert face.decide(0, values, FLAT, 0) == 6


def test_moves_to_search_with_are_needed() -> None:
    alone = (NamedMove(name="+Z", z_mm=0.2), NamedMove(name="+X", x_mm=0.2))
    assert lateral_moves(Moves(list=alone)) == {(1, 0): 1}
    with pytest.raises(ValueError, match="along"):
        FlatSearch(Moves(list=alone), RADIUS)
    with pytest.raises(DefinitionError, match=r"learner\.search_moves: expected moves along"):
        load("suite-chamferless", ['moves.list=[{name="+Z", z_mm=0.2}, {name="+X", x_mm=0.2}]'])


def test_the_hole_without_chamfer_is_learnt_from_the_thesis_s_start() -> None:
    episodes = list(InProcessRun(load("suite-chamferless-start"), 5006).episodes(30))
    assert all(episode.outcome == "inserted" for episode in episodes[20:])


def test_a_run_that_goes_on_from_a_memory_ends_in_the_same_bytes() -> None:
    definition = load("suite-chamferless")
    whole = InProcessRun(definition, 7)
    list(whole.episodes(6))
    half = InProcessRun(definition, 7)
    list(half.episodes(3))
    rest = InProcessRun(definition, 7)
    rest.agent.restore(half.agent.snapshot())
    rest.classifier.restore(half.classifier.snapshot())
    rest.episodes_done, rest.decisions = half.episodes_done, half.decisions
    list(rest.episodes(3))
    assert rest.agent.learner.digest() == whole.agent.learner.digest()


def test_a_skill_of_one_that_searches_goes_through_a_file_and_is_tried_frozen() -> None:
    definition = load("suite-chamferless-start")
    run = InProcessRun(definition, 5006)
    list(run.episodes(20))
    skill = parse(file_bytes(run.learnt()))
    frozen = FrozenSkill(skill, definition, 1)
    assert all(episode.outcome == "inserted" for episode in trial(definition, frozen, 200, 5).episodes)
    with pytest.raises(BadPayloadError, match="search_tried"):
        check_felt({**skill.skill.agent, "search_tried": b""}, definition.moves)
    with pytest.raises(BadPayloadError, match="search_found"):
        check_felt({**skill.skill.agent, "search_found": bytes(32), "search_tried": bytes(32)}, definition.moves)


def test_one_that_does_not_search_takes_over_what_it_can() -> None:
    definition = load("suite-chamferless-start")
    run = InProcessRun(definition, 5006)
    list(run.episodes(3))
    plain = learner_of(load("suite-chamferless-start", ["learner.search_moves=0"]), 5006)
    plain.restore(run.agent.learner.snapshot())
    assert "search_found" not in plain.snapshot()
    run.agent.learner.restore(plain.snapshot())
