"""What the viewer makes of messages that are well-formed and make no sense: it lets anybody speak, and must not end."""

from __future__ import annotations

from contextlib import suppress
from random import Random

from experiments.fuzz.mutate import mutate_payload, mutate_tree, pack
from experiments.fuzz.sound import SmallRun
from experiments.fuzz.target import Input, Target
from services.viewer.record import Recorder
from services.wire import codec
from services.wire.errors import BadPayloadError
from services.wire.messages import (
    Action,
    EpisodeSummary,
    Experiment,
    FtPacket,
    Message,
    QTable,
    Reward,
    State,
    Truth,
)

_SHOWN: tuple[type[Message], ...] = (FtPacket, State, Action, Reward, EpisodeSummary, Truth, Experiment, QTable, QTable)
_END_NS = 200_000_000


def targets(run: SmallRun) -> list[Target]:
    """Return the viewer's recorder, fed with what a run is made into."""

    def make(rng: Random) -> Input:
        kinds = [rng.choice(_SHOWN) for _ in range(3)]
        return [(kind, _payload(rng, run, kind)) for kind in kinds]

    return [Target("viewer's recorder", make, _record, (BadPayloadError,))]


def _payload(rng: Random, run: SmallRun, kind: type[Message]) -> bytes:
    """Return a payload that most often fits its type, or no more would come to the recorder than a refusal."""
    if rng.random() < 0.3:
        return mutate_payload(rng, run.trees[kind])
    for _ in range(8):
        payload = pack(mutate_tree(rng, rng.choice(run.trees[kind])))
        with suppress(BadPayloadError):
            codec.decode_payload(kind, payload)
            return payload
    return payload


def _record(given: Input) -> str | None:
    recorder, refused = Recorder(), None
    for kind, payload in given:
        try:
            _take(recorder, codec.decode_payload(kind, payload))
        except BadPayloadError as error:
            refused = type(error).__name__
    recorder.flush(0, _END_NS)
    recorder.whole_run(_END_NS)
    return refused


def _take(recorder: Recorder, message: Message) -> None:
    match message:
        case FtPacket():
            recorder.ft(message)
        case State():
            recorder.state(message)
        case Action():
            recorder.action(message)
        case Reward():
            recorder.reward(message)
        case EpisodeSummary():
            recorder.episode(message)
        case Truth():
            recorder.truth(message)
        case Experiment():
            recorder.experiment(message)
        case QTable():
            recorder.table(message, _END_NS)
