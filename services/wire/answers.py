"""Queries as a service sees them: parameters checked, the answer in MessagePack or JSON, errors as a Refusal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

import zenoh

from services.wire.codec import decode, encode, encode_json, encoding_of
from services.wire.errors import BadPayloadError, RefusedError, TreenailError
from services.wire.messages import Message, Reason, Refusal

M = TypeVar("M", bound=Message)


@dataclass(frozen=True)
class Request:
    """A query as a handler sees it."""

    parameters: Mapping[str, str]
    payload: bytes
    encoding: str

    def message(self, kind: type[M]) -> M:
        """Return the request message in the payload; raises ContractError."""
        return decode(kind, self.payload, self.encoding)


class Asked:
    """One query on a key of ours, to be answered once: now, or later when something else has to be asked first."""

    def __init__(self, query: zenoh.Query, key: str, allowed: tuple[str, ...]) -> None:
        """``allowed`` are the names of the parameters that it may have beside ``format``."""
        self._query = query
        self._key = key
        self._allowed = allowed
        self._as_json = False

    def request(self) -> Request:
        """Return what is asked. Raises BadPayloadError for a parameter that nobody would read."""
        query, parameters = self._query, parameters_of(self._query)
        self._as_json = wants_json(parameters.pop("format", "msgpack"))
        _check_parameters(parameters, self._allowed)
        payload = b"" if query.payload is None else query.payload.to_bytes()
        return Request(parameters, payload, "" if query.encoding is None else str(query.encoding))

    def reply(self, message: Message) -> None:
        """Answer with a message."""
        body = encode_json(message) if self._as_json else encode(message)
        self._query.reply(self._key, body, encoding=self._encoding(type(message)))

    def refuse(self, error: TreenailError) -> None:
        """Answer with why not."""
        refusal = Refusal(reason=_reason(error), message=str(error)[:1000])
        body = encode_json(refusal) if self._as_json else encode(refusal)
        self._query.reply_err(body, encoding=self._encoding(Refusal))

    def _encoding(self, kind: type[Message]) -> str:
        return "application/json" if self._as_json else encoding_of(kind)


def parameters_of(query: zenoh.Query) -> dict[str, str]:
    """Return the parameters after the ``?`` of a query's selector."""
    pairs = (part.partition("=") for part in str(query.parameters).split(";") if part)
    return {name: value for name, _, value in pairs}


def wants_json(form: str) -> bool:
    """Return whether a query's ``format`` parameter asks for JSON. Raises BadPayloadError for an unknown form."""
    if form not in ("json", "msgpack"):
        raise BadPayloadError(f"format: expected json or msgpack, got {form[:20]!r}")
    return form == "json"


def _check_parameters(parameters: Mapping[str, str], allowed: tuple[str, ...]) -> None:
    """Raise BadPayloadError for a parameter that nobody would read; names with ``_`` in front are Zenoh's own."""
    for name in parameters:
        if name not in allowed and not name.startswith("_"):
            expected = ", ".join((*allowed, "format"))
            raise BadPayloadError(f"parameter: expected one of {expected}, got {name[:20]!r}")


def _reason(error: TreenailError) -> Reason:
    """Return the stable reason of a Refusal: an error's own, or the one of its kind."""
    return error.reason if isinstance(error, RefusedError) else "bad_request"
