"""A client's view of a cell: ask a key, list who is alive. Nothing here is more than any Zenoh client could do."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from types import TracebackType
from typing import TypeVar

import zenoh
from zenoh.handlers import Callback

from services.bus import command
from services.bus.answers import answer_in
from services.bus.knock import nobody_listens
from services.bus.rights import Rights
from services.bus.service import Options
from services.bus.session import brief, come_after, open_client
from services.wire.codec import decode, decode_json, encode, encoding_of
from services.wire.errors import CellError, ContractError, NoAnswerError, RefusedError, WrongVersionError
from services.wire.keys import ALIVE, ROOT, STORED, Keys, wild
from services.wire.messages import Message, Refusal
from services.wire.text import one_line

M = TypeVar("M", bound=Message)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that say which cell to ask, and where."""
    command.add_arguments(parser, None)


def client_of(arguments: argparse.Namespace) -> Client:
    """Return a client of the cell that parsed arguments name.

    Raises CellError when there is no router: at once where nobody listens, unless a time to wait was given.
    """
    at_once = arguments.connect_timeout is None
    options = command.options(arguments)
    if at_once and all(nobody_listens(endpoint) for endpoint in options.connect):
        where = ", ".join(options.connect)
        raise CellError(f"nobody listens on {where}; start a cell with `treenail up sim`, or say --connect ENDPOINT")
    return Client(options)


class Client:
    """A session in a cell. Use as a context manager."""

    def __init__(self, options: Options) -> None:
        self.keys = Keys(options.cell)
        self.session = open_client(options.connect, options.connect_timeout_s, certs=options.certs)
        self.rights = Rights(self.session, options.certs)
        self._declared: list[object] = []

    def __enter__(self) -> Client:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.session.close()  # type: ignore[no-untyped-call]

    def ask(self, name: str, kind: type[M], timeout_s: float = 2.0) -> M:
        """Return the one good answer to a query. Raises NoAnswerError, RefusedError or ContractError."""
        found = self.ask_all(name, kind, timeout_s)
        if len(found) != 1:
            raise (
                self.no_answer(name)
                if not found
                else NoAnswerError(f"{self.keys.of(name)}: expected one answer, got {len(found)}")
            )
        return found[0]

    def request(self, name: str, request: Message, kind: type[M], timeout_s: float) -> M:
        """Return the answer to a query with a request in it.

        Raises NotAllowedError, NoAnswerError, RefusedError, which has the reason of the Refusal, or ContractError.
        """
        self.rights.need("ask", name)
        replies = self.session.get(
            self.keys.of(name), timeout=timeout_s, payload=encode(request), encoding=encoding_of(type(request))
        )
        for reply in replies:
            answer = answer_in(reply, kind)
            if isinstance(answer, Refusal):
                refused = RefusedError(f"{self.keys.of(name)}: refused ({answer.reason}): {answer.message}")
                refused.reason = answer.reason
                raise refused
            if answer is not None:
                return answer
        raise self.no_answer(name)

    def ask_all(self, name: str, kind: type[M], timeout_s: float = 2.0) -> list[M]:
        """Return all good answers to a query, in the order of their keys. Raises RefusedError or ContractError."""
        samples, refusals = self.replies(name, timeout_s)
        if refusals:
            raise RefusedError(f"{self.keys.of(name)}: {refusals[0]}")
        return [self.message(sample, kind) for sample in samples]

    def message(self, sample: zenoh.Sample, kind: type[M]) -> M:
        """Return the message in an answer. Raises ContractError, which names the key."""
        try:
            return decode(kind, sample.payload.to_bytes(), str(sample.encoding))
        except WrongVersionError as error:
            raise WrongVersionError(
                f"{sample.key_expr}: {error}: that service has another contract than this command; see treenail status"
            ) from None
        except ContractError as error:
            raise type(error)(f"{sample.key_expr}: {error}") from None

    def ask_json(self, name: str, timeout_s: float = 5.0) -> tuple[dict[str, object], list[str]]:
        """Return the answers to a query as JSON values by key, and what was refused, in words."""
        samples, refusals = self.replies(f"{name}{';' if '?' in name else '?'}format=json", timeout_s)
        return {str(sample.key_expr): _json(sample) for sample in samples}, refusals

    def ask_one_json(self, name: str) -> object:
        """Return the one good answer to a query as a JSON value. Raises NoAnswerError or RefusedError."""
        answers, refusals = self.ask_json(name)
        if refusals:
            raise RefusedError(f"{self.keys.of(name)}: {refusals[0]}")
        if not answers:
            raise self.no_answer(name)
        return next(iter(answers.values()))

    def no_answer(self, name: str) -> NoAnswerError:
        """Return what to say when nobody answered a query: who is there instead."""
        here = self.alive()
        if "store" in here and any(name.startswith(stored.removesuffix("**")) for stored in STORED):
            return NoAnswerError(f"{self.keys.of(name)}: the store has nothing there")
        if here:
            return NoAnswerError(f"{self.keys.of(name)}: nobody answered; alive in this cell: {', '.join(here)}")
        return self.nobody()

    def nobody(self) -> NoAnswerError:
        """Return what to say when nobody is alive in the cell: which cells there are."""
        cells = self.cells()
        there = f"cells here: {', '.join(cells)}" if cells else "nor in any other cell of this router"
        return NoAnswerError(f"cell {self.keys.cell!r}: nobody is alive; {there}")

    def cells(self) -> list[str]:
        """Return the cells in which a service has said that it is alive."""
        replies = self.session.liveliness().get(f"{ROOT}/*/{wild(ALIVE)}", timeout=2.0)
        return sorted({str(reply.ok.key_expr).split("/")[1] for reply in replies if reply.ok is not None})

    def alive(self) -> list[str]:
        """Return the services that have said that they are alive."""
        replies = self.session.liveliness().get(self.keys.alive("*"), timeout=2.0)
        return sorted(str(reply.ok.key_expr).rpartition("/")[2] for reply in replies if reply.ok is not None)

    def subscribe(self, name: str, kind: type[M], handler: Callable[[M], None]) -> None:
        """Call ``handler``, on Zenoh's thread, with each good message on a key."""

        def take(sample: zenoh.Sample) -> None:
            try:
                handler(decode(kind, sample.payload.to_bytes(), str(sample.encoding)))
            except ContractError:
                return  # somebody else's garbage; the services count it

        callback: Callback[zenoh.Sample] = Callback(take, indirect=False)
        self._declared.append(self.session.declare_subscriber(self.keys.of(name), callback))

    def replies(self, name: str, timeout_s: float) -> tuple[list[zenoh.Sample], list[str]]:
        """Return the good answers to a query in the order of their keys, and in words what was refused or too slow.

        Raises RefusedError for what is no key expression, NotAllowedError for what the router would keep from us.
        """
        found: list[zenoh.Sample] = []
        refusals: list[str] = []
        try:
            # What has come when a service that hangs makes the query time out shall not be lost with it.
            replies = self.session.get(
                self.keys.of(name), timeout=timeout_s, consolidation=zenoh.ConsolidationMode.NONE
            )
        except zenoh.ZError as error:
            raise RefusedError(f"key: expected a key expression of Zenoh's, got {name!r}: {brief(error)}") from None
        for reply in replies:
            if reply.ok is not None:
                found.append(reply.ok)
            elif reply.err is not None:
                refusals.append(_refusal(reply.err, timeout_s))
        if not found and not refusals:
            self.rights.need("ask", name)
        come_after(self.session, found)
        return sorted(found, key=lambda sample: str(sample.key_expr)), refusals


def _refusal(error: zenoh.ReplyError, timeout_s: float) -> str:
    """Return in words what an error reply says."""
    payload, encoding = error.payload.to_bytes(), str(error.encoding)
    if encoding in ("application/json", encoding_of(Refusal)):
        try:
            as_json = encoding == "application/json"
            refusal = decode_json(Refusal, payload) if as_json else decode(Refusal, payload, encoding)
        except ContractError as unreadable:
            return f"refused, but not in the words of the contract: {unreadable}"
        return f"refused ({refusal.reason}): {one_line(refusal.message, 1000)}"
    text = one_line(payload[:200].decode(errors="replace"))
    return f"expected an answer within {timeout_s:g} s, got none" if text == "Timeout" else text


def _json(sample: zenoh.Sample) -> object:
    """Return an answer's JSON value. Raises ContractError for an answer in another form."""
    if str(sample.encoding) != "application/json":
        raise ContractError(f"{sample.key_expr}: expected JSON, got encoding {str(sample.encoding)[:100]!r}")
    try:
        return json.loads(sample.payload.to_bytes())
    except (ValueError, RecursionError) as error:
        raise ContractError(f"{sample.key_expr}: expected JSON, got something else: {error}") from None
