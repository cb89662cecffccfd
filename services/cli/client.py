"""A client's view of a cell: ask a key, list who is alive. Nothing here is more than any Zenoh client could do."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from types import TracebackType
from typing import TypeVar

import zenoh
from zenoh.handlers import Callback

from services.wire import command
from services.wire.codec import decode
from services.wire.errors import ContractError, NoAnswerError, RefusedError
from services.wire.keys import Keys
from services.wire.messages import Message
from services.wire.service import Options
from services.wire.session import open_client

M = TypeVar("M", bound=Message)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that say which cell to ask, and where."""
    command.add_arguments(parser, connect_timeout_s=5.0)


def client_of(arguments: argparse.Namespace) -> Client:
    """Return a client of the cell that parsed arguments name. Raises CellError when there is no router."""
    return Client(command.options(arguments))


class Client:
    """A session in a cell. Use as a context manager."""

    def __init__(self, options: Options) -> None:
        self.keys = Keys(options.cell)
        self.session = open_client(options.connect, options.connect_timeout_s, certs=options.certs)
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
            raise NoAnswerError(f"{self.keys.of(name)}: expected one answer, got {len(found)}")
        return found[0]

    def ask_all(self, name: str, kind: type[M], timeout_s: float = 2.0) -> list[M]:
        """Return all good answers to a query, in the order of their keys."""
        samples = self._samples(name, timeout_s)
        return [decode(kind, sample.payload.to_bytes(), str(sample.encoding)) for sample in samples]

    def ask_json(self, name: str, timeout_s: float = 5.0) -> dict[str, object]:
        """Return the answers to a query as JSON values, by key."""
        form = f"{name}{';' if '?' in name else '?'}format=json"
        return {
            str(sample.key_expr): json.loads(sample.payload.to_bytes()) for sample in self._samples(form, timeout_s)
        }

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

    def _samples(self, name: str, timeout_s: float) -> list[zenoh.Sample]:
        found: list[zenoh.Sample] = []
        try:
            replies = self.session.get(self.keys.of(name), timeout=timeout_s)
        except zenoh.ZError as error:
            raise RefusedError(f"key: expected a key expression of Zenoh's, got {name!r}: {error}") from None
        for reply in replies:
            if reply.ok is not None:
                found.append(reply.ok)
            elif reply.err is not None:
                raise RefusedError(f"{self.keys.of(name)}: {reply.err.payload.to_bytes().decode(errors='replace')}")
        return sorted(found, key=lambda sample: str(sample.key_expr))
