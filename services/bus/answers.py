"""Queries as a service sees them: parameters checked, the answer in MessagePack or JSON, errors as a Refusal."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import zenoh
from zenoh.handlers import Callback

from services.wire.codec import decode, encode, encode_json, encoding_of
from services.wire.errors import BadPayloadError, RefusedError, TreenailError
from services.wire.message_base import LARGEST_COMPONENT
from services.wire.messages import Force, Message, Reason, Refusal, Torque
from services.wire.text import numbers, one_line

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
    """One query on a key of ours, to be answered once: now, or later when something else has to be asked first.

    The query is final with the first answer; a second one is not sent.
    """

    def __init__(self, query: zenoh.Query, key: str, allowed: tuple[str, ...]) -> None:
        """``allowed`` are the names of the parameters that it may have beside ``format``."""
        self._query = query
        self._key = key
        self._allowed = allowed
        self._as_json = False
        self.open = True
        """Whether it still waits for its answer."""

    def request(self) -> Request:
        """Return what is asked. Raises BadPayloadError for a parameter that nobody would read."""
        query, parameters = self._query, parameters_of(self._query)
        self._as_json = wants_json(parameters.pop("format", "msgpack"))
        check_parameters(parameters, self._allowed)
        payload = b"" if query.payload is None else query.payload.to_bytes()
        return Request(parameters, payload, "" if query.encoding is None else str(query.encoding))

    def reply(self, message: Message) -> None:
        """Answer with a message."""
        if self.open:
            body = self._body(message)
            with self._last():
                self._query.reply(self._key, body, encoding=self._encoding(type(message)), express=True)

    def refuse(self, error: TreenailError) -> None:
        """Answer with why not."""
        if self.open:
            body = self._body(Refusal(reason=_reason(error), message=one_line(str(error), 1000)))
            with self._last():
                self._query.reply_err(body, encoding=self._encoding(Refusal))

    def _last(self) -> zenoh.Query:
        """Return the query as a context at whose end it is final."""
        self.open = False
        return self._query

    def _body(self, message: Message) -> bytes:
        return encode_json(message) if self._as_json else encode(message)

    def _encoding(self, kind: type[Message]) -> str:
        return "application/json" if self._as_json else encoding_of(kind)


def answer_in(reply: zenoh.Reply, kind: type[M]) -> M | Refusal | None:
    """Return the message in a reply, or why it was refused; None for an error of Zenoh's own, such as a time-out.

    Raises ContractError for what does not follow the contract.
    """
    if reply.ok is not None:
        return decode(kind, reply.ok.payload.to_bytes(), str(reply.ok.encoding))
    if reply.err is not None and str(reply.err.encoding) == encoding_of(Refusal):
        return decode(Refusal, reply.err.payload.to_bytes(), encoding_of(Refusal))
    return None


def to_first(
    kind: type[M],
    then: Callable[[M | Refusal | None], None],
    post: Callable[[Callable[..., None], object], None],
) -> Callback[zenoh.Reply]:
    """Return where a query's replies go: ``then`` gets the first, by way of ``post``, or None without a good one.

    ``post`` is given a function and what to call it with, on Zenoh's thread, and calls it on another.
    """
    replies: list[zenoh.Reply] = []

    def take(reply: zenoh.Reply) -> None:
        try:
            answer = answer_in(reply, kind)
        except TreenailError:
            then(None)
            raise
        then(answer)

    def on_reply(reply: zenoh.Reply) -> None:
        replies.append(reply)
        if len(replies) == 1:
            post(take, reply)

    def on_end() -> None:
        if not replies:  # else the loop knows already, and need not be woken once more
            post(then, None)

    return Callback(on_reply, on_end, indirect=False)


def state_number(text: str) -> int:
    """Return the state in a query's ``state`` parameter. Raises BadPayloadError."""
    if not (text.isascii() and text.isdigit() and len(text) < 7):
        raise BadPayloadError(f"state: expected a state number from 0 to 999999, as in ?state=7, got {text[:20]!r}")
    return int(text)


def ft_vector(text: str) -> tuple[Force, Torque]:
    """Return force [N] and torque [N m] in a query's ``ft`` parameter. Raises BadPayloadError.

    It is six numbers from -1e5 to 1e5 with commas between, not all of them 0.
    """
    try:
        fx, fy, fz, tx, ty, tz = vector = numbers(text, 6)
    except ValueError as error:
        expected = "ft: expected six numbers fx,fy,fz,tx,ty,tz [N, N m], as in ?ft=0.2,0,-1.5,0,0.02,0"
        raise BadPayloadError(f"{expected}; {error}") from None
    if max(map(abs, vector)) > LARGEST_COMPONENT:
        raise BadPayloadError(f"ft: expected numbers from -1e5 to 1e5, got {text[:100]!r}")
    if math.hypot(fx, fy, fz, tx, ty, tz) == 0.0:
        raise BadPayloadError("ft: expected a vector with a direction, got six zeros")
    return (fx, fy, fz), (tx, ty, tz)


def parameters_of(query: zenoh.Query) -> dict[str, str]:
    """Return the parameters after the ``?`` of a query's selector."""
    return parameters_in(str(query.parameters))


def parameters_in(text: str) -> dict[str, str]:
    """Return the parameters in what stands after a selector's ``?``; of one given twice, the last."""
    pairs = (part.partition("=") for part in text.split(";") if part)
    return {name: value for name, _, value in pairs}


def wants_json(form: str) -> bool:
    """Return whether a query's ``format`` parameter asks for JSON. Raises BadPayloadError for an unknown form."""
    if form not in ("json", "msgpack"):
        raise BadPayloadError(f"format: expected json or msgpack, got {form[:20]!r}")
    return form == "json"


def check_parameters(parameters: Mapping[str, str], allowed: tuple[str, ...]) -> None:
    """Raise BadPayloadError for a parameter that nobody would read; names with ``_`` in front are Zenoh's own."""
    for name in parameters:
        if name not in allowed and not name.startswith("_"):
            expected = ", ".join((*allowed, "format"))
            raise BadPayloadError(f"parameter: expected one of {expected}, got {name[:20]!r}")


def _reason(error: TreenailError) -> Reason:
    """Return the stable reason of a Refusal: an error's own, or the one of its kind."""
    return error.reason if isinstance(error, RefusedError) else "bad_request"
