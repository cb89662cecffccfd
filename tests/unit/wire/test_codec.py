"""Every message type there and back, and everything that must be refused."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import msgpack
import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from services.wire import codec
from services.wire.definition import Definition, ForceChangeReward, Greedy
from services.wire.errors import BadPayloadError, ContractError, WrongTypeError, WrongVersionError
from services.wire.messages import MESSAGES, Alive, Checkpoint, Message, RunRecord, State

few = settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])
every_type = pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.__name__)
Strategies = Callable[[Any], st.SearchStrategy[Any]]


def state(**changes: Any) -> State:
    fields: dict[str, Any] = {"run": "r", "episode": 1, "step": 2, "decision": 3, "state": 4, "states": 5, "match": 0.5}
    return State(**(fields | changes))


def pack(fields: object) -> bytes:
    packed: bytes = msgpack.packb(fields)
    return packed


# -- there and back ------------------------------------------------------------------------------------------------


@every_type
@few
@given(data=st.data())
def test_a_message_comes_back_as_it_was_sent(strategy_of: Strategies, kind: type[Message], data: st.DataObject) -> None:
    message = data.draw(strategy_of(kind))
    payload = codec.encode(message)
    back = codec.decode(kind, payload, codec.encoding_of(kind))
    assert back == message
    assert type(back) is kind
    assert codec.encode(back) == payload
    assert codec.decode_any(payload, codec.encoding_of(kind)) == message


@every_type
@few
@given(data=st.data())
def test_json_has_all_fields_and_nothing_but_json(
    strategy_of: Strategies, kind: type[Message], data: st.DataObject
) -> None:
    message = data.draw(strategy_of(kind))

    def no_constant(name: str) -> object:
        raise AssertionError(f"{name} is not JSON")

    fields = json.loads(codec.encode_json(message).decode("utf-8"), parse_constant=no_constant)
    assert list(fields) == list(kind.__struct_fields__)
    assert msgspec.convert(fields, kind) == message


def test_a_nested_definition_keeps_the_kind_of_its_parts() -> None:
    definition = Definition(name="x", reward=ForceChangeReward(fell_by=0.25), policy=Greedy())
    record = RunRecord(
        run="r", seed=0, definition=definition, definition_sha256="0" * 64, skill_sha256=None, contract_sha256="1" * 64
    )
    back = codec.decode_payload(RunRecord, codec.encode(record))
    assert back.definition.reward == ForceChangeReward(fell_by=0.25)
    assert back.definition.policy == Greedy()


@pytest.mark.parametrize("value", [0.1, 1 / 3, 5e-324, -0.0, 1.0, 1.000001])
def test_floats_come_back_bit_for_bit(value: float) -> None:
    back = codec.decode_payload(State, codec.encode(state(match=value)))
    assert back.match.hex() == value.hex()


def test_equal_messages_give_equal_bytes() -> None:
    assert codec.encode(state()) == codec.encode(state())
    assert codec.encode(state()) != codec.encode(state(state=5))


def test_equal_maps_give_equal_bytes_whatever_their_order() -> None:
    one = Checkpoint(
        run="r", service="agent", episode=0, decisions=0, contract_sha256="0" * 64, snapshot={"a": 1, "b": b"2"}
    )
    other = msgspec.structs.replace(one, snapshot={"b": b"2", "a": 1})
    assert one == other
    assert codec.encode(one) == codec.encode(other)


# -- encodings -----------------------------------------------------------------------------------------------------


@every_type
def test_the_encoding_names_type_and_version(kind: type[Message]) -> None:
    assert codec.encoding_of(kind) == f"application/msgpack;treenail.{kind.__name__}.v{kind.VERSION}"


@every_type
def test_another_type_is_refused(sample_of: Callable[[Any], Any], kind: type[Message]) -> None:
    payload = codec.encode(sample_of(kind))
    for other in MESSAGES:
        if other is not kind:
            with pytest.raises(WrongTypeError, match=f"^{other.__name__}: expected encoding"):
                codec.decode(other, payload, codec.encoding_of(kind))


@every_type
def test_another_version_is_refused(sample_of: Callable[[Any], Any], kind: type[Message]) -> None:
    payload, unversioned = codec.encode(sample_of(kind)), codec.encoding_of(kind).removesuffix(str(kind.VERSION))
    for version in ("0", "99", "01", "11", "9" * 400):
        with pytest.raises(WrongVersionError, match=f"^{kind.__name__}: expected version {kind.VERSION}, got version "):
            codec.decode(kind, payload, unversioned + version)
        with pytest.raises(WrongVersionError):
            codec.decode_any(payload, unversioned + version)


@pytest.mark.parametrize(
    "encoding",
    [
        "",
        "zenoh/bytes",
        "application/msgpack",
        "application/json",
        "application/msgpack;treenail.State",
        "application/msgpack;treenail.State.v",
        "application/msgpack;treenail.State.vx",
        "application/msgpack;treenail.state.v1",
        " application/msgpack;treenail.State.v1",
        "application/msgpack;treenail.State.v1 ",
        "application/msgpack;treenail.State.v1\n",
        "application/msgpack;treenail.Stateful.v1",
        "application/msgpack;treenail.Message.v1",
        "x" * 100_000,
    ],
)
def test_what_is_no_encoding_of_ours_is_refused(encoding: str) -> None:
    with pytest.raises(ContractError) as error:
        codec.decode(State, codec.encode(state()), encoding)
    assert len(str(error.value)) < 400
    with pytest.raises(ContractError):
        codec.decode_any(codec.encode(state()), encoding)


@few
@given(encoding=st.text(max_size=60), payload=st.binary(max_size=40))
def test_any_encoding_is_a_contract_error_at_worst(encoding: str, payload: bytes) -> None:
    with pytest.raises(ContractError):
        codec.decode_any(payload, encoding)


# -- payloads that do not fit --------------------------------------------------------------------------------------


@every_type
def test_what_does_not_fit_is_refused_wherever_it_stands(
    broken_payloads: Callable[[Any], list[tuple[str, object]]], kind: type[Message]
) -> None:
    cases = broken_payloads(kind)
    assert len(cases) > 10
    taken = []
    for what, fields in cases:
        try:
            codec.decode_payload(kind, pack(fields))
        except BadPayloadError as error:
            assert str(error).startswith(f"{kind.__name__}: ")
        else:
            taken.append(what)
    assert taken == []


@every_type
def test_a_required_field_that_is_missing_is_named(
    sample_of: Callable[[Any], Any], plain_of: Callable[[Any], Any], kind: type[Message]
) -> None:
    fields = plain_of(sample_of(kind))
    for field in msgspec.structs.fields(kind):
        without = {key: value for key, value in fields.items() if key != field.name}
        if not field.required:
            codec.decode_payload(kind, pack(without))
            continue
        with pytest.raises(BadPayloadError, match=f"missing required field `{field.name}`"):
            codec.decode_payload(kind, pack(without))


@every_type
def test_a_payload_cut_short_or_with_more_behind_it_is_refused(
    sample_of: Callable[[Any], Any], kind: type[Message]
) -> None:
    payload = codec.encode(sample_of(kind))
    for length in range(len(payload)):
        with pytest.raises(BadPayloadError):
            codec.decode_payload(kind, payload[:length])
    for more in (b"\x00", b"\xc0", payload):
        with pytest.raises(BadPayloadError):
            codec.decode_payload(kind, payload + more)


@every_type
def test_what_is_no_map_of_its_fields_is_refused(kind: type[Message]) -> None:
    values: tuple[object, ...] = (None, True, 7, -1.5, "text", b"bytes", [], [1], {}, {1: 2}, {b"run": 1}, [{}])
    for value in values:
        with pytest.raises(BadPayloadError, match=f"^{kind.__name__}: "):
            codec.decode_payload(kind, pack(value))


HOSTILE = {
    "nothing": b"",
    "reserved byte": b"\xc1",
    "map of 2**32-1 entries": b"\xdf\xff\xff\xff\xff",
    "list of 2**32-1 items": b"\xdd\xff\xff\xff\xff",
    "string of 2**32-1 bytes": b"\xdb\xff\xff\xff\xff",
    "bytes of 2**32-1 bytes": b"\xc6\xff\xff\xff\xff",
    "extension of 2**32-1 bytes": b"\xc9\xff\xff\xff\xff\x05",
    "a field of 2**32-1 items": b"\x81\xa3run\xdd\xff\xff\xff\xff",
    "lists in lists": b"\x91" * 100_000,
    "lists in lists, closed": b"\x91" * 500 + b"\xc0",
    "maps in maps": b"\x81\xa3run" * 50_000,
    "a field of lists in lists": b"\x81\xa3run" + b"\x91" * 400 + b"\xc0",
    "key that is no UTF-8": b"\x81\xa3\xff\xfe\xfd\x01",
    "value that is no UTF-8": b"\x81\xa3run\xa2\xc3\x28",
    "lone surrogate": b"\x81\xa3run\xa3\xed\xa0\x80",
    "extension": b"\x81\xa3run\xc7\x01\x05\x01",
    "extension as key": b"\x81\xc7\x01\x05\x01\x01",
    "timestamp": b"\x81\xa3run\xd6\xff\x00\x00\x00\x00",
    "timestamp of a wrong size": b"\x81\xa3run\xc7\x03\xff\x00\x00\x00",
    "map as key": b"\x81\x80\x01",
    "list as key": b"\x81\x90\x01",
    "NaN as key": b"\x81\xcb\x7f\xf8\x00\x00\x00\x00\x00\x00\x01",
}


@pytest.mark.parametrize("payload", HOSTILE.values(), ids=list(HOSTILE))
def test_hostile_bytes_are_refused_in_a_short_sentence(payload: bytes) -> None:
    for kind in MESSAGES:
        with pytest.raises(BadPayloadError, match=f"^{kind.__name__}: ") as error:
            codec.decode_payload(kind, payload)
        assert len(str(error.value)) < 500


def test_a_payload_beyond_the_limit_is_refused_unread(monkeypatch: pytest.MonkeyPatch) -> None:
    payload = codec.encode(state())
    monkeypatch.setattr(codec, "MAX_PAYLOAD_BYTES", len(payload))
    assert codec.decode_payload(State, payload) == state()
    monkeypatch.setattr(codec, "MAX_PAYLOAD_BYTES", len(payload) - 1)
    with pytest.raises(BadPayloadError, match=f"expected at most {len(payload) - 1} bytes, got {len(payload)}"):
        codec.decode_payload(State, payload)


@every_type
@settings(max_examples=40, deadline=None)
@given(payload=st.binary(max_size=200))
def test_arbitrary_bytes_are_a_contract_error_at_worst(kind: type[Message], payload: bytes) -> None:
    try:
        message = codec.decode(kind, payload, codec.encoding_of(kind))
    except ContractError:
        return
    assert isinstance(message, kind)


@every_type
@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_a_message_with_bytes_changed_is_refused_or_still_fits(
    sample_of: Callable[[Any], Any], kind: type[Message], data: st.DataObject
) -> None:
    payload = bytearray(codec.encode(sample_of(kind)))
    for _ in range(data.draw(st.integers(1, 3))):
        payload[data.draw(st.integers(0, len(payload) - 1))] = data.draw(st.integers(0, 255))
    try:
        message = codec.decode_payload(kind, bytes(payload))
    except BadPayloadError:
        return
    assert codec.decode_payload(kind, codec.encode(message)) == message


anything = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**64 - 1)
    | st.floats()
    | st.text(max_size=8)
    | st.binary(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)


@every_type
@settings(max_examples=30, deadline=None)
@given(data=st.data())
def test_any_value_in_any_field_is_refused_or_fits(
    sample_of: Callable[[Any], Any], plain_of: Callable[[Any], Any], kind: type[Message], data: st.DataObject
) -> None:
    fields = plain_of(sample_of(kind))
    name = data.draw(st.sampled_from(kind.__struct_fields__))
    fields[name] = data.draw(anything)
    try:
        message = codec.decode_payload(kind, pack(fields))
    except BadPayloadError:
        return
    assert codec.decode_payload(kind, codec.encode(message)) == message


def test_a_whole_number_fits_where_a_float_is_expected() -> None:
    fields = msgspec.to_builtins(state()) | {"match": 1}
    back = codec.decode_payload(State, pack(fields))
    assert isinstance(back.match, float)
    assert back == state(match=1.0)


def test_a_text_is_not_taken_for_bytes() -> None:
    checkpoint = Checkpoint(
        run="r", service="agent", episode=0, decisions=0, contract_sha256="0" * 64, snapshot={"q": b"\x00\x00\x00"}
    )
    fields = msgspec.to_builtins(checkpoint, builtin_types=(bytes,)) | {"snapshot": {"q": "AAAA"}}
    with pytest.raises(BadPayloadError):
        codec.decode_payload(Checkpoint, pack(fields))


def test_of_a_field_given_twice_the_last_is_checked() -> None:
    payload = pack(msgspec.to_builtins(state()))
    twice = bytes([payload[0] + 1]) + payload[1:] + pack("match") + pack(7.5)
    with pytest.raises(BadPayloadError, match="match"):
        codec.decode_payload(State, twice)


# -- the contract --------------------------------------------------------------------------------------------------


def test_every_type_is_in_the_contract_once() -> None:
    names = [kind.__name__ for kind in MESSAGES]
    assert len(set(names)) == len(names)
    every = {kind for base in Message.__subclasses__() for kind in (base, *base.__subclasses__())}
    public = {kind for kind in every if kind.__name__ != "LoopMessage"}
    assert public == set(MESSAGES)


def test_every_type_is_frozen_and_closed() -> None:
    for kind in MESSAGES:
        assert kind.__struct_config__.frozen
        assert kind.__struct_config__.forbid_unknown_fields
    with pytest.raises(AttributeError):
        state().state = 3  # type: ignore[misc]


def test_the_contract_hash_changes_with_a_version(monkeypatch: pytest.MonkeyPatch) -> None:
    before = codec.contract_sha256()
    assert codec.contract_sha256() == before
    monkeypatch.setattr(Alive, "VERSION", 2)
    assert codec.contract_sha256() != before
