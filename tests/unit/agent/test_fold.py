"""The agent's memory: a function of states and rewards, whoever brings them and how often."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Literal

import numpy as np
import pytest
from msgspec.structs import replace

from services.agent.fold import AgentFold
from services.wire.codec import decode_payload, encode
from services.wire.definition import TD_LEARNERS, Definition, Limits
from services.wire.definition_file import load, shipped
from services.wire.errors import DivergedError, ForeignRunError, GapError, TreenailError
from services.wire.messages import Action, EpisodeSummary, JournalEpisode, JournalStep, Reward, State

RUN = "test-s0"
SEED = 5
EPISODES = (4, 1, 7, 3, 0, 5)
"""Decisions in each episode of the synthetic run."""
Kind = Literal["q_learning", "sarsa"]
KINDS: tuple[Kind, ...] = ("q_learning", "sarsa")
both_kinds = pytest.mark.parametrize("kind", KINDS)


def messages() -> list[tuple[State, Reward]]:
    """Return a run's states with the rewards that follow them, made up."""
    random = np.random.default_rng(7)
    made: list[tuple[State, Reward]] = []
    for episode, count in enumerate(EPISODES):
        for number in range(count):
            place = {"run": RUN, "episode": episode, "step": 2 + 3 * number, "decision": len(made)}
            state = State(**place, state=int(random.integers(4)), states=4, match=0.5)  # type: ignore[arg-type]
            reward = Reward(
                **place,  # type: ignore[arg-type]
                reward=float(random.normal()),
                terminal="inserted" if number == count - 1 else None,
            )
            made.append((state, reward))
    return made


SEEN = messages()


def fresh(kind: Kind) -> AgentFold:
    return AgentFold(Definition(name="test", learner=TD_LEARNERS[kind]()), RUN, SEED)


def run(fold: AgentFold, first: int = 0, last: int = len(SEEN)) -> AgentFold:
    """Fold decisions with their rewards."""
    for state, reward in SEEN[first:last]:
        fold.decide(state)
        fold.reward(reward)
    return fold


def memory(fold: AgentFold) -> tuple[str, int, int, int]:
    return fold.learner.digest(), fold.decisions, fold.rewards, fold.episode


def journal(kind: Kind) -> Iterator[JournalEpisode]:
    """Make the journal that the task would keep of the whole run."""
    actions = list(acted(kind))
    for episode, count in enumerate(EPISODES):
        first = sum(EPISODES[:episode])
        steps = tuple(
            JournalStep(
                step=state.step,
                force_n=(0.0, 0.0, -1.0),
                torque_nm=(0.0, 0.0, 0.0),
                state=state.state,
                action=actions[state.decision].action,
                policy_version=actions[state.decision].policy_version,
                reward=reward.reward,
            )
            for state, reward in SEEN[first : first + count]
        )
        yield JournalEpisode(
            run=RUN, episode=episode, first_decision=first, steps=steps, summary=summary(episode, count)
        )


def acted(kind: Kind) -> Iterator[Action]:
    fold = fresh(kind)
    for state, reward in SEEN:
        yield fold.decide(state)
        fold.reward(reward)


def summary(episode: int, decisions: int) -> EpisodeSummary:
    return EpisodeSummary(
        run=RUN,
        episode=episode,
        episode_return=0.0,
        moves=20,
        decisions=decisions,
        mean_force_n=1.0,
        peak_force_n=2.0,
        mean_torque_nm=0.0,
        peak_torque_nm=0.0,
        states=4,
        outcome="inserted",
    )


def refused(fold: AgentFold, act: Callable[[], object], error: type[Exception]) -> None:
    """Check that something is refused, changes nothing, and leaves the rest of the run what it was."""
    before = memory(fold)
    with pytest.raises(error):
        act()
    assert memory(fold) == before
    kind: Kind = "q_learning"
    if fold.rewards < fold.decisions:
        fold.reward(SEEN[fold.rewards][1])
    run(fold, fold.decisions)
    assert memory(fold) == memory(run(fresh(kind)))


# -- deciding ------------------------------------------------------------------------------------------------------


@both_kinds
def test_the_answer_names_its_state(kind: Kind) -> None:
    for (state, _), action in zip(SEEN, acted(kind), strict=True):
        assert (action.run, action.episode, action.step, action.decision, action.state) == (
            RUN,
            state.episode,
            state.step,
            state.decision,
            state.state,
        )
        assert 0 <= action.action < 9


@both_kinds
def test_every_reward_is_learnt_once(kind: Kind) -> None:
    fold = run(fresh(kind))
    assert fold.learner.version == len(SEEN) == fold.table.visits.sum()
    assert fold.between_episodes
    versions = [action.policy_version for action in acted(kind)]
    assert versions == list(range(len(SEEN)))


@both_kinds
def test_the_same_state_again_gets_the_same_answer_and_nothing_is_learnt(kind: Kind) -> None:
    fold = fresh(kind)
    for state, reward in SEEN:
        action = fold.decide(state)
        before = memory(fold)
        assert fold.decide(state) == action
        assert fold.decide(replace(state, match=0.25, states=40)) == action
        assert memory(fold) == before
        fold.reward(reward)
        before = memory(fold)
        assert fold.decide(state) == action
        assert memory(fold) == before
    assert memory(fold) == memory(run(fresh(kind)))


@both_kinds
def test_the_same_reward_again_is_ignored(kind: Kind) -> None:
    fold = fresh(kind)
    for state, reward in SEEN:
        fold.decide(state)
        assert fold.reward(reward)
        before = memory(fold)
        for _, earlier in SEEN[: reward.decision + 1]:
            assert not fold.reward(earlier)
        assert memory(fold) == before
    assert memory(fold) == memory(run(fresh(kind)))


def test_a_reward_with_other_content_is_refused() -> None:
    for change in ({"reward": 99.0}, {"terminal": "collision"}):
        fold = run(fresh("q_learning"), last=3)
        wrong = replace(SEEN[2][1], **change)
        refused(fold, partial(fold.reward, wrong), DivergedError)


def test_a_state_with_other_content_is_refused() -> None:
    fold = run(fresh("q_learning"), last=3)
    refused(fold, lambda: fold.decide(replace(SEEN[2][0], state=3 - SEEN[2][0].state)), DivergedError)


def test_a_gap_between_states_is_refused() -> None:
    for count in range(len(SEEN) - 1):
        fold = run(fresh("q_learning"), last=count)
        refused(fold, partial(fold.decide, SEEN[count + 1][0]), GapError)


def test_a_state_before_the_reward_of_the_last_is_refused() -> None:
    for count in range(len(SEEN) - 1):
        fold = run(fresh("q_learning"), last=count)
        fold.decide(SEEN[count][0])
        refused(fold, partial(fold.decide, SEEN[count + 1][0]), GapError)


def test_a_reward_before_its_decision_is_refused() -> None:
    for count in range(len(SEEN)):
        fold = run(fresh("q_learning"), last=count)
        refused(fold, partial(fold.reward, SEEN[count][1]), GapError)


def test_another_run_is_refused() -> None:
    acts: tuple[Callable[[AgentFold], object], ...] = (
        lambda fold: fold.decide(replace(SEEN[3][0], run="other-s0")),
        lambda fold: fold.reward(replace(SEEN[2][1], run="other-s0")),
        lambda fold: fold.replay(replace(next(journal("q_learning")), run="other-s0")),
    )
    for act in acts:
        fold = run(fresh("q_learning"), last=3)
        refused(fold, partial(act, fold), ForeignRunError)


def test_an_earlier_episode_is_refused() -> None:
    fold = run(fresh("q_learning"), last=EPISODES[0] + EPISODES[1])
    refused(fold, lambda: fold.decide(SEEN[0][0]), DivergedError)
    fold = run(fresh("q_learning"), last=7)
    refused(fold, lambda: fold.decide(replace(SEEN[7][0], episode=1)), DivergedError)


def test_a_state_that_no_table_can_hold_is_refused_like_anything_else() -> None:
    """A stray publisher may send it: it must neither end the agent nor make it forget its answers."""
    fold = run(fresh("q_learning"), last=EPISODES[0])
    beyond = encode(replace(SEEN[EPISODES[0]][0], state=2**40, states=2**40 + 1))
    refused(fold, lambda: fold.decide(decode_payload(State, beyond)), TreenailError)


def test_seeds_make_different_agents() -> None:
    definition = Definition(name="test")
    one, other = AgentFold(definition, RUN, 1), AgentFold(definition, RUN, 2)
    run(one)
    run(other)
    assert one.learner.digest() != other.learner.digest()


# -- journal and checkpoints ---------------------------------------------------------------------------------------


@both_kinds
def test_replay_of_a_journal_is_the_run(kind: Kind) -> None:
    fold = fresh(kind)
    for entry in journal(kind):
        fold.replay(entry)
    assert memory(fold) == memory(run(fresh(kind)))
    assert fold.snapshot() == run(fresh(kind)).snapshot()


@both_kinds
@pytest.mark.parametrize("waiting", [False, True])
def test_replay_takes_only_what_is_new(kind: Kind, waiting: bool) -> None:
    entries = list(journal(kind))
    for count in range(len(SEEN)):
        fold = run(fresh(kind), last=count)
        if waiting:
            fold.decide(SEEN[count][0])
        for entry in entries:
            fold.replay(entry)
            fold.replay(entry)
        assert memory(fold) == memory(run(fresh(kind)))


def test_replay_of_a_later_entry_is_a_gap() -> None:
    fold = run(fresh("q_learning"), last=2)
    refused(fold, lambda: fold.replay(list(journal("q_learning"))[2]), GapError)


def test_replay_with_another_action_is_refused() -> None:
    entry = next(journal("q_learning"))
    wrong = replace(entry.steps[0], action=(entry.steps[0].action or 0) + 1)
    with pytest.raises(DivergedError, match="replay: decision 0: journal has action"):
        fresh("q_learning").replay(replace(entry, steps=(wrong, *entry.steps[1:])))


def test_replay_with_another_reward_is_refused() -> None:
    entry = next(journal("q_learning"))
    wrong = replace(entry.steps[2], reward=99.0)
    fold = run(fresh("q_learning"), last=2)
    fold.decide(SEEN[2][0])
    fold.reward(SEEN[2][1])
    fold.replay(replace(entry, steps=(*entry.steps[:2], wrong)))  # known already: the journal is not asked
    with pytest.raises(DivergedError):
        fold.reward(replace(SEEN[2][1], reward=99.0))


@both_kinds
@pytest.mark.parametrize("episode", range(len(EPISODES) + 1))
def test_a_checkpoint_and_the_rest_is_the_whole_run(kind: Kind, episode: int) -> None:
    count = sum(EPISODES[:episode])
    snapshot = run(fresh(kind), last=count).snapshot()
    live, by_journal = fresh(kind), fresh(kind)
    for fold in (live, by_journal):
        fold.restore(snapshot)
        assert memory(fold) == memory(run(fresh(kind), last=count))
        assert fold.between_episodes
    run(live, count)
    for entry in list(journal(kind))[episode // 2 :]:
        by_journal.replay(entry)
    assert live.snapshot() == by_journal.snapshot() == run(fresh(kind)).snapshot()


RESTARTS = [
    (count, known)
    for count in range(1, len(SEEN))
    for known in ("observation", "action", "reward")
    if known != "reward" or SEEN[count - 1][1].terminal is None  # with its last reward an episode is over
]


@both_kinds
def test_a_restart_in_mid_episode_goes_on_by_the_partial_record(kind: Kind) -> None:
    """The last step of the partial record waits for an action, for its reward, or for the next observation."""
    for count, known in RESTARTS:
        state, reward = SEEN[count - 1]
        boundary = sum(EPISODES[: state.episode])
        fold = fresh(kind)
        fold.restore(run(fresh(kind), last=boundary).snapshot())
        entry = list(journal(kind))[state.episode]
        steps = list(entry.steps[: count - boundary])
        if known != "reward":
            steps[-1] = replace(steps[-1], reward=None)
        if known == "observation":
            steps[-1] = replace(steps[-1], state=None, action=None, policy_version=None)
        fold.replay(replace(entry, steps=tuple(steps), summary=None))
        assert fold.decisions == (count - 1 if known == "observation" else count)
        assert fold.rewards == (count if known == "reward" else count - 1)
        assert fold.decide(state) == list(acted(kind))[count - 1]
        fold.reward(reward)
        run(fold, count)
        assert memory(fold) == memory(run(fresh(kind)))


def test_there_is_no_checkpoint_in_mid_episode() -> None:
    fold = run(fresh("q_learning"), last=EPISODES[0])
    assert fold.between_episodes
    for state, reward in SEEN[EPISODES[0] + EPISODES[1] :][:6]:
        fold = run(fresh("q_learning"), last=state.decision)
        fold.decide(state)
        assert not fold.between_episodes
        with pytest.raises(ValueError, match="between episodes"):
            fold.snapshot()
        fold.reward(reward)
        assert fold.between_episodes == (reward.terminal is not None)


@pytest.mark.parametrize(
    "change",
    [
        {"fold_decisions": b"1"},
        {"fold_episode": None},
        {"fold_decisions": -1},
        {"fold_swaps": 1},
        {"fold_forgotten": -1},
        {"q": b""},
        {"states": 10**9},
        {"unknown": 1},
    ],
)
def test_a_checkpoint_that_does_not_fit_is_refused(change: dict[str, bytes | int | None]) -> None:
    snapshot = run(fresh("q_learning"), last=5).snapshot()
    for name, value in change.items():
        if value is None:
            del snapshot[name]
        else:
            snapshot[name] = value
    fold = run(fresh("q_learning"), last=3)
    refused(fold, lambda: fold.restore(snapshot), ValueError)


def test_a_checkpoint_of_other_actions_is_refused() -> None:
    snapshot = run(fresh("q_learning"), last=5).snapshot()
    assert snapshot["actions"] == 9
    fold = run(fresh("q_learning"), last=3)
    refused(fold, lambda: fold.restore(snapshot | {"actions": 5}), ValueError)


def test_a_checkpoint_replaces_all_that_was_answered_before() -> None:
    fold = run(fresh("q_learning"), last=EPISODES[0] + EPISODES[1] + 2)
    fold.restore(run(fresh("q_learning"), last=EPISODES[0] + EPISODES[1] + EPISODES[2]).snapshot())
    with pytest.raises(DivergedError):
        fold.decide(SEEN[EPISODES[0] + EPISODES[1]][0])
    run(fold, fold.decisions)
    assert memory(fold) == memory(run(fresh("q_learning")))


# -- an episode that is cut by the move limit ---------------------------------------------------------------------


def cut_run(kind: Kind, truncation: Literal["untaught", "terminal"]) -> AgentFold:
    """Fold episodes that wander in one state, each cut by the move limit after five decisions."""
    limits = Limits(truncation=truncation)
    fold = AgentFold(Definition(name="test", learner=TD_LEARNERS[kind](), limits=limits), RUN, SEED)
    for decision in range(1000):
        place = {"run": RUN, "episode": decision // 5, "step": decision % 5, "decision": decision}
        fold.decide(State(**place, state=0, states=1, match=0.5))  # type: ignore[arg-type]
        terminal = "move_limit" if decision % 5 == 4 else None
        fold.reward(Reward(**place, reward=-1.0, terminal=terminal))  # type: ignore[arg-type]
    return fold


@both_kinds
def test_a_limit_of_time_does_not_make_wandering_look_cheap(kind: Kind) -> None:
    """What wandering costs for ever is 1 / (1 - gamma) = 20; taught as an end it seems much less."""
    values = {how: cut_run(kind, how).table.values(0).max() for how in ("untaught", "terminal")}
    assert values["terminal"] > -9.0
    assert values["untaught"] < -13.0


@both_kinds
def test_what_was_cut_counts_in_the_version_and_is_kept(kind: Kind) -> None:
    fold = cut_run(kind, "untaught")
    assert fold.version == fold.decisions == 1000
    assert fold.learner.version == 800
    assert fold.between_episodes
    again = AgentFold(Definition(name="test", learner=TD_LEARNERS[kind]()), RUN, SEED)
    again.restore(fold.snapshot())
    assert (memory(again), again.version) == (memory(fold), fold.version)


@both_kinds
@pytest.mark.parametrize("outcome", ["inserted", "collision", "no_progress"])
def test_true_ends_are_taught(kind: Kind, outcome: Literal["inserted", "collision", "no_progress"]) -> None:
    fold = fresh(kind)
    state, reward = SEEN[0]
    fold.decide(state)
    fold.reward(replace(reward, terminal=outcome))
    assert fold.learner.version == 1


@pytest.mark.parametrize("name", [name for name in shipped() if not name.startswith("suite-")])
def test_the_experiments_of_the_thesis_say_that_all_ends_there(name: str) -> None:
    assert load(name).limits.truncation == "terminal"
