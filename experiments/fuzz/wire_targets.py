"""Readers of what comes over the bus: messages, skills, what is to be stored, and the parameters of queries."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from random import Random

import msgspec

from experiments.fuzz.mutate import TEXTS, hostile_memory, mutate_bytes, mutate_payload, mutate_text
from experiments.fuzz.sound import RUN, SmallRun
from experiments.fuzz.target import Input, Target, promise
from services.agent.fold import AgentFold
from services.bus import answers
from services.classifier.fold import ClassifierFold
from services.rules import skill
from services.store.contents import check
from services.store.values import Delete, key_range, zenoh_timestamp
from services.wire import codec
from services.wire.errors import BadPayloadError, ContractError, TreenailError
from services.wire.keys import CONTRACT, Keys, name_of, named
from services.wire.message_base import LARGEST_COMPONENT
from services.wire.messages import MESSAGES, Message, Skill

_ENCODINGS = (
    "",
    "application/json",
    "zenoh/bytes",
    "application/msgpack",
    f"{codec.ENCODING_PREFIX}State.v",
    "x" * 9000,
)
_SELECTORS = (
    "state=7",
    "ft=0.2,0,-1.5,0,0.02,0",
    "ft=0.2,0,-1.5,0,0.02,0;format=json",
    "format=json",
    "format=msgpack;state=3",
    "_time=[now(-1h)..]",
)
_WORDS = (
    "=",
    ";",
    ",",
    "?",
    "format=",
    "state=",
    "ft=",
    "json",
    "nan",
    "inf",
    "1e999",
    "0x10",
    "-0",
    "9" * 400,
    "\u0667",
)
_PARTS: dict[str, str | int] = {"run": RUN, "service": "agent", "episode": 0, "sha256": "0f" * 32, "instance": "0-0"}
_NAMES = (*(name_of(pattern, **_PARTS) for pattern in CONTRACT), "journal/other/run", "checkpoint/x/y/z")
"""Every key of the contract, and some that it does not have."""
_TIMESTAMP = "66f00000000000aa/" + "0f" * 16


def targets(run: SmallRun) -> list[Target]:
    """Return the readers, fed with what a run is made into."""
    messages = [_message(kind, run) for kind in MESSAGES]
    return [*messages, _any_message(run), _skill(run), _skill_file(run), _stored(run), _stored_key(), *_parameters()]


def check_taken(kind: type[Message], payload: bytes) -> None:
    """Check that a payload which was taken means the same after being encoded again, and is good JSON."""
    message = codec.decode_payload(kind, payload)
    encoded = codec.encode(message)
    again = codec.decode_payload(kind, encoded)
    promise(type(again) is kind and again == message, "a message that is another one after being sent on")
    promise(codec.encode(again) == encoded, "equal messages with other bytes")
    promise(list(json.loads(codec.encode_json(message))) == list(kind.__struct_fields__), "JSON with other fields")


def _message(kind: type[Message], run: SmallRun) -> Target:
    trees, good = run.trees[kind], codec.encoding_of(kind)

    def make(rng: Random) -> Input:
        encoding = good if rng.random() < 0.93 else _wrong_encoding(rng, good)
        return mutate_payload(rng, trees), encoding

    def read(given: Input) -> None:
        payload, encoding = given
        codec.decode(kind, payload, encoding)
        check_taken(kind, payload)

    return Target(f"message {kind.__name__}", make, read, (ContractError,))


def _any_message(run: SmallRun) -> Target:
    """Payloads under the encoding of any type, right or wrong: what a generic reader gets."""

    def make(rng: Random) -> Input:
        kind = rng.choice(MESSAGES)
        encoding = codec.encoding_of(kind)
        return mutate_payload(rng, run.trees[kind]), encoding if rng.random() < 0.5 else _wrong_encoding(rng, encoding)

    def read(given: Input) -> None:
        message = codec.decode_any(*given)
        check_taken(type(message), given[0])

    def of_bytes(data: bytes) -> Input:
        return data[1:], codec.encoding_of(MESSAGES[data[0] % len(MESSAGES)] if data else MESSAGES[0])

    seeds = [bytes([MESSAGES.index(type(message))]) + codec.encode(message) for message in run.messages]
    return Target("any message", make, read, (ContractError,), of_bytes, seeds)


def _wrong_encoding(rng: Random, good: str) -> str:
    kind = rng.choice(MESSAGES)
    other = rng.choice((codec.encoding_of(kind), f"{good[:-1]}{rng.choice((0, 2, 99, 10**30))}", *_ENCODINGS))
    return other if rng.random() < 0.7 else mutate_text(rng, good, _ENCODINGS[1:5])


def _skill(run: SmallRun) -> Target:
    good = codec.encoding_of(Skill)

    def read(given: Input) -> None:
        found = skill.decode(given, good)
        promise(found.sha256 == hashlib.sha256(given).hexdigest(), "a skill of another name than its bytes'")
        _check_loads(found.skill)

    seeds = [codec.encode(run.skill)]
    return Target("skill", lambda rng: _skill_payload(rng, run), read, (ContractError,), bytes, seeds)


def _skill_payload(rng: Random, run: SmallRun) -> bytes:
    """Return what the bytes of a skill have become: half the time by what is in its memories."""
    (tree,) = run.trees[Skill]
    if rng.random() < 0.5 or not isinstance(tree, dict):
        return mutate_payload(rng, [tree])
    whose = rng.choice(("agent", "classifier"))
    return codec.encode(msgspec.structs.replace(run.skill, **{whose: hostile_memory(rng, tree[whose])}))


def _skill_file(run: SmallRun) -> Target:
    whole = skill.file_bytes(skill.named(run.skill))

    def make(rng: Random) -> Input:
        if rng.random() < 0.5:
            return mutate_bytes(rng, whole)
        payload = _skill_payload(rng, run)  # under a header that agrees with it
        header = whole.split(b"\nsha256 ")[0] + f"\nsha256 {hashlib.sha256(payload).hexdigest()}\n".encode()
        return header + f"bytes {len(payload)}\n".encode() + payload

    def read(given: Input) -> None:
        found = skill.parse(given)
        promise(skill.file_bytes(found) == given, "a file that is another one after being written again")
        _check_loads(found.skill)

    return Target("skill file", make, read, (ContractError, skill.SkillError), bytes, [whole])


def _check_loads(found: Skill) -> None:
    """Check that the workers can load what was said to be sound."""
    agent = AgentFold(found.definition, found.run, found.seed)
    classifier = ClassifierFold(found.definition, found.run)
    try:
        agent.begin_with(found)
        classifier.begin_with(found)
    except ValueError as error:
        promise(False, f"a skill that is sound but cannot be loaded: {error}")
    promise(agent.learnt() == found.agent, "an agent with another memory than its skill's")
    promise(classifier.learnt() == found.classifier, "a classifier with another memory than its skill's")


def _stored(run: SmallRun) -> Target:
    trees = [tree for found in run.trees.values() for tree in found]

    def make(rng: Random) -> Input:
        name = rng.choice(_NAMES)
        if rng.random() < 0.1:
            name = mutate_text(rng, name, _NAMES)
        key = named(name)
        fitting = () if key is None else CONTRACT[key.pattern].types
        kind = fitting[-1] if fitting and rng.random() < 0.8 else rng.choice(MESSAGES)
        payload = mutate_payload(rng, run.trees[kind] if rng.random() < 0.9 else trees)
        return name, payload, codec.encoding_of(kind)

    def read(given: Input) -> None:
        check(*given)

    return Target("stored value", make, read, (ContractError,))


def _stored_key() -> Target:
    def make(rng: Random) -> Input:
        key = mutate_text(rng, f"treenail/a/{rng.choice(_NAMES)}", ("/", "**", "*", "$*", "//", "?", "#", "treenail"))
        timestamp = _TIMESTAMP if rng.random() < 0.7 else mutate_text(rng, _TIMESTAMP, ("/", "0" * 32, "f" * 16))
        return key, timestamp

    def read(given: Input) -> None:
        key, timestamp = given
        Delete(key, timestamp)
        low, high = key_range(key)
        promise(isinstance(high, bytes) or low <= high, "a range of keys that ends before it begins")
        zenoh_timestamp(timestamp)

    return Target("stored key", make, read, (ValueError,))


def _parameters() -> list[Target]:
    """Return the readers of a query's parameters, each of its own."""

    def selector(given: Input) -> None:
        parameters = answers.parameters_in(given)
        answers.wants_json(parameters.pop("format", "msgpack"))
        answers.check_parameters(parameters, ("state", "ft"))
        if "state" in parameters:
            answers.state_number(parameters["state"])
        if "ft" in parameters:
            answers.ft_vector(parameters["ft"])

    def state(given: Input) -> None:
        promise(0 <= answers.state_number(given) < 10**6, "a state number out of range")

    def vector(given: Input) -> None:
        force_n, torque_nm = answers.ft_vector(given)
        promise(all(abs(item) <= LARGEST_COMPONENT for item in (*force_n, *torque_nm)), "a force out of range")

    def cell(given: Input) -> None:
        key = Keys(given).of("ft")
        promise(key.split("/") == ["treenail", given, "ft"], "a cell that is not one plain part of a key")

    return [
        _text("selector", _SELECTORS, selector, (BadPayloadError,)),
        _text("state parameter", ("7", "999999", "0"), state, (BadPayloadError,)),
        _text("ft parameter", ("0.2,0,-1.5,0,0.02,0", "1e3,.5,-2.,0,0,0"), vector, (BadPayloadError,)),
        _text("cell name", ("a", "bench-2", "z" * 32), cell, (TreenailError,)),
    ]


def _text(
    name: str, sound: tuple[str, ...], read: Callable[[Input], str | None], refusals: tuple[type[Exception], ...]
) -> Target:
    def make(rng: Random) -> Input:
        return mutate_text(rng, rng.choice(sound), (*_WORDS, *TEXTS[:4]))

    return Target(
        name, make, read, refusals, lambda data: data.decode(errors="replace"), [one.encode() for one in sound]
    )
