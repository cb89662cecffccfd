"""What is fuzzed: a maker of hostile inputs and the reader that has to take or refuse each of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from random import Random
from typing import Any, TypeAlias

from services.wire.errors import TreenailError

Input: TypeAlias = Any
"""Whatever one reader reads: bytes, text, a map, or several of these."""

MOST_ERROR_CHARACTERS = 1500


class BrokenPromiseError(Exception):
    """A reader took an input, or refused it, in another way than it promises."""


@dataclass(frozen=True)
class Target:
    """One reader under test."""

    name: str
    make: Callable[[Random], Input]
    """Returns a hostile input, a function of the generator alone."""
    read: Callable[[Input], str | None]
    """Returns for an input that is taken, perhaps a word for how; raises one of ``refusals``, or BrokenPromiseError."""
    refusals: tuple[type[Exception], ...]
    """What the reader documents that it raises. Anything else is a finding."""
    of_bytes: Callable[[bytes], Input] | None = None
    """Returns the input that some bytes stand for, for a fuzzer that makes bytes; None where there is no such."""
    seeds: Sequence[bytes] = ()
    """Bytes of sound inputs, for that fuzzer to begin with."""


def promise(holds: bool, what: str) -> None:
    """Raise BrokenPromiseError when something promised does not hold."""
    if not holds:
        raise BrokenPromiseError(what)


def outcome(target: Target, given: Input) -> str:
    """Read one input and return "taken" or the name of the refusal. Lets everything else through.

    An error of ours is shown to people as it is, and so has to be one line that says something.
    """
    try:
        return target.read(given) or "taken"
    except target.refusals as error:
        text = str(error) if isinstance(error, TreenailError) else "a word between modules"
        promise(bool(text), f"an error without a word: {type(error).__name__}")
        promise(text.isprintable(), f"an error that is not one printable line: {text[:300]!r}")
        promise(len(text) <= MOST_ERROR_CHARACTERS, f"an error of {len(text)} characters: {text[:300]!r}")
        return type(error).__name__
