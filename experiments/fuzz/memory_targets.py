"""Readers of memories and definitions, and the folds: what workers load, and what the loop tells them."""

from __future__ import annotations

import json
from collections.abc import Callable
from random import Random

import msgspec

from experiments.fuzz.mutate import Snapshot, hostile_memory, mutate_bytes, mutate_text, mutate_tree
from experiments.fuzz.sound import DEFINITION, DIRECTIONS, RUN, SEED, TORQUE, SmallRun, definitions
from experiments.fuzz.target import Input, Target, promise
from services.agent.fold import AgentFold
from services.classifier.fold import ClassifierFold
from services.rules.skill_memory import check_agent, check_classifier
from services.wire import codec
from services.wire.definition import Art2Settings, Definition
from services.wire.definition_file import check, definition_sha256, parse
from services.wire.definition_rules import contradiction
from services.wire.errors import BadPayloadError, DefinitionError, FoldError
from services.wire.messages import Force, Observation, Outcome, Reward, RunRecord, State

_TOML_WORDS = (
    "=", "\n", "[", "]", "[[", "{", "}", '"', "'''", "#", ".", "1e999", "-inf", "nan", "0x" + "f" * 90, "9" * 4400,
    "true", "1979-05-27T07:32:00Z", "a.b.c.d", "[[[[[[[[", "\\u0000", "\\ud800", "name", "start", "kind", "[policy]\n",
    "x_mm = 99", "['a\\nb']", '"a\\nb" = 1', "\r", "\x1b", 'kind = "plugin"\nname = "x"', "settings = {a = 1}",
)  # fmt: skip
_OVERRIDES = (
    "start.x_mm=2.0",
    "policy.kind=greedy",
    "learner.kind=sarsa",
    "limits.hard_force_n=30",
    "noise.scale=0",
    "classifier.theta=0.3",
)

_ENDS: tuple[Outcome | None, ...] = (None, None, None, "inserted", "collision")


def targets(run: SmallRun) -> list[Target]:
    """Return the readers, fed with what a run is made into."""
    agent, classifier = run.agent.snapshot(), run.classifier.snapshot()
    return [
        _memory("agent memory", agent, _restore_agent),
        _memory("classifier memory", classifier, _restore_classifier),
        _memory("skill's agent", run.agent.learnt(), _check_agent),
        _memory("skill's classifier", run.classifier.learnt(), _check_classifier),
        Target("agent fold", _told_agent, _tell_agent, ()),
        Target("classifier fold", _told_classifier, _tell_classifier, ()),
        _definition_file(),
        _overrides(),
        _json_definition(),
    ]


def _memory(name: str, sound: Snapshot, read: Callable[[Input], str | None]) -> Target:
    def of_bytes(data: bytes) -> Input:
        try:
            given = msgspec.msgpack.decode(data, type=dict[str, bytes | int])
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            return {}
        return given

    seeds = [msgspec.msgpack.encode(sound)]
    return Target(name, lambda rng: hostile_memory(rng, sound), read, (ValueError, BadPayloadError), of_bytes, seeds)


def _restore_agent(given: Input) -> None:
    fold = AgentFold(DEFINITION, RUN, SEED)
    before = fold.learner.digest()
    try:
        fold.restore(given)
    except ValueError:
        promise(fold.learner.digest() == before and fold.decisions == 0, "a refused memory that left something behind")
        raise
    promise(fold.snapshot() == given, "a memory that is another one when it is given back")


def _restore_classifier(given: Input) -> None:
    fold = ClassifierFold(DEFINITION, RUN)
    before = fold.learnt()
    try:
        fold.restore(given)
    except ValueError:
        promise(fold.learnt() == before and fold.decisions == 0, "a refused memory that left something behind")
        raise
    promise(fold.snapshot() == given, "a memory that is another one when it is given back")


def _check_agent(given: Input) -> None:
    states = check_agent(given, DEFINITION.moves.actions)
    fold = AgentFold(DEFINITION, RUN, SEED)
    fold.learner.restore(given)
    promise(fold.learner.states == states, "a skill with another number of states than its agent's")


def _check_classifier(given: Input) -> None:
    settings = DEFINITION.classifier
    assert isinstance(settings, Art2Settings)
    states = check_classifier(given, settings)
    fold = ClassifierFold(DEFINITION, RUN)
    fold.restore({**given, "fold_decisions": 0, "fold_episode": 0, "fold_swaps": 0})
    promise(fold.learnt()["states"] == states, "a skill with another number of states than its classifier's")


# -- folds ------------------------------------------------------------------------------------------------------------


def _place(rng: Random) -> dict[str, Input]:
    """Return run, episode, step and decision near those of a run that has just begun, or far from them."""
    near = (0, 0, 0, 1, 1, 2, 3, 5)
    far = (99_999, 100_000)
    run = RUN if rng.random() < 0.95 else "another-run"
    numbers = {name: rng.choice(near if rng.random() < 0.95 else far) for name in ("episode", "step", "decision")}
    return {"run": run, **numbers}


def _told_agent(rng: Random) -> Input:
    messages: list[State | Reward] = []
    for _ in range(6):
        state = rng.choice((0, 0, 1, 2, 17, 10**6 - 1))
        terminal = rng.choice(_ENDS)
        worth = rng.choice((-1.0, 0.0, 1e12, -1e12, 5e-324))
        said = (
            State(**_place(rng), state=state, states=state + 1, match=0.5),
            Reward(**_place(rng), reward=worth, terminal=terminal),
        )
        messages.append(rng.choice(said))
    return messages


def _tell_agent(given: Input) -> str | None:
    fold, refused = AgentFold(DEFINITION, RUN, SEED), None
    for message in given:
        before = (fold.learner.digest(), fold.decisions, fold.rewards, fold.episode)
        try:
            _ = fold.decide(message) if isinstance(message, State) else fold.reward(message)
        except FoldError as error:
            refused = type(error).__name__
            after = (fold.learner.digest(), fold.decisions, fold.rewards, fold.episode)
            promise(before == after, "a refused message that changed the agent")
    return refused


def _told_classifier(rng: Random) -> Input:
    numbers = (0.0, -0.0, 1.0, -2.5, 1e5, -1e5, 5e-324, 1e-160, 1e-9)
    forces: list[Force] = [(rng.choice(numbers), rng.choice(numbers), rng.choice(numbers)) for _ in range(2)]
    return [
        Observation(**_place(rng), force_n=rng.choice((*DIRECTIONS, *forces)), torque_nm=rng.choice((TORQUE, *forces)))
        for _ in range(4)
    ]


def _tell_classifier(given: Input) -> str | None:
    fold, refused = ClassifierFold(DEFINITION, RUN), None
    for message in given:
        before = (fold.learnt(), fold.decisions, fold.episode)
        try:
            state = fold.observe(message)
        except FoldError as error:
            refused = type(error).__name__
            promise((fold.learnt(), fold.decisions, fold.episode) == before, "a refusal that changed the classifier")
        else:
            codec.decode_payload(State, codec.encode(state))  # what it says has to be sayable
    return refused


# -- definitions ------------------------------------------------------------------------------------------------------


def _check_definition(definition: Definition) -> None:
    promise(contradiction(definition) is None, "a definition that contradicts itself")
    sha256 = definition_sha256(definition)
    record = RunRecord(
        run=RUN, seed=0, definition=definition, definition_sha256=sha256, skill_sha256=None, contract_sha256=sha256
    )
    back = codec.decode_payload(RunRecord, codec.encode(record))
    promise(back == record, "a definition that is another one after being sent on")


def _definition_file() -> Target:
    seeds = definitions()
    texts = [seed.decode() for seed in seeds]

    def make(rng: Random) -> Input:
        if rng.random() < 0.2:
            return mutate_bytes(rng, rng.choice(seeds))
        return mutate_text(rng, rng.choice(texts), _TOML_WORDS).encode(errors="replace")

    def read(given: Input) -> None:
        _check_definition(parse(given, "fuzz.toml"))

    return Target("definition file", make, read, (DefinitionError,), bytes, seeds)


def _overrides() -> Target:
    short = definitions()[0]

    def make(rng: Random) -> Input:
        return [mutate_text(rng, rng.choice(_OVERRIDES), _TOML_WORDS) for _ in range(rng.randint(1, 2))]

    def read(given: Input) -> None:
        _check_definition(parse(short, "fuzz.toml", given))

    seeds = [one.encode() for one in _OVERRIDES]
    return Target("override", make, read, (DefinitionError,), lambda data: [data.decode(errors="replace")], seeds)


def _json_definition() -> Target:
    """Definitions as a generic client's JSON would have them."""
    tree = msgspec.to_builtins(DEFINITION)

    def make(rng: Random) -> Input:
        changed = tree
        for _ in range(rng.randint(1, 3)):
            changed = mutate_tree(rng, changed)
        text = msgspec.json.encode(_json_able(changed)).decode()
        return mutate_text(rng, text, ("{", "}", "[", "NaN", "1e999", "null", '"')) if rng.random() < 0.3 else text

    def read(given: Input) -> None:
        try:
            fields = json.loads(given)
        except (ValueError, RecursionError) as error:
            raise DefinitionError("no JSON") from error
        if not isinstance(fields, dict):
            raise DefinitionError("no JSON object")
        _check_definition(check(fields, {}, "fuzz.json"))

    seeds = [msgspec.json.encode(DEFINITION)]
    return Target("JSON definition", make, read, (DefinitionError,), lambda data: data.decode(errors="replace"), seeds)


def _json_able(node: object) -> object:
    """Return a tree without what JSON does not have."""
    if isinstance(node, dict):
        return {str(key): _json_able(value) for key, value in node.items()}
    if isinstance(node, list | tuple):
        return [_json_able(item) for item in node]
    return node if isinstance(node, str | int | float | None) else repr(node)
