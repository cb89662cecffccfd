"""Messages to bytes and back: MessagePack maps; the Zenoh encoding names type and version.

Decoding checks everything that the types state: names, types, lengths, finiteness (by range) and ranges, and that a
definition in it could be used. Nothing that arrives is trusted; what does not fit raises a ContractError that says
where, in one line.
"""

from __future__ import annotations

import hashlib
import re
from functools import cache
from types import UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

import msgspec

from services.wire.definition_rules import contradiction
from services.wire.errors import BadPayloadError, WrongTypeError, WrongVersionError
from services.wire.messages import MESSAGES, Experiment, Message, RunRecord, Skill
from services.wire.text import in_words, one_line

MAX_PAYLOAD_BYTES = 1 << 24
ENCODING_PREFIX = "application/msgpack;treenail."
_ENCODING = re.compile(r"^application/msgpack;treenail\.([A-Za-z]+)\.v([0-9]+)$")
_KINDS = {kind.__name__: kind for kind in MESSAGES}
# Straight into the type: what was built as plain lists and maps first took 64 times the room of a hostile payload.
_DECODERS: dict[type[Message], msgspec.msgpack.Decoder[Any]] = {
    kind: msgspec.msgpack.Decoder(kind) for kind in MESSAGES
}
_ENCODER = msgspec.msgpack.Encoder(order="deterministic")

M = TypeVar("M", bound=Message)


def encoding_of(kind: type[Message]) -> str:
    """Return the Zenoh encoding of a message type, e.g. ``application/msgpack;treenail.State.v1``."""
    return f"{ENCODING_PREFIX}{kind.__name__}.v{kind.VERSION}"


def encode(message: Message) -> bytes:
    """Return the MessagePack map of a message; equal messages give equal bytes."""
    return _ENCODER.encode(message)


def encode_json(message: Message) -> bytes:
    """Return the message as a JSON object, for generic clients; byte strings become base64."""
    return msgspec.json.encode(message)


def decode(kind: type[M], payload: bytes, encoding: str) -> M:
    """Return the message in ``payload``.

    Raises WrongTypeError or WrongVersionError when ``encoding`` does not name ``kind`` in this version, and
    BadPayloadError when the payload does not fit the type.
    """
    if encoding != encoding_of(kind):
        raise _wrong_encoding(kind, encoding)
    return decode_payload(kind, payload)


def decode_payload(kind: type[M], payload: bytes) -> M:
    """Return the message in ``payload`` without looking at an encoding (for stored values). Raises BadPayloadError."""
    largest = min(kind.LARGEST_BYTES, MAX_PAYLOAD_BYTES)
    if len(payload) > largest:
        raise BadPayloadError(f"{kind.__name__}: expected at most {largest} bytes, got {len(payload)}")
    try:
        message: M = _DECODERS[kind].decode(payload)
    except msgspec.ValidationError as error:
        raise BadPayloadError(f"{kind.__name__}: {one_line(in_words(str(error)))}") from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        got = f"{len(payload)} bytes: {one_line(str(error))}"
        raise BadPayloadError(f"{kind.__name__}: expected a MessagePack map, got {got}") from error
    if isinstance(message, Experiment | RunRecord | Skill) and (conflict := contradiction(message.definition)):
        raise BadPayloadError(f"{kind.__name__}: definition: {conflict[0]}: {conflict[1]}")
    return message


def decode_json(kind: type[M], payload: bytes) -> M:
    """Return the message in a JSON object such as ``encode_json`` makes. Raises BadPayloadError."""
    try:
        return msgspec.json.decode(payload, type=kind)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise BadPayloadError(f"{kind.__name__}: {one_line(in_words(str(error)))}") from error


def decode_any(payload: bytes, encoding: str) -> Message:
    """Return the message of whichever type ``encoding`` names. Raises ContractError like ``decode``."""
    match = _ENCODING.match(encoding)
    kind = _KINDS.get(match.group(1)) if match else None
    if kind is None:
        raise WrongTypeError(f"payload: expected one of Treenail's types, got encoding {encoding[:100]!r}")
    return decode(kind, payload, encoding)


def contract_schema() -> dict[str, object]:
    """Return names, types, ranges and versions of all messages: what the contract hash stands for.

    It has no word of prose in it, so that it is the same in every interpreter, with docstrings or without.
    """
    types: dict[str, object] = {}
    waiting: list[type[msgspec.Struct]] = [*MESSAGES]
    while waiting:
        kind = waiting.pop()
        if kind.__name__ in types:
            continue
        fields: dict[str, object] = {}
        hints = get_type_hints(kind, include_extras=True)
        for field in msgspec.structs.fields(kind):
            fields[field.name] = [_shape(hints[field.name], waiting), field.required, _default(field)]
        types[kind.__name__] = {"kind": kind.__struct_config__.tag, "fields": fields}
    return {"versions": {kind.__name__: kind.VERSION for kind in MESSAGES}, "types": types}


_RANGES = ("ge", "gt", "le", "lt", "pattern", "min_length", "max_length")


def _shape(hint: object, waiting: list[type[msgspec.Struct]]) -> object:
    """Return a type and its range in plain words; the structs in it are put into ``waiting``."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin is Annotated:
        inner, *extras = arguments
        limits = {
            name: value for meta in extras for name in _RANGES if (value := getattr(meta, name, None)) is not None
        }
        return [_shape(inner, waiting), limits]
    if origin is Literal:
        return ["literal", *arguments]
    if origin in (Union, UnionType):
        return ["union", *sorted((_shape(part, waiting) for part in arguments), key=repr)]
    if origin is not None:
        return [origin.__name__, *("..." if part is ... else _shape(part, waiting) for part in arguments)]
    if isinstance(hint, type):
        if issubclass(hint, msgspec.Struct):
            waiting.append(hint)
        return hint.__name__
    raise TypeError(f"contract: expected a type that has a name, got {hint!r}")


def _default(field: msgspec.structs.FieldInfo) -> object:
    """Return what a field is when it is not given."""
    if field.default_factory is not msgspec.NODEFAULT:
        return field.default_factory()
    return None if field.default is msgspec.NODEFAULT else msgspec.to_builtins(field.default)


def contract_sha256() -> str:
    """Return the hash of the contract; peers with another one do not understand each other."""
    return _sha256_with(tuple(kind.VERSION for kind in MESSAGES))


@cache
def _sha256_with(_versions: tuple[int, ...]) -> str:
    # Worked out once: it takes milliseconds, and every skill that somebody puts is compared with it.
    return hashlib.sha256(msgspec.json.encode(contract_schema(), order="sorted")).hexdigest()


def _wrong_encoding(kind: type[Message], encoding: str) -> WrongTypeError | WrongVersionError:
    shown = encoding[:100]
    match = _ENCODING.match(encoding)
    if match is not None and match.group(1) == kind.__name__:
        return WrongVersionError(f"{kind.__name__}: expected version {kind.VERSION}, got version {match.group(2)[:20]}")
    return WrongTypeError(f"{kind.__name__}: expected encoding {encoding_of(kind)!r}, got {shown!r}")
