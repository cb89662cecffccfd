"""No number that the contract lets in can end a process: the ends of every range, to all who read a message."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import cache, partial
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import msgspec
import pytest
from msgspec import Struct

from experiments.fuzz.sound import DEFINITION, RUN, SEED, SmallRun, small_run
from experiments.journal.replay import Replay
from services.agent.fold import AgentFold
from services.bus.fake_bus import FakeQuery
from services.bus.testing import FakeService
from services.classifier.fold import ClassifierFold
from services.rules import skill
from services.rules.guard import Guard
from services.rules.results import RunResult, run_summary
from services.rules.swaps import swap_for
from services.rules.timeline import Timeline
from services.sim.service import work as simulate
from services.store.contents import check
from services.task.insertion import Insertion
from services.viewer.record import Recorder
from services.wire import codec
from services.wire.errors import TreenailError
from services.wire.keys import CONTRACT, EXPERIMENT, HOME, MOVE, name_of
from services.wire.messages import (
    MESSAGES,
    Action,
    Checkpoint,
    EpisodeSummary,
    Experiment,
    FtPacket,
    Home,
    JournalEpisode,
    Message,
    Move,
    Moved,
    Observation,
    QTable,
    Reward,
    RunRecord,
    Skill,
    State,
    SwapRequest,
    Swaps,
    Truth,
)

Path_ = tuple[str | int, ...]


@cache
def run() -> SmallRun:
    return small_run()


def ends(hint: object, path: Path_, value: Any) -> Iterator[tuple[Path_, int]]:
    """Give the place of every integer in a value of a type, with the least and the most that it may be."""
    if get_origin(hint) is Annotated:
        inner, *extras = get_args(hint)
        if inner is int:
            limits = {
                name: getattr(meta, name) for meta in extras for name in ("ge", "le") if getattr(meta, name) is not None
            }
            assert set(limits) == {"ge", "le"}, f"{path}: expected a range with two ends"
            yield path, limits["ge"]
            yield path, limits["le"]
            return
        yield from ends(inner, path, value)
    elif hint is int:
        raise AssertionError(f"{path}: expected an integer with a range")
    elif isinstance(hint, type) and issubclass(hint, Struct):
        for name, inner in get_type_hints(hint, include_extras=True).items():
            if name in hint.__struct_fields__ and not hint.__module__.startswith("services.wire.definition"):
                yield from ends(inner, (*path, name), value.get(name) if isinstance(value, dict) else None)
    elif get_origin(hint) is tuple and value:
        first = get_args(hint)[0]
        yield from ends(first, (*path, 0), value[0])
        yield from ends(first, (*path, len(value) - 1), value[-1])
    elif get_origin(hint) is dict and get_args(hint)[1] is not int:
        for key in list(value or ())[:1]:
            yield from ends(get_args(hint)[1], (*path, key), value[key])
    else:
        for part in get_args(hint):
            if part is not type(None) and get_origin(hint) is not dict and not (isinstance(part, type) and part is int):
                with suppress(TypeError):
                    yield from ends(part, path, value)


def changed(tree: Any, path: Path_, number: int) -> Any:
    if not path:
        return number
    first, *rest = path
    if isinstance(tree, dict):
        return {**tree, first: changed(tree.get(first), tuple(rest), number)}
    return tuple(changed(item, tuple(rest), number) if place == first else item for place, item in enumerate(tree))


def extremes(kind: type[Message]) -> Iterator[Message]:
    """Give messages of a type, each with one integer at an end of its range, and with all of the same name there."""
    for tree in run().trees[kind]:
        everywhere: dict[str, Any] = {}
        for path, number in ends(kind, (), tree):
            if tree is None or not _there(tree, path):
                continue
            one = changed(tree, path, number)
            everywhere = changed(everywhere or tree, path, number)
            for candidate in (one, everywhere):
                with suppress(msgspec.ValidationError):
                    yield codec.decode_payload(kind, msgspec.msgpack.encode(candidate))


def _there(tree: Any, path: Path_) -> bool:
    for part in path[:-1]:
        tree = tree.get(part) if isinstance(tree, dict) else tree[part]
        if tree is None:
            return False
    return True


def test_every_integer_of_every_message_has_two_ends() -> None:
    found = {kind: {path for tree in run().trees[kind] for path, _ in ends(kind, (), tree)} for kind in MESSAGES}
    assert ("step",) in found[Move] and ("steps", 0, "step") in found[JournalEpisode]
    assert len(set().union(*found.values())) > 40


def read(message: Message) -> None:
    """Let everybody who gets such a message have it, as a fresh process does."""
    codec.encode_json(message)
    for pattern, row in CONTRACT.items():
        if type(message) in row.types and row.kind == "put, query":
            parts: dict[str, Any] = {"service": "agent", "sha256": "0f" * 32, "run": getattr(message, "run", RUN)}
            episode = getattr(message, "episode", 0)
            with suppress(TreenailError):
                check(
                    name_of(pattern, **parts, episode=episode), codec.encode(message), codec.encoding_of(type(message))
                )
    for reader in READERS.get(type(message), ()):
        with suppress(TreenailError, ValueError):
            reader(message)


def _agent() -> AgentFold:
    return AgentFold(DEFINITION, RUN, SEED)


def _record(how: Callable[[Recorder, Any], object]) -> Callable[[Any], object]:
    def take(message: Any) -> None:
        recorder = Recorder()
        how(recorder, message)
        recorder.flush(0, 200_000_000)
        recorder.whole_run(200_000_000)

    return take


def _moved(message: Moved) -> None:
    insertion = Insertion(DEFINITION, RUN, SEED)
    insertion.home(0, 0)
    insertion.feel(message, (0.0, 0.0, -1.0), (0.0, 0.0, 0.0))


def _experiment(message: Experiment) -> None:
    AgentFold(message.definition, message.run, message.seed, message.swaps)
    ClassifierFold(message.definition, message.run, message.swaps)
    Timeline(message.definition).learn_of(message.swaps)
    Insertion(message.definition, message.run, message.seed).home(message.episodes_done % 1_000_000, message.decisions)


def _journal(message: JournalEpisode) -> None:
    with suppress(TreenailError):
        _agent().replay(message)
    ClassifierFold(DEFINITION, RUN).replay(message)


def _replay(message: JournalEpisode) -> None:
    record = next(one for one in run().messages if isinstance(one, RunRecord))
    Replay(record, None).fold(message)


def _checkpoint(message: Checkpoint) -> None:
    _agent().restore(message.snapshot)


def _skill(message: Skill) -> None:
    named = skill.named(message)
    skill.decode(codec.encode(message), codec.encoding_of(Skill))
    _agent().begin_with(named.skill)


READERS: dict[type[Message], tuple[Callable[[Any], object], ...]] = {
    FtPacket: (_record(Recorder.ft), lambda packet: Guard(DEFINITION, 1.0).sensing(packet, 0.0)),
    Observation: (lambda message: ClassifierFold(DEFINITION, RUN).observe(message),),
    State: (lambda message: _agent().decide(message), _record(Recorder.state)),
    Action: (_record(Recorder.action),),
    Reward: (lambda message: _agent().reward(message), _record(Recorder.reward)),
    EpisodeSummary: (
        _record(Recorder.episode),
        lambda message: run_summary(RunResult(SEED, (message,), {"q_table": "", "art2": "", "episodes": ""})),
    ),
    Truth: (_record(Recorder.truth),),
    Experiment: (_experiment, _record(Recorder.experiment)),
    QTable: (_record(lambda recorder, table: recorder.table(table, 1)),),
    Moved: (_moved,),
    JournalEpisode: (_journal, _replay),
    Checkpoint: (_checkpoint,),
    Skill: (_skill,),
    Swaps: (lambda message: Timeline(DEFINITION).learn_of(message.swaps),),
    SwapRequest: (lambda message: swap_for(DEFINITION, (), message, message.episode or 1),),
}


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.__name__)
def test_no_end_of_a_range_stops_whoever_reads_it(kind: type[Message]) -> None:
    for message in extremes(kind):
        read(message)


@pytest.mark.parametrize("kind", [Home, Move])
def test_the_simulator_answers_every_motion_with_an_end_of_a_range(kind: type[Message]) -> None:
    experiment = next(one for one in run().messages if isinstance(one, Experiment))
    home = next(one for one in run().messages if isinstance(one, Home))
    service = FakeService("sim")
    service.bus.answers[EXPERIMENT] = experiment
    asked: list[FakeQuery] = []
    motions: list[Message] = [home, *extremes(kind)]
    if kind is Home:  # where an episode of that number really begins
        insertion = Insertion(experiment.definition, experiment.run, experiment.seed)
        motions += [insertion.home(episode, 0) for episode in (0, 999_999)]

    def ask(motion: Message) -> None:
        asked.append(service.ask(HOME if isinstance(motion, Home) else MOVE, motion))

    for number, motion in enumerate(motions):
        service.later(0.1 * (number + 1), partial(ask, motion))
    service.run_for(simulate, 0.1 * (len(motions) + 2))
    assert len(asked) == len(motions)
    assert all(len(query.replies) == 1 for query in asked)
    if kind is Home:
        assert asked[-1].replies[0].ok is not None, "the last episode that there can be is simulated"
