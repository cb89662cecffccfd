"""A page for plain browsers: ``http://HOST:9090`` shows the cell without anything to install or to type after it.

The stream comes by the same port, so that a browser need not be told who else may read it: nobody else may. What the
page passes on to Rerun only reads.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import threading
from http import HTTPStatus

from tornado import httputil
from tornado.httpserver import HTTPServer
from tornado.iostream import IOStream, StreamClosedError
from tornado.web import Application, HTTPError, RequestHandler

from services.bus import ports
from services.viewer.address import BadRequestError, bracketed, location, place_of
from services.viewer.assets import Asset, Assets
from services.wire.errors import CellError

MOST_CONNECTIONS = 256
"""When more come, the ones that have waited or been served for longest are closed: who is new gets the page."""
MOST_WATCHING = 32
HEAD_S = 10.0
"""How long a request may take to arrive, however it trickles; and how long a connection may rest."""
SEND_S = 300.0
"""How long a file may take to be fetched."""
BEHIND_S = 20.0
"""A browser that takes nothing of the stream for so long is given up: it would see ever older things."""
READS = tuple(f"/rerun.sdk_comms.v1alpha1.MessageProxyService/{name}" for name in ("ReadMessages", "ReadTables"))
"""What Rerun is asked by those who look on; everything else that it answers changes something."""
_PASSED_ON = ("Content-Type", "Accept", "X-Grpc-Web", "X-User-Agent", "Grpc-Timeout")
_CHUNK = 1 << 16
# By itself the page loads a typeface from the Internet, and where there is none it would wait for that at its start.
_POLICY = (
    "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'"
)


class WebServer:
    """Serves Rerun's page, and the stream to whoever looks at it, from a thread of its own."""

    def __init__(self, bind: str, port: int) -> None:
        """Listen on ``bind``:``port`` (0 for any free port). Raises CellError when that cannot be."""
        self.assets = Assets()
        self.stream = ("", 0)
        self.watching = 0
        family = socket.AF_INET6 if ":" in bind else socket.AF_INET
        both = bind == "::" and socket.has_dualstack_ipv6()
        try:
            port = ports.free_port(bind, port)
            self._socket = socket.create_server((bind, port), family=family, backlog=256, dualstack_ipv6=both)
        except (OSError, OverflowError) as error:
            hint = "try another --web-port, 0 for any, or --no-web"
            raise CellError(f"viewer: web page: expected a free port at {bind}, got {port}: {error}; {hint}") from None
        # Bounds what lies in the system for those who do not fetch it; connections inherit it.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 18)
        self._socket.setblocking(False)
        self.port: int = self._socket.getsockname()[1]
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), name="web", daemon=True)
        self._serving = threading.Event()

    def start(self, host: str, port: int) -> None:
        """Serve in the background, with the stream of Rerun's server at ``host``:``port``."""
        self.stream = (host, port)
        self._thread.start()
        self._serving.wait()

    def stop(self) -> None:
        """End; transfers under way are cut short."""
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._ended.set)
            self._thread.join()
        self._socket.close()

    async def _serve(self) -> None:
        for name in ("tornado.access", "tornado.general"):  # strangers write no log
            logging.getLogger(name).setLevel(logging.CRITICAL)
        routes = [(path, _Stream, {"web": self}) for path in READS] + [(r"/.*", _Page, {"web": self})]
        server = _Server(Application(routes), idle_connection_timeout=HEAD_S, body_timeout=HEAD_S, max_body_size=_CHUNK)
        server.add_socket(self._socket)
        self._loop, self._ended = asyncio.get_running_loop(), asyncio.Event()
        self._serving.set()
        await self._ended.wait()
        server.stop()
        await server.close_all_connections()


class _Server(HTTPServer):
    """Tornado's server, which never runs out of places."""

    def initialize(self, *arguments: object, **named: object) -> None:
        super().initialize(*arguments, **named)  # type: ignore[arg-type]
        self._places: dict[object, IOStream] = {}

    def start_request(self, server_conn: object, request_conn: httputil.HTTPConnection) -> httputil.HTTPMessageDelegate:
        """Take a connection that waits for a request, its first or its next."""
        while len(self._places) >= MOST_CONNECTIONS:
            self._places.pop(next(iter(self._places))).close()
        self._places.pop(server_conn, None)
        self._places[server_conn] = request_conn.stream  # type: ignore[attr-defined]
        return super().start_request(server_conn, request_conn)

    def on_close(self, server_conn: object) -> None:
        """Free its place."""
        self._places.pop(server_conn, None)
        super().on_close(server_conn)


class _Answer(RequestHandler):
    """What all answers have in common."""

    def initialize(self, web: WebServer) -> None:
        self.web = web

    def set_default_headers(self) -> None:
        self.set_header("Server", "treenail")
        self.set_header("X-Content-Type-Options", "nosniff")

    def log_exception(self, *about: object) -> None:
        """Say nothing of browsers that went away."""

    def say(self, status: HTTPStatus, text: str) -> None:
        """Answer in words."""
        self.set_status(status)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(f"{text}\n")

    def write_error(self, status_code: int, **named: object) -> None:
        status = HTTPStatus(status_code)
        self.say(status, status.phrase)


class _Page(_Answer):
    """Answers with a file or with where to go."""

    async def get(self) -> None:
        try:
            await self._answer()
        except BadRequestError as error:
            self.say(HTTPStatus.BAD_REQUEST, str(error))
        except CellError as error:
            logging.getLogger("viewer").warning("%s", error)
            self.say(HTTPStatus.SERVICE_UNAVAILABLE, str(error))

    head = get

    async def _answer(self) -> None:
        if self.request.path == "/":
            where = location(self._place(), self.request.query)
            if where is not None:
                self.set_header("Cache-Control", "no-store")
                self.redirect(where)
                return
        asset = await asyncio.to_thread(self.web.assets.get, self.request.path)
        if asset is None:
            self.say(HTTPStatus.NOT_FOUND, f"no such page: {self.request.path[:80]}")
            return
        try:
            async with asyncio.timeout(SEND_S):
                await self._send(asset)
        except TimeoutError:
            self.detach().close()

    def _place(self) -> str:
        """Return where the browser knows us to be; without a word from it, the address that it came to."""
        headers = self.request.headers.get_list("Host")
        if len(headers) > 1:
            raise BadRequestError(f"Host header: expected one, got {len(headers)}")
        if headers:
            return place_of(headers[0].strip())
        address, port = self.request.connection.stream.socket.getsockname()[:2]  # type: ignore[union-attr]
        return f"{bracketed(str(address))}:{port}"

    async def _send(self, asset: Asset) -> None:
        self.set_header("ETag", asset.tag)
        self.set_header("Cache-Control", "no-cache")
        if self.request.headers.get("If-None-Match") == asset.tag:
            self.set_status(HTTPStatus.NOT_MODIFIED)
            return
        # As it is kept, to all: every browser takes it, and nobody makes us work for what he does not fetch.
        self.set_header("Content-Encoding", "gzip")
        self.set_header("Content-Type", asset.kind)
        self.set_header("Content-Length", len(asset.packed))
        self.set_header("rerun-final-length", asset.size)  # the page shows how much of it has come
        self.set_header("Content-Security-Policy", _POLICY)
        await self.flush()
        if self.request.method == "GET":
            for start in range(0, len(asset.packed), _CHUNK):
                self.write(asset.packed[start : start + _CHUNK])
                await self.flush()


class _Stream(_Answer):
    """Passes a question to Rerun's own server, and its answer back as it comes."""

    async def post(self) -> None:
        if self.web.watching >= MOST_WATCHING:
            raise HTTPError(HTTPStatus.SERVICE_UNAVAILABLE)
        try:
            answer, ask = await asyncio.open_connection(*self.web.stream)
        except OSError:
            raise HTTPError(HTTPStatus.BAD_GATEWAY) from None
        self.web.watching += 1
        browser = self.detach()
        browser.set_close_callback(ask.close)  # which ends what is read below
        try:
            ask.write(self._question())
            while piece := await answer.read(_CHUNK):
                async with asyncio.timeout(BEHIND_S):
                    await browser.write(piece)
        except (OSError, StreamClosedError):  # TimeoutError is an OSError
            pass
        finally:
            self.web.watching -= 1
            browser.close()
            ask.close()

    def _question(self) -> bytes:
        told = {name: self.request.headers[name] for name in _PASSED_ON if name in self.request.headers}
        told |= {"Host": "localhost", "Connection": "close", "Content-Length": str(len(self.request.body))}
        lines = [f"POST {self.request.path} HTTP/1.1", *(f"{name}: {value}" for name, value in told.items()), "", ""]
        return "\r\n".join(lines).encode("latin-1") + self.request.body
