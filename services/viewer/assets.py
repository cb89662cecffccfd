"""Rerun's page, taken from the server that Rerun brings along when a browser first asks for it, and kept packed."""

from __future__ import annotations

import hashlib
import http.client
import importlib.util
import os
import re
import subprocess
import threading
import zlib
from dataclasses import dataclass
from http import HTTPStatus
from pathlib import Path

from services.bus.command import DIE_WITH_PARENT
from services.rules.command_line import python
from services.wire.errors import CellError

KINDS = {
    "/": "text/html; charset=utf-8",
    "/re_viewer.js": "text/javascript; charset=utf-8",
    "/re_viewer_bg.wasm": "application/wasm",
    "/favicon.ico": "image/x-icon",
}
"""What the page is made of."""

_GZIP = 16 + zlib.MAX_WBITS
"""Makes zlib write gzip's format."""
_CHUNK = 1 << 18
_PATIENCE_S = 20.0
_ADDRESS = re.compile(r"Hosting a web-viewer at http://127\.0\.0\.1:([0-9]+)")
# Rerun's server has no lifeline of its own: it would outlive a viewer that is killed meanwhile.
_LAUNCH = (
    "import os, sys; from services.bus.command import die_with_parent; die_with_parent(); "
    "os.execv(sys.argv[1], sys.argv[1:])"
)


@dataclass(frozen=True)
class Asset:
    """One file of the page."""

    kind: str
    """Its media type."""
    packed: bytes
    """Its content, packed with gzip: about a third of the size, in memory as on the way."""
    size: int
    """Bytes unpacked."""
    tag: str
    """Entity tag: differs when the content does."""


class Assets:
    """The files of the page by path; safe to be asked from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._found: dict[str, Asset] = {}

    def get(self, path: str) -> Asset | None:
        """Return the file at a path; None when the page has no such file. Raises CellError when Rerun has no page."""
        if path not in KINDS:
            return None
        with self._lock:
            if not self._found:
                self._found = fetch()
            return self._found[path]


def fetch() -> dict[str, Asset]:
    """Return all files of the page; takes about a second. Raises CellError when Rerun does not give them."""
    command = python("-c", _LAUNCH, str(_program()), "--serve-web", "--bind", "127.0.0.1")
    # With an address to look at it serves the page alone, without a stream of its own; nothing connects to it.
    command += ["--web-viewer-port", "0", "rerun+http://127.0.0.1:1/proxy"]
    environment = {**os.environ, "NO_COLOR": "1", DIE_WITH_PARENT: str(os.getpid())}
    process = subprocess.Popen(
        command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    overdue = threading.Timer(_PATIENCE_S, process.kill)
    overdue.daemon = True
    overdue.start()
    try:
        assert process.stdout is not None
        said = ""
        for said in process.stdout:
            address = _ADDRESS.search(said)
            if address:
                return {path: _pack(int(address[1]), path, kind) for path, kind in KINDS.items()}
        raise CellError(f"viewer: web page: expected Rerun to serve it, got: {said.strip() or 'nothing'}")
    except (OSError, http.client.HTTPException) as error:
        raise CellError(f"viewer: web page: cannot be had from Rerun: {error}") from error
    finally:
        overdue.cancel()
        process.kill()
        process.communicate()


def _program() -> Path:
    """Return Rerun's own program; the command ``rerun`` is a script that starts it and would be left behind."""
    package = importlib.util.find_spec("rerun_cli")
    folders = [] if package is None else package.submodule_search_locations or []
    for folder in folders:
        program = Path(folder, "rerun")
        if program.is_file():
            return program
    raise CellError("viewer: web page: expected the program of rerun-sdk, found none")


def _pack(port: int, path: str, kind: str) -> Asset:
    packer, digest = zlib.compressobj(level=1, wbits=_GZIP), hashlib.sha256()
    packed, size = bytearray(), 0
    # This asks the address itself: no proxy that the environment names has a part in what stays on this machine.
    client = http.client.HTTPConnection("127.0.0.1", port, timeout=_PATIENCE_S)
    try:
        client.request("GET", path)
        answer = client.getresponse()
        if answer.status != HTTPStatus.OK:
            raise CellError(f"viewer: web page: expected Rerun to have {path}, got {answer.status} {answer.reason}")
        while chunk := answer.read(_CHUNK):
            digest.update(chunk)
            packed += packer.compress(chunk)
            size += len(chunk)
    finally:
        client.close()
    packed += packer.flush()
    return Asset(kind, bytes(packed), size, f'"{digest.hexdigest()[:32]}"')
