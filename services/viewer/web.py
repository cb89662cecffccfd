"""A page for plain browsers: ``http://HOST:9090`` shows the cell without anything to install or to type after it."""

from __future__ import annotations

import logging
import socket
import threading
import zlib
from collections.abc import Callable, Iterator
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import urlsplit

from services.viewer.address import BadRequestError, bracketed, host_of, location
from services.viewer.assets import GZIP, Asset, Assets
from services.wire.errors import CellError

MOST_CONNECTIONS = 64
"""Browsers keep some six connections each; more are turned away, so that nobody can use up the memory."""
IDLE_S = 30.0
"""A connection on which nothing moves for so long is closed."""
_CHUNK = 1 << 16


class WebServer(ThreadingHTTPServer):
    """Serves Rerun's page, and sends whoever asks for it to the stream on this machine."""

    daemon_threads = True  # a download does not hold up the end
    request_queue_size = 64

    def __init__(self, bind: str, port: int) -> None:
        """Listen on ``bind``:``port`` (0 for any free port). Raises CellError when that cannot be."""
        self.address_family = socket.AF_INET6 if ":" in bind else socket.AF_INET
        self.log = logging.getLogger("viewer")
        self.assets = Assets()
        self.stream_port = 0
        self._room = threading.Semaphore(MOST_CONNECTIONS)
        try:
            super().__init__((bind, port), _Handler)
        except (OSError, OverflowError) as error:
            hint = "try another --web-port, 0 for any, or --no-web"
            raise CellError(f"viewer: web page: expected a free port at {bind}, got {port}: {error}; {hint}") from None

    @property
    def port(self) -> int:
        """Return the port that it listens on."""
        chosen: int = self.server_address[1]
        return chosen

    def start(self, stream_port: int) -> None:
        """Serve in the background, sending browsers to ``stream_port`` of the host that they know this one by."""
        self.stream_port = stream_port
        threading.Thread(target=self.serve_forever, kwargs={"poll_interval": 0.2}, name="web", daemon=True).start()

    def stop(self) -> None:
        """End; transfers under way are cut short."""
        if self.stream_port:
            self.shutdown()
        self.server_close()

    # -- details of the standard library's server ----------------------------------------------------------------

    def server_bind(self) -> None:
        """Listen; on all addresses means those of IPv4 as well."""
        if self.address_family == socket.AF_INET6:
            self.socket.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 0)
        # Not by way of HTTPServer, which asks the name service who we are, and may wait long for it.
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.bind(self.server_address)
        self.server_address = self.socket.getsockname()

    def process_request(self, request: socket.socket | tuple[bytes, socket.socket], client_address: object) -> None:
        """Serve a connection in a thread of its own, while there is room."""
        if self._room.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(
        self, request: socket.socket | tuple[bytes, socket.socket], client_address: object
    ) -> None:
        """Serve a connection and make room again."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._room.release()

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing of browsers that went away; the standard library would print a traceback."""
        self.log.debug("web page: connection from %s broken", client_address, exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    """Answers on one connection."""

    server: WebServer
    protocol_version = "HTTP/1.1"
    timeout = IDLE_S

    def do_GET(self) -> None:
        """Answer with a file or with where to go."""
        self._guarded(self._answer)

    def do_HEAD(self) -> None:
        """Answer as to GET, without the content."""
        self._guarded(self._answer)

    def version_string(self) -> str:
        """Return what serves."""
        return "treenail"

    def log_message(self, format: str, *arguments: object) -> None:
        """Log nothing of ordinary requests."""

    def _guarded(self, answer: Callable[[], None]) -> None:
        try:
            answer()
        except BadRequestError as error:
            self._say(HTTPStatus.BAD_REQUEST, str(error))
        except CellError as error:
            self.server.log.warning("%s", error)
            self._say(HTTPStatus.SERVICE_UNAVAILABLE, str(error))

    def _answer(self) -> None:
        try:
            parts = urlsplit(self.path)
        except ValueError:
            raise BadRequestError(f"path: expected one, got {self.path[:80]!r}") from None
        if parts.path == "/":
            where = location(self._host(), self.server.stream_port, parts.query)
            if where is not None:
                self._head(HTTPStatus.FOUND, {"Location": where, "Cache-Control": "no-store", "Content-Length": "0"})
                return
        asset = self.server.assets.get(parts.path)
        if asset is None:
            self._say(HTTPStatus.NOT_FOUND, f"no such page: {parts.path[:80]}")
        else:
            self._send(asset)

    def _host(self) -> str:
        """Return the host by which the browser knows us; without a word from it, the address that it came to."""
        headers: list[str] = self.headers.get_all("Host", [])
        if len(headers) > 1:
            raise BadRequestError(f"Host header: expected one, got {len(headers)}")
        if headers:
            return host_of(headers[0].strip())
        return bracketed(str(self.connection.getsockname()[0]))

    def _send(self, asset: Asset) -> None:
        about = {"ETag": asset.tag, "Cache-Control": "no-cache", "Vary": "Accept-Encoding"}
        if self.headers.get("If-None-Match") == asset.tag:
            self._head(HTTPStatus.NOT_MODIFIED, about)
            return
        packed = _takes_gzip(self.headers.get("Accept-Encoding", ""))
        if packed:
            about["Content-Encoding"] = "gzip"
        about["Content-Type"] = asset.kind
        about["Content-Length"] = str(len(asset.packed) if packed else asset.size)
        about["rerun-final-length"] = str(asset.size)  # the page shows how much of it has come
        about["Content-Security-Policy"] = _policy(self.server.stream_port)
        self._head(HTTPStatus.OK, about)
        if self.command == "GET":
            # In pieces: the time that a connection may be idle is that of one write.
            for piece in _pieces(asset.packed) if packed else _unpacked(asset.packed):
                self.wfile.write(piece)

    def _say(self, status: HTTPStatus, text: str) -> None:
        content = f"{text}\n".encode()
        self._head(status, {"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(content))})
        if self.command == "GET":
            self.wfile.write(content)

    def _head(self, status: HTTPStatus, about: dict[str, str]) -> None:
        self.send_response(status)
        for name, value in {**about, "X-Content-Type-Options": "nosniff"}.items():
            self.send_header(name, value)
        self.end_headers()


def _takes_gzip(accepted: str) -> bool:
    """Return whether a list of codings holds gzip, other than with weight 0."""
    for item in accepted.lower().split(","):
        coding, _, weight = item.replace(" ", "").partition(";q=")
        if coding == "gzip":
            return weight.strip("0.") != "" or weight == ""
    return False


def _policy(stream_port: int) -> str:
    """Return what the page may do: nothing that leaves the cell.

    By itself it loads a typeface from the Internet, and where there is none it would wait for that before it starts.
    """
    return (
        "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval'; "
        f"style-src 'self' 'unsafe-inline'; connect-src 'self' data: blob: http://*:{stream_port}"
    )


def _pieces(content: bytes) -> Iterator[bytes]:
    for start in range(0, len(content), _CHUNK):
        yield content[start : start + _CHUNK]


def _unpacked(packed: bytes) -> Iterator[bytes]:
    unpacker = zlib.decompressobj(wbits=GZIP)
    for piece in _pieces(packed):
        yield unpacker.decompress(piece)
    yield unpacker.flush()
