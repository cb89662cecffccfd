"""What a hostile input may cost: memory and steps in proportion to its size, counted, not timed."""

from __future__ import annotations

import sys
import tracemalloc
from collections.abc import Callable
from types import FrameType
from typing import Any

import pytest

from experiments.fuzz.campaign import all_targets
from experiments.fuzz.target import outcome
from services.wire import codec
from services.wire.errors import BadPayloadError
from services.wire.messages import MESSAGES

TARGETS = {target.name: target for target in all_targets()}
SIZE = 300_000

GREEDY: dict[str, Callable[[int], bytes]] = {
    "empty lists": lambda size: b"\x81\xa1x\xdd" + size.to_bytes(4, "big") + b"\x90" * size,
    "empty maps": lambda size: b"\x81\xa3run\xdd" + size.to_bytes(4, "big") + b"\x80" * size,
    "small numbers": lambda size: b"\x81\xa5steps\xdd" + size.to_bytes(4, "big") + b"\x01" * size,
    "names": lambda size: b"\xdf" + (size // 4).to_bytes(4, "big") + b"\xa2ab\x01" * (size // 4),
    "one name over and over": lambda size: b"\xdf" + (size // 6).to_bytes(4, "big") + b"\xa3run\xa1r" * (size // 6),
    "a name": lambda size: b"\x81\xdb" + size.to_bytes(4, "big") + b"n" * size + b"\xc0",
    "lists in lists": lambda size: b"\x91" * size,
    "lists that claim to be full": lambda size: b"\x81\xa1q" + (b"\xdd" + size.to_bytes(4, "big")) * (size // 5),
    "rows": lambda size: b"\x81\xa1q\xdd" + (size // 2).to_bytes(4, "big") + b"\x91\x01" * (size // 2),
    "a block": lambda size: b"\x81\xa8snapshot\x81\xa1q\xc6" + size.to_bytes(4, "big") + b"\0" * size,
}


@pytest.mark.parametrize("greedy", GREEDY)
def test_a_payload_takes_room_in_proportion_to_its_size(greedy: str) -> None:
    """Without a type to hold against them, lists that are empty take 64 times the room of their bytes."""
    payload = GREEDY[greedy](SIZE)
    for kind in MESSAGES:
        tracemalloc.start()
        try:
            with pytest.raises(BadPayloadError):
                codec.decode_payload(kind, payload)
            _, most = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
        assert most < (50 * SIZE if SIZE < kind.LARGEST_BYTES else SIZE), kind.__name__


def steps(act: Callable[[], object]) -> int:
    """Return how many lines of Python are executed in a call."""
    count = 0

    def trace(_frame: FrameType, event: str, _argument: object) -> Any:
        nonlocal count
        count += event == "line"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        act()
    finally:
        sys.settrace(before)
    return count


SLOW: dict[str, tuple[str, Callable[[int], Any]]] = {
    "dotted keys": ("definition file", lambda n: b"".join(b"k%d%s = 1\n" % (i, b".a" * 480) for i in range(n // 1000))),
    "one dotted key": ("definition file", lambda n: b"k" + b".a" * (n // 2) + b" = 1\n"),
    "dotted tables": ("definition file", lambda n: b"".join(b"[k%d%s]\n" % (i, b".a" * 480) for i in range(n // 1000))),
    "unknown keys": ("definition file", lambda n: b"".join(b"key%d = 1\n" % i for i in range(n // 10))),
    "lists in lists in a file": ("definition file", lambda n: b"name = " + b"[\n" * (n // 2)),
    "tables": ("definition file", lambda n: b"[[start]]\n" * (n // 10)),
    "a long string": ("definition file", lambda n: b'name = """' + b"\\n\\\\\n" * (n // 5) + b'"""'),
    "a long number": ("definition file", lambda n: b"episodes = 1" + b"_0" * (n // 2)),
    "comments": ("definition file", lambda n: b"#\n" * (n // 2)),
    "a long override": ("override", lambda n: ["start." + "a." * (n // 2) + "b=1"]),
    "an override of lists": ("override", lambda n: ["name=" + "[" * n]),
    "many overrides": ("override", lambda n: [f"start.k{i}=1" for i in range(n // 12)]),
    "many parameters": ("selector", lambda n: ";".join(f"k{i}=v" for i in range(n // 6))),
    "semicolons": ("selector", lambda n: ";" * n),
    "a vector of many": ("selector", lambda n: "ft=" + "1," * (n // 2)),
    "a long state": ("selector", lambda n: "state=" + "7" * n),
    "a long skill": ("skill file", lambda n: TARGETS["skill file"].seeds[0] + b"\0" * n),
    "no skill": ("skill file", lambda n: b"treenail skill 1\n" * (n // 17)),
    "many memories": ("agent memory", lambda n: {f"k{i}": i for i in range(n // 5)}),
    "many blocks": ("classifier memory", lambda n: {f"k{i}": b"\0" for i in range(n // 5)}),
    "nested JSON": ("JSON definition", lambda n: '{"a":' * (n // 5)),
}


@pytest.mark.parametrize("slow", SLOW)
def test_a_reader_takes_steps_in_proportion_to_the_size(slow: str) -> None:
    """The square of the size would be some thousand steps a byte here."""
    name, make = SLOW[slow]
    target, size = TARGETS[name], 16_000
    given = make(size)
    assert steps(lambda: outcome(target, given)) < 50 * size
