"""The page for browsers: where they are sent, and what becomes of those who ask oddly."""

from __future__ import annotations

import gzip
import http.client
import socket
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from urllib.parse import parse_qs, urlsplit

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.viewer.address import BadRequestError, bracketed, host_of, location
from services.viewer.web import MOST_CONNECTIONS, WebServer
from services.wire.errors import CellError

PATIENCE_S = 30.0
STREAM_PORT = 19876


@pytest.fixture(scope="module")
def server() -> Iterator[WebServer]:
    made = WebServer("127.0.0.1", 0)
    made.start(STREAM_PORT)
    yield made
    made.stop()


def ask(
    server: WebServer, path: str = "/", method: str = "GET", **headers: str
) -> tuple[http.client.HTTPResponse, bytes]:
    """Return the answer to a request, and its content."""
    client = http.client.HTTPConnection("127.0.0.1", server.port, timeout=PATIENCE_S)
    try:
        client.request(method, path, headers={name.replace("_", "-"): value for name, value in headers.items()})
        answer = client.getresponse()
        return answer, answer.read()
    finally:
        client.close()


def raw(server: WebServer, text: str) -> str:
    """Return what comes back for bytes that no client library would send."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE_S) as client:
        client.sendall(text.encode("latin-1"))
        client.shutdown(socket.SHUT_WR)
        with client.makefile("rb") as answer:
            return answer.read().decode("latin-1")


@pytest.mark.parametrize(
    ("header", "host"),
    [
        ("cell", "cell"),
        ("Cell-PC.example.org:9090", "Cell-PC.example.org"),
        ("10.1.2.3:80", "10.1.2.3"),
        ("[fd00::1]:9090", "[fd00::1]"),
        ("[::1]", "[::1]"),
    ],
)
def test_whatever_the_machine_is_called_the_stream_is_looked_for_there(header: str, host: str) -> None:
    assert host_of(header) == host
    where = location(host_of(header), 9876, "")
    assert where is not None
    parts = urlsplit(where)
    assert (parts.scheme, parts.netloc, parts.path) == ("", "", "/"), "the browser stays where it is"
    assert parse_qs(parts.query)["url"] == [f"rerun+http://{host}:9876/proxy"]


@pytest.mark.parametrize(
    "header",
    ["", ":9090", "a b", "a/b", "user@cell", "cell:", "cell:x", "cell:123456", "cell\r\nX: y", "[::1", "[cell]",
     "[fe80::1%eth0]", "[::1]x", "::1", "-cell", "cell?x=1", "a" * 300, "cell,cell", "<script>"],
)  # fmt: skip
def test_what_is_no_host_is_refused_in_one_line(header: str) -> None:
    with pytest.raises(BadRequestError, match=r"^Host header: expected HOST or HOST:PORT, got [^\n]*$"):
        host_of(header)


@given(st.text(max_size=40))
def test_nothing_gets_out_of_the_address_that_a_host_stands_in(header: str) -> None:
    try:
        host = host_of(header)
    except BadRequestError:
        return
    assert urlsplit(f"http://{host}:1/proxy").netloc == f"{host}:1"
    assert header.startswith(host) or header.startswith("[")


def test_what_the_address_says_already_stays() -> None:
    assert location("cell", 9876, "url=rerun%2Bhttp%3A%2F%2Fx%3A1%2Fproxy") is None
    where = location("cell", 9876, "renderer=webgl&theme=light&note=a%26b")
    assert where is not None
    asked = parse_qs(urlsplit(where).query)
    assert (asked["renderer"], asked["theme"], asked["note"]) == (["webgl"], ["light"], ["a&b"])
    with pytest.raises(BadRequestError):
        location("cell", 9876, "a=1&" * 1000)


def test_an_address_without_a_name_is_fit_for_a_url() -> None:
    assert bracketed("fe80::1%2") == "[fe80::1]"
    assert bracketed("10.1.2.3") == "10.1.2.3"


def test_the_bare_address_leads_to_the_stream_by_the_name_that_was_typed(server: WebServer) -> None:
    answer, _ = ask(server, Host="cell-pc:9090")
    assert answer.status == 302
    assert f"//cell-pc:{STREAM_PORT}/" in parse_qs(urlsplit(answer.headers["Location"]).query)["url"][0]
    assert answer.headers["Cache-Control"] == "no-store"


def test_without_a_host_it_is_the_address_that_was_connected_to(server: WebServer) -> None:
    assert f"%2F%2F127.0.0.1%3A{STREAM_PORT}%2F" in raw(server, "GET / HTTP/1.0\r\n\r\n")


@pytest.mark.parametrize(
    "request_",
    [
        "GET / HTTP/1.1\r\nHost: a b\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
        "GET http://[ HTTP/1.1\r\nHost: a\r\n\r\n",
        "GET / / HTTP/1.1\r\nHost: a\r\n\r\n",
    ],
)
def test_a_request_that_makes_no_sense_is_answered_with_400(server: WebServer, request_: str) -> None:
    answer = raw(server, request_)
    assert answer.split(" ", 2)[1] == "400"
    assert "Location" not in answer


def test_other_methods_and_paths_are_refused(server: WebServer) -> None:
    assert ask(server, method="POST")[0].status == 501
    for path in ("/../../etc/passwd", "/sw.js", "/re_viewer_bg.wasm/", "/%2e%2e"):
        assert ask(server, path)[0].status == 404


def test_files_come_packed_or_not_with_or_without_content_and_once(server: WebServer) -> None:
    page, plain = ask(server, "/?url=x")
    assert page.status == 200
    assert b"re_viewer.js" in plain
    packed, content = ask(server, "/?url=x", Accept_Encoding="br, gzip;q=0.5")
    assert packed.headers["Content-Encoding"] == "gzip"
    assert gzip.decompress(content) == plain
    assert ask(server, "/?url=x", Accept_Encoding="gzip;q=0")[0].headers["Content-Encoding"] is None
    head, nothing = ask(server, "/re_viewer_bg.wasm", "HEAD")
    assert nothing == b""
    assert int(head.headers["Content-Length"]) > 10_000_000
    assert head.headers["Content-Type"] == "application/wasm"
    again, nothing = ask(server, "/re_viewer_bg.wasm", If_None_Match=head.headers["ETag"])
    assert (again.status, nothing) == (304, b"")


def test_the_page_can_load_nothing_from_elsewhere(server: WebServer) -> None:
    policy = ask(server, "/?url=x")[0].headers["Content-Security-Policy"]
    assert "default-src 'self' data: blob:;" in policy
    assert f"connect-src 'self' data: blob: http://*:{STREAM_PORT}" in policy


def test_many_ask_at_once_and_all_get_it(server: WebServer) -> None:
    with ThreadPoolExecutor(16) as pool:
        sizes = set(pool.map(lambda _: len(ask(server, "/re_viewer_bg.wasm", Accept_Encoding="gzip")[1]), range(16)))
    assert len(sizes) == 1
    assert sizes.pop() > 1_000_000


def test_who_opens_too_many_connections_is_turned_away_and_leaves_room_when_gone(server: WebServer) -> None:
    greedy = [socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE_S) for _ in range(MOST_CONNECTIONS)]
    late = socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE_S)
    assert late.recv(1) == b"", "closed"
    for client in (late, *greedy):
        client.close()

    def served() -> bool:
        try:
            return ask(server)[0].status == 302
        except (http.client.HTTPException, ConnectionError):
            return False

    assert any(served() for _ in range(1000))


def test_a_download_under_way_does_not_hold_up_the_end(server: WebServer) -> None:
    another = WebServer("127.0.0.1", 0)
    another.assets = server.assets
    another.start(STREAM_PORT)
    with socket.create_connection(("127.0.0.1", another.port), timeout=PATIENCE_S) as slow:
        slow.sendall(b"GET /re_viewer_bg.wasm HTTP/1.1\r\nHost: a\r\n\r\n")
        assert slow.recv(12) == b"HTTP/1.1 200"
        another.stop()
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", another.port), timeout=PATIENCE_S)


def test_a_port_in_use_is_one_line_with_a_way_out() -> None:
    with socket.create_server(("127.0.0.1", 0)) as holder:
        port = holder.getsockname()[1]
        with pytest.raises(CellError, match=rf"^viewer: web page: .* got {port}: .*--web-port.*--no-web$"):
            WebServer("127.0.0.1", port)
    with pytest.raises(CellError, match="got 70000"):
        WebServer("127.0.0.1", 70000)
