"""What may be swapped, what that keeps, and the words it is asked for in."""

from __future__ import annotations

import pytest
from msgspec.structs import replace

from services.rules.swaps import (
    Wish,
    fresh_after,
    fresh_at,
    in_force,
    known_in,
    planned,
    request_for,
    spec,
    swap_for,
    words,
)
from services.wire.definition import Art2Settings, Definition, Greedy, Plugin, QLearning, Sarsa, Softmax
from services.wire.errors import DefinitionError, SwapError, TreenailError
from services.wire.message_base import MOST_SWAPS
from services.wire.messages import Swap, SwapRequest

BEGUN = Definition(name="test", learner=QLearning(alpha=0.4, gamma=0.9))
FUZZY = Plugin(name="fuzzy-art")


def request(**tables: object) -> SwapRequest:
    return SwapRequest(run="test-s0", request="0f" * 16, **tables)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("change", "fresh"),
    [
        ({"learner": Sarsa()}, ()),
        ({"learner": QLearning(alpha=0.1)}, ()),
        ({"policy": Greedy()}, ()),
        ({"learner": Plugin(name="mine")}, ("agent",)),
        ({"classifier": Art2Settings(rho=0.95)}, ("classifier", "agent")),
        ({"classifier": FUZZY}, ("classifier", "agent")),
    ],
)
def test_what_was_learnt_is_kept_where_it_means_the_same(change: dict[str, object], fresh: tuple[str, ...]) -> None:
    assert fresh_after(BEGUN, replace(BEGUN, **change)) == fresh


def test_a_plugged_in_learner_keeps_its_table_under_another_policy_only() -> None:
    mine = replace(BEGUN, learner=Plugin(name="mine"))
    assert fresh_after(mine, replace(mine, policy=Greedy())) == ()
    assert fresh_after(mine, replace(mine, learner=Plugin(name="mine", settings={"x": 1}))) == ("agent",)
    assert fresh_after(mine, BEGUN) == ("agent",)


def test_swaps_add_up_in_their_order() -> None:
    swaps = planned("r", BEGUN, ["9:agent:policy=greedy", "4:agent:learner=sarsa", "9:classifier:rho=0.5"], 10)
    assert [swap.episode for swap in swaps] == [4, 9, 9]
    assert [known_in(swaps, episode) for episode in (0, 3, 4, 8, 9, 10)] == [0, 0, 1, 1, 3, 3]
    assert in_force(BEGUN, swaps[:1]) == replace(BEGUN, learner=Sarsa(alpha=0.4, gamma=0.9))
    after = in_force(BEGUN, swaps)
    assert (after.policy, after.classifier) == (Greedy(), Art2Settings(rho=0.5))
    assert fresh_at(swaps, 9, "agent") and fresh_at(swaps, 9, "classifier")
    assert not fresh_at(swaps, 4, "agent") and not fresh_at(swaps, 10, "agent")


@pytest.mark.parametrize(
    ("wish", "tables"),
    [
        (Wish("agent", ("learner=sarsa",)), {"learner": Sarsa(alpha=0.4, gamma=0.9)}),
        (Wish("agent", ("alpha=0.05", "learner=sarsa")), {"learner": Sarsa(alpha=0.05, gamma=0.9)}),
        (Wish("agent", ("alpha=0.05",)), {"learner": QLearning(alpha=0.05, gamma=0.9)}),
        (Wish("agent", ("learner=q_learning", "gamma=0.5")), {"learner": QLearning(alpha=0.4, gamma=0.5)}),
        (Wish("agent", ("policy.beta=8", "policy=softmax")), {"policy": Softmax(beta=8.0)}),
        (
            Wish("agent", ("policy=greedy", "learner=sarsa")),
            {"learner": Sarsa(alpha=0.4, gamma=0.9), "policy": Greedy()},
        ),
        (Wish("classifier", ("rho=0.95",)), {"classifier": Art2Settings(rho=0.95)}),
        (
            Wish("classifier", ("classifier=fuzzy_art", "rho=0.8")),
            {"classifier": replace(FUZZY, settings={"rho": 0.8})},
        ),
    ],
    ids=str,
)
def test_a_wish_becomes_the_tables_that_change(wish: Wish, tables: dict[str, object]) -> None:
    found = request_for("r", BEGUN, wish, None, "0f" * 16)
    expected: dict[str, object] = {"classifier": None, "learner": None, "policy": None}
    assert {name: getattr(found, name) for name in expected} == expected | tables
    assert in_force(BEGUN, [swap_for(BEGUN, (), found, 3)]) == replace(BEGUN, **tables)


@pytest.mark.parametrize(
    ("wish", "said"),
    [
        (Wish("agent", ("learner=salsa",)), "learner: expected one of q_learning, sarsa.*got 'salsa'"),
        (
            Wish("classifier", ("classifier=q_learning",)),
            "classifier: expected one of art2, none, art1, art2a, fuzzy-art",
        ),
        (Wish("agent", ("alpah=0.1",)), "did you mean 'alpha'"),
        (Wish("agent", ("alpha=7",)), "alpha"),
        (Wish("agent", ("policy=lazy",)), "expected one of 'greedy'"),
        (Wish("agent", ("alpha=0.4",)), "something that changes"),
        (Wish("agent", ()), "something that changes"),
        (Wish("classifier", ("theta=0.9",)), "classifier.theta: expected less than"),
    ],
    ids=str,
)
def test_a_wish_that_cannot_be_is_an_error_of_one_line(wish: Wish, said: str) -> None:
    with pytest.raises((SwapError, DefinitionError), match=said) as caught:
        request_for("r", BEGUN, wish, None)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text", ["", "5", "5:agent", "5:agent:", "x:agent:alpha=1", "-1:agent:alpha=1", "5:task:a=1", "5:agent:a=1,,b=2"]
)
def test_words_that_say_no_swap_are_refused(text: str) -> None:
    with pytest.raises(SwapError, match="--swap: expected EPISODE:agent:KEY=VALUE"):
        spec(text)


@pytest.mark.parametrize("episode", [0, 10, 11])
def test_a_plan_is_within_the_run(episode: int) -> None:
    with pytest.raises(SwapError, match=f"expected 1 to 9, got {episode}") as caught:
        planned("r", BEGUN, [f"{episode}:agent:alpha=0.1"], 10)
    assert caught.value.reason == "out_of_order"


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        ({}, "something that changes"),
        ({"learner": BEGUN.learner}, "something that changes"),
        ({"learner": Sarsa(), "classifier": FUZZY}, "got both"),
        ({"classifier": Art2Settings(theta=0.9)}, "classifier.theta"),
        ({"learner": Plugin(name="nobody")}, "got 'nobody'"),
        ({"classifier": replace(FUZZY, settings={"rho": "high"})}, "rho"),
    ],
)
def test_a_request_that_cannot_be_is_refused(tables: dict[str, object], said: str) -> None:
    with pytest.raises(TreenailError, match=said):
        swap_for(BEGUN, (), request(**tables), 3)


def test_a_swap_cannot_go_before_another_and_there_is_an_end_to_them() -> None:
    first = Swap(request="ab" * 16, episode=5, policy=Greedy())
    with pytest.raises(SwapError, match="expected episode 5 or later"):
        swap_for(BEGUN, (first,), request(learner=Sarsa()), 4)
    assert swap_for(BEGUN, (first,), request(learner=Sarsa()), 5).episode == 5
    with pytest.raises(SwapError, match=f"at most {MOST_SWAPS}"):
        swap_for(BEGUN, (first,) * MOST_SWAPS, request(learner=Sarsa()), 5)


def test_words_tell_what_is_lost() -> None:
    kept, lost, both = planned(
        "r", BEGUN, ["3:agent:learner=sarsa", "4:classifier:classifier=fuzzy-art", "5:agent:policy=greedy"], 9
    )
    assert words(kept) == "from episode 3: learner sarsa (alpha=0.4, gamma=0.9); keeps all that was learnt"
    assert words(lost).startswith("from episode 4: classifier fuzzy-art; classifier and agent START FRESH")
    assert words(both) == "from episode 5: policy greedy; keeps all that was learnt"
