"""What campaigns have found, one by one, so that it stays settled."""

from __future__ import annotations

import struct
import warnings
from typing import Any

import msgpack
import msgspec
import pytest

from experiments.fuzz.sound import DEFINITION, RUN, small_run
from services.classifier.fold import ClassifierFold
from services.viewer.record import Recorder
from services.wire import codec
from services.wire.definition import Limits
from services.wire.definition_file import find, parse
from services.wire.errors import BadPayloadError, DefinitionError
from services.wire.messages import MESSAGES, Experiment, Message, QTable, RunRecord, Skill, State

SMALL = small_run()


def sound(kind: type[Message]) -> Any:
    """Return a sound message of a type."""
    return next(message for message in SMALL.messages if type(message) is kind)


@pytest.mark.parametrize("name", ["x\ny", "\x1b[31m", "n" * 60_000])
def test_a_name_that_somebody_made_up_does_not_break_the_line_of_an_error(name: str) -> None:
    with pytest.raises(BadPayloadError) as error:
        codec.decode_payload(State, msgpack.packb({name: 1}))
    assert str(error.value).isprintable()
    assert len(str(error.value)) < 400


@pytest.mark.parametrize("kind", MESSAGES, ids=lambda kind: kind.__name__)
def test_what_no_message_of_its_type_can_need_is_refused_unread(kind: type[Message]) -> None:
    payload = b"\x80" + b"\0" * kind.LARGEST_BYTES
    with pytest.raises(BadPayloadError, match=f"expected at most {kind.LARGEST_BYTES} bytes, got {len(payload)}"):
        codec.decode_payload(kind, payload)


@pytest.mark.parametrize("kind", [Experiment, RunRecord, Skill])
def test_a_definition_that_contradicts_itself_is_refused_before_a_worker_has_it(kind: type[Message]) -> None:
    limits = Limits(contact_force_n=20.0)
    definition = msgspec.structs.replace(DEFINITION, limits=limits)
    payload = codec.encode(msgspec.structs.replace(sound(kind), definition=definition))
    with pytest.raises(BadPayloadError, match=r"definition: limits\.contact_force_n: expected less than"):
        codec.decode_payload(kind, payload)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("name = " + "[\n" * 5000, "nested too deeply"),
        ("episodes = 0x" + "f" * 900, "episodes: "),
        ("episodes = " + "_".join(["1" * 900] * 6), "expected lines of at most"),
        ('name = "mine"\n"a\\nb" = 1', "unknown key"),
        ("a." * 600 + "b = 1", "expected lines of at most"),
        ("#" * 70_000, "expected lines of at most"),
    ],
)
def test_a_file_that_is_no_definition_is_refused_in_one_line(text: str, complaint: str) -> None:
    with pytest.raises(DefinitionError, match=complaint) as error:
        parse(text.encode(), "mine.toml")
    assert str(error.value).isprintable()


@pytest.mark.parametrize("value", ["9" * 990, "[" * 980, "1\n2", '"\\u0000"'])
def test_an_override_that_cannot_be_read_is_refused_in_one_line(value: str) -> None:
    with pytest.raises(DefinitionError) as error:
        parse(b'name = "mine"', "mine.toml", [f"start.x_mm={value}"])
    assert str(error.value).isprintable()


def test_a_name_that_is_too_long_for_a_file_is_no_file() -> None:
    with pytest.raises(DefinitionError, match="which is neither"):
        find("x" * 5000)


def test_weights_whose_squares_overflow_are_refused_without_a_warning() -> None:
    memory = SMALL.classifier.snapshot()
    weights = memory["weights"]
    assert isinstance(weights, bytes)
    huge = struct.pack("<d", 1e200) + weights[8:]
    with warnings.catch_warnings(), pytest.raises(ValueError, match="norms"):
        warnings.simplefilter("error")
        ClassifierFold(DEFINITION, RUN).restore({**memory, "weights": huge})


@pytest.mark.parametrize(
    "changes",
    [
        {"q": ((0.0,) * 9, (0.0,) * 8)},
        {"q": ((0.0,) * 9,)},
        {"visits": ((0,) * 9, ())},
        {"best_action": (0,)},
        {"best_action": (0, 9)},
        {"actions": ("+X",)},
    ],
)
def test_a_table_without_a_shape_is_not_shown(changes: dict[str, object]) -> None:
    table = sound(QTable)
    assert Recorder().table(table, 0) is not None
    with pytest.raises(BadPayloadError, match="QTable: expected "):
        Recorder().table(msgspec.structs.replace(table, **changes), 0)
