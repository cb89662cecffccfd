"""A tap: a process between one service and its cell that loses, delays, repeats and reorders what goes through it.

The service stands alone at a router of its own, the rest of the cell at another, and the tap is a client of both. It
passes on what the contract lets cross: messages with the Zenoh timestamp of their sender, queries with their answers,
and who is alive. It is told what to do by lines of JSON on its standard input, answers each with what it has done so
far, and ends with the input.
"""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable
from dataclasses import fields
from typing import NamedTuple

import zenoh
from zenoh.handlers import Callback

from experiments.chaos.line import Faults, Line
from services.bus.command import run
from services.bus.session import open_client
from services.rules.command_line import Parser, whole
from services.wire import keys as names
from services.wire.keys import Keys
from services.wire.randomness import MAX_SEED

PROGRAM = "treenail chaos tap"
QUERY_WITHIN_S = 30.0


class Crossing(NamedTuple):
    """What crosses between one service and the rest of its cell, as names or key expressions under the cell."""

    hears: tuple[str, ...]
    says: tuple[str, ...]
    asks: tuple[str, ...]
    answers: tuple[str, ...]


_WORKER_ASKS = (names.EXPERIMENT, names.TASK_STEPS, *names.STORED)
_ALIVE = names.name_of(names.HEARTBEAT, service="task")
CROSSINGS = {
    "agent": Crossing(
        (names.STATE, names.REWARD, _ALIVE),
        (
            names.ACTION,
            names.wild(names.CHECKPOINT),
            names.wild(names.NEWEST_CHECKPOINT),
            names.name_of(names.HEARTBEAT, service="agent"),
        ),
        (*_WORKER_ASKS, names.CLASSIFY),
        ("agent/*", names.name_of(names.ALIVE, service="agent")),
    ),
    "classifier": Crossing(
        (names.OBSERVATION, _ALIVE),
        (
            names.STATE,
            names.wild(names.CHECKPOINT),
            names.wild(names.NEWEST_CHECKPOINT),
            names.name_of(names.HEARTBEAT, service="classifier"),
        ),
        _WORKER_ASKS,
        ("classifier/*", names.name_of(names.ALIVE, service="classifier")),
    ),
    "sim": Crossing(
        (),
        (names.FT, names.TRUTH, names.name_of(names.HEARTBEAT, service="sim")),
        (names.EXPERIMENT,),
        (names.MOVE, names.HOME, names.name_of(names.ALIVE, service="sim")),
    ),
}


class Side:
    """The session at one of the two routers, and what is passed on from there to the other one."""

    def __init__(self, name: str, session: zenoh.Session, keys: Keys, line: Line) -> None:
        self.name = name
        self.session = session
        self._keys = keys
        self._line = line
        self._declared: list[object] = []
        self._tokens: dict[str, zenoh.LivelinessToken] = {}

    def close(self) -> None:
        """Leave the router."""
        self.session.close()  # type: ignore[no-untyped-call]

    def pass_messages(self, name: str, other: Side) -> None:
        """Publish on the other side what comes here under a name; what came from there is left alone."""

        def take(sample: zenoh.Sample) -> None:
            self._line.post(lambda: self._line.message(other.name, lambda: other.put(sample)))

        callback: Callback[zenoh.Sample] = Callback(take, indirect=False)
        self._declared.append(
            self.session.declare_subscriber(self._keys.of(name), callback, allowed_origin=zenoh.Locality.REMOTE)
        )

    def put(self, sample: zenoh.Sample) -> None:
        """Publish what came from the other side; the timestamp still says who sent it, and when."""
        self.session.put(
            sample.key_expr,
            sample.payload,
            encoding=sample.encoding,
            timestamp=sample.timestamp,
            congestion_control=zenoh.CongestionControl.BLOCK,
            express=True,
        )

    def pass_queries(self, name: str, other: Side) -> None:
        """Ask the other side what is asked here under a name."""

        def take(query: zenoh.Query) -> None:
            self._line.post(lambda: other.ask(query))

        callback: Callback[zenoh.Query] = Callback(take, indirect=False)
        self._declared.append(
            self.session.declare_queryable(self._keys.of(name), callback, allowed_origin=zenoh.Locality.REMOTE)
        )

    def ask(self, query: zenoh.Query) -> None:
        """Ask what was asked on the other side, and pass the answers on; the query ends when they do."""
        post = self._line.post

        def take(reply: zenoh.Reply) -> None:
            post(lambda: _answer(query, reply))

        callback: Callback[zenoh.Reply] = Callback(take, lambda: post(query.drop), indirect=False)
        self.session.get(
            query.selector,
            callback,
            consolidation=zenoh.ConsolidationMode.NONE,
            timeout=QUERY_WITHIN_S,
            payload=query.payload,
            encoding=query.encoding,
            express=True,
        )

    def pass_tokens(self, name: str, ours: Callable[[str], bool], other: Side) -> None:
        """Declare on the other side who is alive here, for the services that stand here."""

        def take(sample: zenoh.Sample) -> None:
            if ours(str(sample.key_expr).split("/")[3]):
                self._line.post(lambda: other.declare(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT))

        callback: Callback[zenoh.Sample] = Callback(take, indirect=False)
        self._declared.append(self.session.liveliness().declare_subscriber(self._keys.of(name), callback, history=True))

    def declare(self, key: str, alive: bool) -> None:
        """Declare a token of the other side here, or take it back."""
        token = self._tokens.pop(key, None)
        if token is not None:
            token.undeclare()  # type: ignore[no-untyped-call]
        if alive:
            self._tokens[key] = self.session.liveliness().declare_token(key)


def _answer(query: zenoh.Query, reply: zenoh.Reply) -> None:
    if reply.ok is not None:
        sample = reply.ok
        query.reply(sample.key_expr, sample.payload, encoding=sample.encoding, timestamp=sample.timestamp, express=True)
    elif reply.err is not None:
        query.reply_err(reply.err.payload, encoding=reply.err.encoding)


def connect(near: Side, far: Side, service: str) -> None:
    """Let the contract cross between the cell and the service on the far side."""
    crossing = CROSSINGS[service]
    for name in (names.wild(names.CLAIM), names.wild(names.ALIVE)):
        near.pass_tokens(name, lambda other: other != service, far)
        far.pass_tokens(name, lambda other: other == service, near)
    for name in crossing.asks:
        far.pass_queries(name, near)
    for name in crossing.answers:
        near.pass_queries(name, far)
    for name in crossing.hears:
        near.pass_messages(name, far)
    for name in crossing.says:
        far.pass_messages(name, near)


def _obey(line: Line) -> None:
    """Do what standard input says until it ends."""
    fault_names = {field.name for field in fields(Faults)}
    for text in sys.stdin:
        told = json.loads(text)
        line.faults = Faults(**{name: float(told[name]) for name in fault_names & set(told)})
        print(json.dumps(line.counts), flush=True)
    line.stopping = True
    line.post(lambda: None)


def main() -> None:
    """Parse the command line and pass on until the input ends."""
    parser = Parser(prog=PROGRAM, description=__doc__)
    for option in ("--near", "--far"):
        parser.add_argument(option, required=True, metavar="ENDPOINT", help="Zenoh endpoint of a router")
    parser.add_argument("--service", required=True, choices=sorted(CROSSINGS), help="who stands on the far side")
    parser.add_argument("--cell", default="a", help="name of the cell")
    parser.add_argument("--seed", type=whole(0, MAX_SEED), default=0, help="of which message something happens to")
    arguments = parser.parse_args()
    line, keys = Line(arguments.seed), Keys(arguments.cell)
    near = Side("near", open_client([arguments.near]), keys, line)
    far = Side("far", open_client([arguments.far]), keys, line)
    connect(near, far, arguments.service)
    threading.Thread(target=_obey, args=(line,), daemon=True).start()
    try:
        line.work()
    finally:
        near.close()
        far.close()


if __name__ == "__main__":
    run("chaos tap", main)
