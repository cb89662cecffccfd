"""What may be stored under the keys that workers load their memory from: nothing that would not load."""

from __future__ import annotations

import re

from services.rules.skill import decode as decode_skill
from services.wire.codec import decode
from services.wire.errors import BadPayloadError
from services.wire.keys import LATEST, SKILL, SWAPS
from services.wire.messages import Checkpoint, JournalEpisode, RunRecord, Swaps
from services.wire.text import one_line

_CHECKPOINT = re.compile(r"checkpoint/([^/]+)/([^/]+)/([0-9]{8}|latest)")
_EPISODE = re.compile(r"journal/([^/]+)/(?:[0-9]{6}/([0-9]{8})|latest)")
_SKILL = re.compile(rf"{SKILL}/([^/]+)")
_RUN = re.compile(r"journal/([^/]+)/run")
_SWAPS = re.compile(rf"journal/([^/]+)/{SWAPS}")


def check(name: str, payload: bytes, encoding: str) -> None:
    """Check a value against its key in the cell; names that are none of the contract's are free.

    Raises ContractError: the wrong type, a payload that does not decode, or one that belongs to another key.
    """
    if found := _CHECKPOINT.fullmatch(name):
        checkpoint = decode(Checkpoint, payload, encoding)
        _same(name, found[1], checkpoint.run)
        _same(name, found[2], checkpoint.service)
        _same(name, found[3], f"{checkpoint.episode:08d}")
    elif found := _EPISODE.fullmatch(name):
        entry = decode(JournalEpisode, payload, encoding)
        _same(name, found[1], entry.run)
        _same(name, found[2] or "latest", f"{entry.episode:08d}")
        if entry.summary is None:
            raise BadPayloadError(f"{one_line(name)}: expected a finished episode, got one under way")
    elif found := _RUN.fullmatch(name):
        _same(name, found[1], decode(RunRecord, payload, encoding).run)
    elif found := _SWAPS.fullmatch(name):
        _same(name, found[1], decode(Swaps, payload, encoding).run)
    elif found := _SKILL.fullmatch(name):
        _same(name, found[1], decode_skill(payload, encoding).sha256)


def _same(name: str, in_key: str, in_payload: str) -> None:
    if in_key not in (in_payload, LATEST):
        expected = f"expected a payload that says {one_line(in_key)!r}"
        raise BadPayloadError(f"{one_line(name)}: {expected}, got {in_payload!r}")
