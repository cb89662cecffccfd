"""Inputs that Hypothesis makes from nothing, steered to get deep into a reader before they are refused."""

from __future__ import annotations

import msgpack
import msgspec
import pytest
from hypothesis import HealthCheck, given, settings, target
from hypothesis import strategies as st

from experiments.fuzz.campaign import all_targets
from experiments.fuzz.sound import RUN
from experiments.fuzz.target import outcome
from experiments.fuzz.wire_targets import check_taken
from services.wire import codec
from services.wire.definition import Definition
from services.wire.errors import BadPayloadError
from services.wire.messages import MESSAGES, JournalStep, Message

TARGETS = {one.name: one for one in all_targets()}
STRUCTS = (*MESSAGES, JournalStep, Definition, *(type(part) for part in msgspec.structs.astuple(Definition(name="x"))))
NAMES = sorted({name for kind in STRUCTS for name in getattr(kind, "__struct_fields__", ())} | {"kind"})
WORDS = (
    RUN,
    "0f" * 32,
    "agent",
    "inserted",
    "guard",
    "art2",
    "greedy",
    "softmax",
    "insertion",
    "odd",
    "round",
    "nearest",
)


def maps(inner: st.SearchStrategy[object]) -> st.SearchStrategy[dict[str, object]]:
    """Maps with names that the contract has."""
    return st.dictionaries(st.sampled_from(NAMES) | st.text(max_size=4), inner, max_size=5)


leaf = (
    st.none()
    | st.integers(-(2**63), 2**64 - 1)
    | st.integers(0, 9)
    | st.floats()
    | st.floats(0, 1)
    | st.sampled_from(WORDS)
    | st.text(max_size=8)
    | st.binary(max_size=48)
)
tree = st.recursive(
    leaf,
    lambda inner: st.lists(inner, min_size=3, max_size=3) | st.lists(inner, max_size=7) | maps(inner),
    max_leaves=6,
)
steered = settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))


def depth(error: BadPayloadError) -> float:
    """Return how far into a message a reader came: the parts of the path that its complaint ends with."""
    _, _, path = str(error).rpartition("$")
    return float(path.count(".") + path.count("["))


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.__name__)
@steered
@given(data=st.data())
def test_what_is_made_of_a_messages_own_names_is_taken_or_refused(kind: type[Message], data: st.DataObject) -> None:
    own = st.fixed_dictionaries({}, optional=dict.fromkeys(kind.__struct_fields__, tree))
    payload = msgpack.packb(data.draw(own | maps(tree)))
    try:
        codec.decode_payload(kind, payload)
    except BadPayloadError as error:
        target(depth(error))
    else:
        check_taken(kind, payload)


@pytest.mark.parametrize("name", [name for name, one in TARGETS.items() if one.of_bytes is not None])
@steered
@given(data=st.data())
def test_bytes_and_text_are_taken_or_refused(name: str, data: st.DataObject) -> None:
    of_bytes, seed = TARGETS[name].of_bytes, data.draw(st.sampled_from(TARGETS[name].seeds))
    assert of_bytes is not None
    start, end = sorted((data.draw(st.integers(0, len(seed))), data.draw(st.integers(0, len(seed)))))
    middle = data.draw(st.binary(max_size=30) | st.text(max_size=20).map(str.encode))
    word = outcome(TARGETS[name], of_bytes(seed[:start] + middle + seed[end:]))
    target(float(len(seed) - (end - start)) if word == "taken" else float(start))
