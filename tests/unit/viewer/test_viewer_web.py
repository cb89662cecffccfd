"""The page for browsers: where they are sent, and what becomes of those who ask oddly."""

from __future__ import annotations

import contextlib
import gzip
import http.client
import re
import socket
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.viewer.address import BadRequestError, bracketed, location, place_of
from services.viewer.assets import fetch
from services.viewer.web import MOST_CONNECTIONS, READS, WebServer
from services.wire.errors import CellError

PATIENCE_S = 30.0


@pytest.fixture(scope="module")
def server() -> Iterator[WebServer]:
    made = WebServer("127.0.0.1", 0)
    made.start("127.0.0.1", 1)
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
        client.sendall(text.replace("\r\n\r\n", "\r\nConnection: close\r\n\r\n").encode("latin-1"))
        with client.makefile("rb") as answer:
            return answer.read().decode("latin-1")


@pytest.mark.parametrize(
    ("header", "place"),
    [
        ("cell", "cell:80"),
        ("Cell-PC.example.org:9090", "Cell-PC.example.org:9090"),
        ("10.1.2.3:80", "10.1.2.3:80"),
        ("[fd00::1]:9090", "[fd00::1]:9090"),
        ("[::1]", "[::1]:80"),
    ],
)
def test_whatever_the_machine_is_called_the_stream_is_looked_for_there(header: str, place: str) -> None:
    assert place_of(header) == place
    where = location(place_of(header), "")
    assert where is not None
    parts = urlsplit(where)
    assert (parts.scheme, parts.netloc, parts.path) == ("", "", "/"), "the browser stays where it is"
    assert parse_qs(parts.query)["url"] == [f"rerun+http://{place}/proxy"]


@pytest.mark.parametrize(
    "header",
    ["", ":9090", "a b", "a/b", "user@cell", "cell:", "cell:x", "cell:123456", "cell\r\nX: y", "[::1", "[cell]",
     "[fe80::1%eth0]", "[::1]x", "::1", "-cell", "cell?x=1", "a" * 300, "cell,cell", "<script>"],
)  # fmt: skip
def test_what_is_no_host_is_refused_in_one_line(header: str) -> None:
    with pytest.raises(BadRequestError, match=r"^Host header: expected HOST or HOST:PORT, got [^\n]*$"):
        place_of(header)


@given(st.text(max_size=40))
def test_nothing_gets_out_of_the_address_that_a_host_stands_in(header: str) -> None:
    try:
        place = place_of(header)
    except BadRequestError:
        return
    assert urlsplit(f"http://{place}/proxy").netloc == place
    assert place.startswith(header.rpartition(":")[0] or header) or header.startswith("[")


def test_what_the_address_says_already_stays() -> None:
    assert location("cell:9090", "url=rerun%2Bhttp%3A%2F%2Fx%3A1%2Fproxy") is None
    where = location("cell:9090", "renderer=webgl&theme=light&note=a%26b")
    assert where is not None
    asked = parse_qs(urlsplit(where).query)
    assert (asked["renderer"], asked["theme"], asked["note"]) == (["webgl"], ["light"], ["a&b"])
    with pytest.raises(BadRequestError):
        location("cell:9090", "a=1&" * 1000)


def test_an_address_without_a_name_is_fit_for_a_url() -> None:
    assert bracketed("fe80::1%2") == "[fe80::1]"
    assert bracketed("10.1.2.3") == "10.1.2.3"


def test_the_bare_address_leads_to_the_stream_by_the_name_that_was_typed(server: WebServer) -> None:
    answer, _ = ask(server, Host="cell-pc:9090")
    assert answer.status == 302
    assert "//cell-pc:9090/" in parse_qs(urlsplit(answer.headers["Location"]).query)["url"][0]
    assert answer.headers["Cache-Control"] == "no-store"


def test_without_a_host_it_is_the_address_that_was_connected_to(server: WebServer) -> None:
    assert f"%2F%2F127.0.0.1%3A{server.port}%2F" in raw(server, "GET / HTTP/1.0\r\n\r\n")


@pytest.mark.parametrize(
    "request_",
    [
        "GET / HTTP/1.1\r\nHost: a b\r\n\r\n",
        "GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n",
        "GET / / HTTP/1.1\r\nHost: a\r\n\r\n",
    ],
)
def test_a_request_that_makes_no_sense_is_answered_with_400(server: WebServer, request_: str) -> None:
    answer = raw(server, request_)
    assert answer.split(" ", 2)[1] == "400"
    assert "Location" not in answer


def test_other_methods_and_paths_are_refused(server: WebServer) -> None:
    assert ask(server, method="POST")[0].status == 405
    for path in ("/../../etc/passwd", "/sw.js", "/re_viewer_bg.wasm/", "/%2e%2e"):
        assert ask(server, path)[0].status == 404


def test_files_come_packed_with_or_without_content_and_once(server: WebServer) -> None:
    page, content = ask(server, "/?url=x")
    assert (page.status, page.headers["Content-Encoding"]) == (200, "gzip")
    assert b"re_viewer.js" in gzip.decompress(content)
    head, nothing = ask(server, "/re_viewer_bg.wasm", "HEAD")
    assert nothing == b""
    assert 1_000_000 < int(head.headers["Content-Length"]) < int(head.headers["rerun-final-length"])
    assert head.headers["Content-Type"] == "application/wasm"
    again, nothing = ask(server, "/re_viewer_bg.wasm", If_None_Match=head.headers["ETag"])
    assert (again.status, nothing) == (304, b"")


def test_the_page_can_load_nothing_from_elsewhere(server: WebServer) -> None:
    policy = ask(server, "/?url=x")[0].headers["Content-Security-Policy"]
    assert "default-src 'self' data: blob:;" in policy
    assert "connect-src" not in policy and "*" not in policy


def test_many_ask_at_once_and_all_get_it(server: WebServer) -> None:
    with ThreadPoolExecutor(16) as pool:
        sizes = set(pool.map(lambda _: len(ask(server, "/re_viewer_bg.wasm")[1]), range(16)))
    assert len(sizes) == 1
    assert sizes.pop() > 1_000_000


def trickle(server: WebServer, count: int, ask: bytes) -> list[socket.socket]:
    """Return connections that have sent so much and now do nothing: slow ones, in the eyes of a server."""
    made = [socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE_S) for _ in range(count)]
    for client in made:
        client.sendall(ask)
    return made


@pytest.mark.parametrize(
    "ask_", [b"", b"GET /re_viewer_bg.wasm HT", b"GET /re_viewer_bg.wasm HTTP/1.1\r\nHost: a\r\n\r\n"]
)
def test_however_many_are_slow_a_browser_gets_the_page(server: WebServer, ask_: bytes) -> None:
    greedy = trickle(server, MOST_CONNECTIONS + 50, ask_)
    for _ in range(3):
        assert ask(server)[0].status == 302
    for client in greedy:
        client.close()


def test_a_head_must_be_there_in_time_however_it_trickles(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.viewer.web.HEAD_S", 0.3)
    server = WebServer("127.0.0.1", 0)
    server.start("127.0.0.1", 1)
    began = time.monotonic()
    with socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE_S) as slow:
        slow.settimeout(0.02)
        sent = 0
        with pytest.raises(ConnectionError):
            while time.monotonic() < began + PATIENCE_S:
                sent += slow.send(b"GET / HTTP/1.1\r\nX: "[sent : sent + 1] or b"x")
                with contextlib.suppress(TimeoutError):
                    if slow.recv(1) == b"":
                        raise ConnectionResetError
    server.stop()
    assert sent > 1


def test_a_file_must_be_fetched_in_time(server: WebServer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.viewer.web.SEND_S", 0.2)
    whole = len(ask(server, "/re_viewer_bg.wasm")[1])
    (slow,) = trickle(server, 1, b"GET /re_viewer_bg.wasm HTTP/1.1\r\nHost: a\r\n\r\n")
    time.sleep(0.5)
    with slow, contextlib.suppress(ConnectionError), slow.makefile("rb") as answer:
        assert len(answer.read()) < whole, "cut short"


def test_what_reads_is_passed_on_and_nothing_else(server: WebServer) -> None:
    service = READS[0].rpartition("/")[0]
    for method in ("WriteMessages", "WriteTable", "ReadMessages/", "readmessages"):
        assert ask(server, f"{service}/{method}", "POST")[0].status == 405
        assert ask(server, f"/x/..{service}/{method}", "POST")[0].status == 405
    for path in READS:
        assert ask(server, path, "POST")[0].status == 502, "nobody there"
        assert ask(server, path, "OPTIONS", Origin="http://elsewhere:9090")[0].status == 405, "no other page may ask"


def test_what_stands_in_front_in_containers_passes_on_the_same() -> None:
    told = (Path(__file__).resolve().parents[3] / "containers/front.conf").read_text()
    assert tuple(re.findall(r"location = (\S+)", told)) == READS


def test_an_answer_comes_as_it_is_given(server: WebServer, monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.create_server(("127.0.0.1", 0)) as rerun:
        monkeypatch.setattr(server, "stream", rerun.getsockname())
        with socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE_S) as browser:
            browser.sendall(
                f"POST {READS[0]} HTTP/1.1\r\nHost: a\r\nOrigin: http://a\r\nContent-Length: 3\r\n\r\nxyz".encode()
            )
            taken, _ = rerun.accept()
            with taken:
                assert taken.recv(1000).endswith(b"\r\n\r\nxyz")
                for piece in (b"HTTP/1.1 200 OK\r\n", b"\r\n", b"first", b"second"):
                    taken.sendall(piece)
                    assert browser.recv(len(piece), socket.MSG_WAITALL) == piece
                browser.close()
                taken.settimeout(PATIENCE_S)
                assert taken.recv(1) == b"", "who goes is not waited for"


def test_no_proxy_has_a_part_in_what_stays_on_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("http_proxy", "HTTP_PROXY", "https_proxy", "all_proxy", "ALL_PROXY"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")
    assert fetch()["/"].size > 1000


def test_a_download_under_way_does_not_hold_up_the_end(server: WebServer) -> None:
    another = WebServer("127.0.0.1", 0)
    another.assets = server.assets
    another.start("127.0.0.1", 1)
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
