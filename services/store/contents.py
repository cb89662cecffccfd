"""What may be stored under the keys that workers load their memory from: nothing that would not load."""

from __future__ import annotations

from services.rules.skill import decode as decode_skill
from services.wire.codec import decode
from services.wire.errors import BadPayloadError
from services.wire.keys import CHOSEN_SKILL, CONTRACT, LATEST, SKILL, STORED, Named, named
from services.wire.messages import Checkpoint, JournalEpisode, RunRecord, Swaps
from services.wire.text import one_line


def key_of_stored(name: str) -> Named | None:
    """Return which of the contract's keys that the store keeps a name is; None for any other."""
    key = named(name)
    in_store = key is not None and any(key.pattern.startswith(prefix.removesuffix("**")) for prefix in STORED)
    return key if in_store else None


def check(name: str, payload: bytes, encoding: str) -> Named:
    """Check a value against its key in the cell, and return which key of the contract that is.

    Raises ContractError: a key that the contract does not have, the wrong type, a payload that does not decode, or one
    that belongs to another key.
    """
    key = key_of_stored(name)
    if key is None:
        raise BadPayloadError(f"{one_line(name)}: expected a key that the contract has the store keep, got another")
    if key.pattern in (SKILL, CHOSEN_SKILL):
        _same(name, key.parts.get("sha256", LATEST), decode_skill(payload, encoding).sha256)
        return key
    (kind,) = CONTRACT[key.pattern].types
    message = decode(kind, payload, encoding)
    assert isinstance(message, RunRecord | Swaps | JournalEpisode | Checkpoint)
    _same(name, key.parts["run"], message.run)
    if isinstance(message, Checkpoint):
        _same(name, key.parts["service"], message.service)
    if isinstance(message, JournalEpisode | Checkpoint):
        _same(name, key.parts.get("episode", LATEST), f"{message.episode:08d}")
    if isinstance(message, JournalEpisode) and message.summary is None:
        raise BadPayloadError(f"{one_line(name)}: expected a finished episode, got one under way")
    return key


def _same(name: str, in_key: str, in_payload: str) -> None:
    if in_key not in (in_payload, LATEST):
        expected = f"expected a payload that says {one_line(in_key)!r}"
        raise BadPayloadError(f"{one_line(name)}: {expected}, got {in_payload!r}")
