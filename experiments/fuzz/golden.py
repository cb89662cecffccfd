"""The golden messages: at least one of each type, as fields and as the bytes that they are on the wire."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

from msgspec import Raw, Struct, json

from services.wire.codec import encoding_of
from services.wire.messages import MESSAGES, Message

_FILE = Path(__file__).with_name("golden.json")
_TYPES = {encoding_of(kind): kind for kind in MESSAGES}


class Golden(Struct, dict=True, forbid_unknown_fields=True):
    """A row of golden.json."""

    encoding: str
    fields: Raw
    """All fields by name, as JSON; bytes in base64."""
    payload: str
    """The message's bytes, in hexadecimal digits."""

    @cached_property
    def message(self) -> Message:
        """The message of these fields. Raises KeyError when no type has this encoding today."""
        return json.decode(self.fields, type=_TYPES[self.encoding])


def golden() -> list[Golden]:
    """Return all rows."""
    return json.decode(_FILE.read_bytes(), type=list[Golden])
