"""Finished pieces of the report on disk, so that an interrupted one goes on where it stopped.

One JSON file a piece, named by the SHA-256 of its kind and key. A file that is not what it should be, or that other
code computed, is set aside with a word and never overwritten; nothing else in the folder is ever touched.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import msgspec

from services.wire.errors import TreenailError

T = TypeVar("T")
FORMAT = 2
"""Version of the files; those of another one are recomputed."""
ASIDE = ".old"
"""Ending of the names of files set aside."""


class CacheError(TreenailError):
    """A key or result that cannot be kept; the message names the piece."""


class _UnusableError(TreenailError):
    """A file that cannot be used; the message says why."""


class _Version(msgspec.Struct):
    format: int


class _Entry(msgspec.Struct, forbid_unknown_fields=True):
    format: int
    code: str
    """What computed it, see ``code_sha256``."""
    kind: str
    key: msgspec.Raw
    sha256: str
    """Of the bytes of ``value``."""
    value: msgspec.Raw


class Cache:
    """A folder of finished pieces."""

    def __init__(self, folder: Path, say: Callable[[str], None], code: str = "") -> None:
        """Keep pieces in ``folder``, which is made when the first one is kept; ``say`` hears what is wrong in it.

        ``code`` names what computes the pieces; those that other code computed are not used.
        """
        self._folder = folder
        self._say = say
        self._code = code
        self.from_before = 0
        """How many results were taken from the folder so far."""

    def load(self, kind: str, key: object, result: type[T]) -> T | None:
        """Return the result of a piece, None when there is none that can be used; CacheError upon a wrong key."""
        wanted = key_bytes(kind, key)
        path = self.path(kind, key)
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            self._say(f"{path}: cannot be read ({error.strerror}), computing it again")
            return None
        try:
            value = self._checked(content, kind, wanted, result)
            self.from_before += 1
            return value
        except _UnusableError as error:
            self._set_aside(path, str(error))
        except msgspec.MsgspecError as error:
            self._set_aside(path, f"damaged ({error})")
        return None

    def _checked(self, content: bytes, kind: str, key: bytes, result: type[T]) -> T:
        """Return what a file holds. Raises _UnusableError and MsgspecError."""
        version = msgspec.json.decode(content, type=_Version).format
        if version != FORMAT:
            raise _UnusableError(f"of format {version}, expected {FORMAT}")
        entry = msgspec.json.decode(content, type=_Entry)
        value = msgspec.json.decode(entry.value, type=result)
        if (entry.kind, bytes(entry.key)) != (kind, key) or entry.sha256 != _sha256(bytes(entry.value)):
            raise _UnusableError("damaged (its content does not fit its checksum or name)")
        if entry.code != self._code:
            raise _UnusableError(f"computed by other code ({entry.code[:12]}, this is {self._code[:12]})")
        return value

    def _set_aside(self, path: Path, why: str) -> None:
        self._say(f"{path}: {why}; set aside as {path.name}{ASIDE}, computing it again")
        try:
            os.replace(path, path.with_name(path.name + ASIDE))
        except OSError as error:
            self._say(f"{path}: cannot be set aside ({error.strerror})")

    def keep(self, kind: str, key: object, value: T, result: type[T]) -> T:
        """Write the result of a piece and return it as it will be read back.

        CacheError when it would not come back, as with NaN. A disk that takes nothing is only reported.
        """
        try:
            content = msgspec.json.encode(value)
            back = msgspec.json.decode(content, type=result)
        except (msgspec.MsgspecError, TypeError) as error:
            raise CacheError(f"result of {kind} {_text(key)}: expected JSON of {result}: {error}") from error
        entry = _Entry(
            FORMAT, self._code, kind, msgspec.Raw(key_bytes(kind, key)), _sha256(content), msgspec.Raw(content)
        )
        path = self.path(kind, key)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            _write(path, msgspec.json.encode(entry))
        except OSError as error:
            self._say(f"{path}: cannot be kept ({error.strerror}); an interrupted report would compute it again")
        return back

    def path(self, kind: str, key: object) -> Path:
        """Return where the result of a piece is kept; CacheError upon a wrong key."""
        return self._folder / f"{_sha256(msgspec.json.encode([kind, msgspec.Raw(key_bytes(kind, key))]))}.json"


def key_bytes(kind: str, key: object) -> bytes:
    """Return a key as JSON with its names in order; CacheError when it is no mapping with a whole-number version."""
    try:
        content = msgspec.json.encode(key, order="deterministic")
    except (msgspec.MsgspecError, TypeError) as error:
        raise CacheError(f"key of {kind}: expected what JSON can hold, got {key!r}: {error}") from error
    plain = msgspec.json.decode(content)
    if not isinstance(plain, dict) or type(plain.get("version")) is not int:
        raise CacheError(f"key of {kind}: expected a mapping with a whole number as version, got {content.decode()}")
    return content


def _text(key: object) -> str:
    return msgspec.json.encode(key, order="deterministic").decode()


def _write(path: Path, content: bytes) -> None:
    """Write a file whole or not at all. Raises OSError."""
    part = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        part.write_bytes(content)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


def _sha256(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
