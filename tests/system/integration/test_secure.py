"""A router with certificates: who may not come in is told why, and who is in may do what ACCESS says and no more."""

from __future__ import annotations

import datetime as dt
import itertools
import json
import re
import socket
import ssl
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import Any

import pytest
import zenoh
from zenoh.handlers import Callback

from services.bus.access import ACCESS
from services.bus.service import Options
from services.bus.session import open_client
from services.bus.tls import Identity
from services.cell import authority as house
from services.cell.authority import Authority
from services.cell.certificates import certify
from services.cell.client import Client
from services.wire.errors import CellError
from services.wire.keys import CLIENTS, Q_TABLE, SERVICES, Keys
from services.wire.messages import Alive, JournalEpisode, QTable

KEYS = Keys("cell-2")
LONG = {"<run>": "r-s0", "<block>": "000000", "<episode>": "00000003", "<sha256>": "ab" * 32, "<instance>": "1-a"}
PLACES = ("agent", "classifier", "viewer")
"""The services whose own keys are tried by everybody."""
BUSY_S = 5.0
"""What a busy machine may add to any time; it was 44 s."""
SPOKEN = ("put", "delete", "answer", "be")
"""What one may do only in one's own name, where the key has one."""


@pytest.fixture(scope="module")
def certs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("house") / "certs"
    certify(folder, ["127.0.0.2"], 365)
    return folder


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Certificates of somebody else's house."""
    folder = tmp_path_factory.mktemp("foreign") / "certs"
    certify(folder, [], 365)
    return folder


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        return int(probe.getsockname()[1])


@pytest.fixture
def secured(certs: Path, run_module: Callable[..., Any], wait_until: Callable[..., None]) -> str:
    """Where a router with certificates listens, on all addresses."""
    port = free_port()
    process = run_module("services.router", "--certs", str(certs / "router"), "--listen", f"tls/0.0.0.0:{port}")
    wait_until("the router listens", lambda: "listening on" in process.out)
    return f"tls/127.0.0.1:{port}"


@pytest.fixture
def join(secured: str, certs: Path) -> Iterator[Callable[[str], zenoh.Session]]:
    """Opens sessions with the certificate of a name."""
    with ExitStack() as stack:

        def open_as(name: str) -> zenoh.Session:
            session = open_client([secured], 30.0, certs=certs / name)
            stack.callback(session.close)
            return session

        yield open_as


@pytest.fixture
def issue(certs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Makes a client's certificate as it would have been made some days from now."""
    ours: Authority = house.authority(certs)[0]

    def make(name: str, in_days: float, days: int) -> Path:
        made = dt.datetime.now(dt.UTC) + dt.timedelta(days=in_days)
        monkeypatch.setattr(house, "now", lambda: made)
        hosts = ["127.0.0.1"] if name == "router" else []
        ours.issue(tmp_path / name, name, hosts, days)
        return tmp_path / name

    return make


class House:
    """A session for each client, all in one place, and what each of them got."""

    def __init__(self, join: Callable[[str], zenoh.Session], wait_until: Callable[..., None]) -> None:
        self.sessions = {name: join(name) for name in CLIENTS}
        self.wait_until = wait_until
        self.got: dict[tuple[str, str, str], set[str]] = defaultdict(set)
        """Senders by kind, key and hearer."""
        self._held: list[object] = []

    def listen(self, keys: list[str]) -> None:
        """Let everybody subscribe to, and answer, all keys."""
        for name, session in self.sessions.items():
            for key in keys:
                self._held.append(session.declare_subscriber(KEYS.of(key), self._hearer(name, key)))
                self._held.append(session.declare_queryable(KEYS.of(key), self._answerer(name, key)))
        self.settle()

    def settle(self) -> None:
        """Wait until the router has done what everybody told it so far, by asking it something."""
        for name in self.sessions:
            self.present(name)

    def present(self, name: str) -> set[str]:
        """Return the tokens that somebody sees."""
        found: set[str] = set()
        for wild in ("alive/*", "claim/*/*"):
            replies = self.sessions[name].liveliness().get(KEYS.of(wild), timeout=10.0)
            found |= {str(reply.ok.key_expr).removeprefix(KEYS.of("")) for reply in replies if reply.ok is not None}
        return found

    def _hearer(self, name: str, key: str) -> Callback[zenoh.Sample]:
        def take(sample: zenoh.Sample) -> None:
            assert sample.attachment is not None
            verb = "put" if sample.kind == zenoh.SampleKind.PUT else "delete"
            self.got[verb, key, name].add(sample.attachment.to_string())

        return Callback(take, indirect=False)

    def _answerer(self, name: str, key: str) -> Callback[zenoh.Query]:
        def take(query: zenoh.Query) -> None:
            with query:
                query.reply(KEYS.of(key), name)

        return Callback(take, indirect=False)

    def speak(self, keys: list[str]) -> None:
        """Let everybody put and delete all keys, and wait until all that gets through has come."""
        for name, session in sorted(self.sessions.items(), key=lambda item: item[0] in SERVICES):
            for key in keys:
                session.put(KEYS.of(key), b"", attachment=name)
                session.delete(KEYS.of(key), attachment=name)
            # The router has passed on what came before a question that it has answered.
            assert list(session.get(KEYS.of("experiment"), timeout=10.0))
        # What one of them says last comes last to everybody.
        self.sessions["task"].put(KEYS.heartbeat("task"), b"", attachment="task")
        for name in CLIENTS:
            self.wait_until(
                f"{name} hears the last word", lambda name=name: self.got["put", "heartbeat/task", name] == {"task"}
            )

    def ask(self, name: str, key: str) -> set[str]:
        """Return who answers a question."""
        replies = self.sessions[name].get(KEYS.of(key), target=zenoh.QueryTarget.ALL, consolidation=RAW, timeout=10.0)
        return {reply.ok.payload.to_string() for reply in replies if reply.ok is not None}


RAW = zenoh.ConsolidationMode.NONE


def concrete() -> Iterator[str]:
    """Give an example of each key of the contract, with ``<service>`` once for each of PLACES."""
    for row in ACCESS:
        key = re.sub("|".join(LONG), lambda found: LONG[found[0]], row)
        if "**" not in key:
            yield from {key.replace("<service>", place): None for place in PLACES}


def allowed(verb: str, key: str) -> set[str]:
    """Return who may do something with an example, as one reads it in ACCESS."""
    found: set[str] = set()
    for row, access in ACCESS.items():
        wild = re.sub(r"<(?!service)\w+>", "*", row)
        for place in PLACES if "<service>" in row else ("",):
            if zenoh.KeyExpr(wild.replace("<service>", place)).includes(zenoh.KeyExpr(key)):
                names = set(getattr(access, verb))
                found |= names & {place} if place and verb in SPOKEN else names
    return found


def test_everybody_can_do_what_is_allowed_and_nothing_else(
    join: Callable[[str], zenoh.Session], wait_until: Callable[..., None]
) -> None:
    keys = list(concrete())
    assert "checkpoint/r-s0/agent/00000003" in keys and "alive/viewer" in keys
    cell = House(join, wait_until)
    cell.listen([*keys, "heartbeat/task"])
    cell.speak(keys)
    for key, name in itertools.product(keys, CLIENTS):
        for verb in ("put", "delete"):
            # What one does oneself one's own session hears in any case.
            expected = allowed(verb, key) if name in allowed("hear", key) else set()
            assert cell.got[verb, key, name] - {name} == expected - {name}, (verb, key, name)
        answers = allowed("answer", key) if name in allowed("ask", key) else set()
        assert cell.ask(name, key) - {name} == answers - {name}, ("ask", key, name)


def test_presence_is_everybodys_own_and_seen_by_all(
    join: Callable[[str], zenoh.Session], wait_until: Callable[..., None]
) -> None:
    cell = House(join, wait_until)
    keys = [key for key in concrete() if allowed("be", key)]
    for name, session in cell.sessions.items():
        tokens = [session.liveliness().declare_token(KEYS.of(key)) for key in keys]
        cell.settle()
        own = {key for key in keys if name in allowed("be", key)}
        # One's own tokens one's own session may show in any case.
        for other in set(CLIENTS) - {name}:
            assert cell.present(other) == own, (name, other)
        for token in tokens:
            token.undeclare()  # type: ignore[no-untyped-call]
        cell.settle()
        assert cell.present("guest") == set()


def test_a_reader_of_everything_gets_what_it_may_hear(
    join: Callable[[str], zenoh.Session], wait_until: Callable[..., None]
) -> None:
    guest, task, agent = join("guest"), join("task"), join("agent")
    heard: list[str] = []

    def note(sample: zenoh.Sample) -> None:
        heard.append(str(sample.key_expr).removeprefix(KEYS.of("")))

    held = guest.declare_subscriber(KEYS.of("**"), Callback(note, indirect=False))
    # Not everybody may: the agent would hear the truth that the simulator tells.
    overheard: list[object] = []
    spying = agent.declare_subscriber(KEYS.of("**"), Callback(overheard.append, indirect=False))
    for session in (guest, agent):
        list(session.liveliness().get(KEYS.alive("*"), timeout=10.0))
    for key in ("reward", "journal/r/latest", "checkpoint/skill/latest", "episode"):
        task.put(KEYS.of(key), b"")
    wait_until("the last one has come", lambda: "episode" in heard)
    assert heard == ["reward", "journal/r/latest", "checkpoint/skill/latest", "episode"]
    assert overheard == []
    assert held and spying


def test_a_signed_name_that_nobody_knows_gets_nothing(
    join: Callable[[str], zenoh.Session], secured: str, certs: Path, tmp_path: Path, wait_until: Callable[..., None]
) -> None:
    ours, _ = house.authority(certs)
    ours.issue(tmp_path / "nobody", "nobody", [], 1)
    stranger = open_client([secured], 30.0, certs=tmp_path / "nobody")
    task, agent, guest = join("task"), join("agent"), join("guest")
    heard: list[zenoh.Sample] = []
    felt: list[zenoh.Sample] = []
    spied: list[zenoh.Sample] = []
    held = [
        task.declare_subscriber(KEYS.of("action"), Callback(heard.append, indirect=False)),
        guest.declare_subscriber(KEYS.of("action"), Callback(felt.append, indirect=False)),
        stranger.declare_subscriber("**", Callback(spied.append, indirect=False)),
        task.declare_queryable(KEYS.of("experiment"), lambda query: query.reply(KEYS.of("experiment"), b"yes")),
    ]
    assert list(stranger.liveliness().get("**", timeout=5.0)) == []
    assert [reply.ok for reply in stranger.get(KEYS.of("experiment"), timeout=5.0)] == []
    assert [reply.ok.payload.to_bytes() for reply in guest.get(KEYS.of("experiment")) if reply.ok] == [b"yes"]
    stranger.put(KEYS.of("action"), b"stranger")
    assert list(stranger.get("@/*/router/**", timeout=5.0)) == []
    agent.put(KEYS.of("action"), b"agent")
    wait_until("the agent is heard", lambda: heard and felt)
    assert [sample.payload.to_bytes() for sample in heard] == [b"agent"]
    assert b"agent" not in [sample.payload.to_bytes() for sample in spied]
    assert held
    stranger.close()  # type: ignore[no-untyped-call]


def test_every_service_has_what_it_needs_and_a_guest_sees_it(
    secured: str,
    certs: Path,
    small: Path,
    run_module: Callable[..., Any],
    wait_until: Callable[..., None],
    tmp_path: Path,
) -> None:
    options = {
        "store": ("--file", str(tmp_path / "store.sqlite")),
        "task": ("--experiment", str(small), "--episodes", "500"),
        "sim": (),
        "classifier": (),
        "agent": (),
        "viewer": ("--bind", "127.0.0.1", "--port", "0", "--no-web"),
    }
    processes = {
        name: run_module(f"services.{name}", "--cell", "x", "--connect", secured, "--certs", str(certs / name), *words)
        for name, words in options.items()
    }
    with Client(Options("x", (secured,), certs=certs / "guest")) as guest:
        wait_until("all are alive", lambda: set(guest.alive()) == set(options))

        def working() -> bool:
            return all(
                alive.run is not None and alive.handled > 40
                for alive in guest.ask_all("alive/*", Alive)
                if alive.service != "store"
            )

        wait_until("all work on the run", working)
        wait_until("episodes are stored", lambda: len(guest.ask_all("journal/*/*/*", JournalEpisode)) > 2)
        assert guest.ask(Q_TABLE, QTable).decisions > 0
    for name, process in processes.items():
        assert process.stop() == 0, name
        assert process.err == ""


def test_a_connection_ends_with_its_certificate_and_comes_back_with_a_new_one(
    secured: str, certs: Path, tmp_path: Path, wait_until: Callable[..., None]
) -> None:
    ours, _ = house.authority(certs)
    ours.issue(tmp_path / "guest", "guest", [], 5 / 86400)
    session = open_client([secured], 30.0, certs=tmp_path / "guest")
    assert session.info.routers_zid()
    wait_until("it is over", lambda: not session.info.routers_zid())
    ours.issue(tmp_path / "guest", "guest", [], 1)
    wait_until("it is back", session.info.routers_zid)
    session.close()  # type: ignore[no-untyped-call]


# -- who does not come in ------------------------------------------------------------------------------------------


def refusal(endpoint: str, folder: Path | None, name: str | None = None, timeout_s: float = 1.0) -> str:
    """Return the one line with which a client that cannot connect is told why."""
    with pytest.raises(CellError) as caught:
        open_client([endpoint], timeout_s, certs=folder, name=name).close()  # type: ignore[no-untyped-call]
    (line,) = str(caught.value).splitlines()
    return line


def test_a_stranger_without_a_certificate_does_not_come_in(secured: str, certs: Path) -> None:
    open_client([secured], 30.0, certs=certs / "guest").close()  # type: ignore[no-untyped-call]
    plain = secured.replace("tls/", "tcp/")
    assert plain in refusal(plain, None)
    for own in (False, True):
        tls = Identity(certs / "guest").zenoh(listen=False)
        if not own:
            tls = {"root_ca_certificate": tls["root_ca_certificate"]}
        config = zenoh.Config.from_json5(
            json.dumps(
                {
                    "mode": "client",
                    "connect": {"endpoints": [secured], "timeout_ms": 1000},
                    "scouting": {"multicast": {"enabled": False}},
                    "transport": {"link": {"tls": tls}},
                }
            )
        )
        with nullcontext() if own else pytest.raises(zenoh.ZError):
            zenoh.open(config).close()  # type: ignore[no-untyped-call]


def test_connections_that_say_nothing_keep_nobody_out(secured: str, certs: Path) -> None:
    open_client([secured], 30.0, certs=certs / "guest").close()  # type: ignore[no-untyped-call]  # it listens
    port = int(secured.rpartition(":")[2])
    with ExitStack() as silent:
        for _ in range(300):
            silent.enter_context(socket.create_connection(("127.0.0.1", port)))
        began = time.monotonic()
        open_client([secured], 30.0, certs=certs / "guest").close()  # type: ignore[no-untyped-call]
        assert time.monotonic() - began < 3.0 + BUSY_S


def test_somebody_of_another_house_is_told_so_on_either_side(
    secured: str, certs: Path, foreign: Path, tmp_path: Path
) -> None:
    assert refusal(secured, foreign / "agent") == (
        f"{secured}: we refuse the router's certificate: another authority signed it"
    )
    # Somebody who trusts the router, but whom the router does not know.
    mixed = tmp_path / "mixed"
    mixed.mkdir()
    for file in ("cert.pem", "key.pem"):
        (mixed / file).write_bytes((foreign / "agent" / file).read_bytes())
    (mixed / "ca.pem").write_bytes((certs / "ca" / "ca.pem").read_bytes() + (foreign / "ca" / "ca.pem").read_bytes())
    assert f"{secured}: the router refuses {mixed}/cert.pem: " in refusal(secured, mixed)


def test_a_router_by_another_name_is_refused(secured: str, certs: Path) -> None:
    for good in ("127.0.0.2", "localhost"):
        endpoint = secured.replace("127.0.0.1", good)
        open_client([endpoint], 30.0, certs=certs / "guest").close()  # type: ignore[no-untyped-call]
    bad = secured.replace("127.0.0.1", "127.0.0.3")
    line = refusal(bad, certs / "guest")
    assert line.startswith(f"{bad}: we refuse the router's certificate: IP address mismatch")


def test_an_address_that_zenoh_cannot_check_is_named(
    certs: Path, run_module: Callable[..., Any], wait_until: Callable[..., None]
) -> None:
    endpoint = f"tls/[::1]:{free_port()}"
    process = run_module("services.router", "--certs", str(certs / "router"), "--listen", endpoint)
    wait_until("the router listens", lambda: "listening on" in process.out or process.popen.poll() is not None)
    if process.popen.poll() is not None:
        pytest.skip("no IPv6 on this machine")
    assert "expected a host name or an IPv4 address" in refusal(endpoint, certs / "guest")


def test_nobody_there_is_told_apart(certs: Path) -> None:
    endpoint = f"tls/127.0.0.1:{free_port()}"
    assert f"{endpoint}: nobody listens: Connection refused" in refusal(endpoint, certs / "guest", timeout_s=0.3)


def test_a_router_whose_certificate_is_over_is_told_apart(certs: Path, issue: Callable[..., Path]) -> None:
    """A router would not start with it, so one has to get old: this is a plain server."""
    folder = issue("router", -10, 2)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(folder / "cert.pem", folder / "key.pem")

    def answer() -> None:
        while True:
            try:
                with server.accept()[0] as plain, context.wrap_socket(plain, server_side=True) as secured:
                    secured.recv(1)
            except ssl.SSLError:
                continue
            except OSError:
                return

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=answer, daemon=True)
        thread.start()
        endpoint = f"tls/127.0.0.1:{server.getsockname()[1]}"
        line = refusal(endpoint, certs / "guest")
        server.shutdown(socket.SHUT_RDWR)
    thread.join()
    assert line == f"{endpoint}: we refuse the router's certificate: certificate has expired"


def test_something_else_there_is_told_apart(certs: Path) -> None:
    def greet() -> None:
        while True:
            try:
                other, _ = server.accept()
            except OSError:
                return
            with other:
                other.sendall(b"220 mail.example ESMTP\r\n")

    with socket.create_server(("127.0.0.1", 0)) as server:
        thread = threading.Thread(target=greet, daemon=True)
        thread.start()
        endpoint = f"tls/127.0.0.1:{server.getsockname()[1]}"
        assert "expected a router with certificates, got: " in refusal(endpoint, certs / "guest", timeout_s=0.3)
        server.shutdown(socket.SHUT_RDWR)
    thread.join()


# -- what is refused before anything is connected --------------------------------------------------------------------


DEAD = "tls/127.0.0.1:1"


def test_a_certificate_that_is_over_is_refused_before_connecting(issue: Callable[..., Path]) -> None:
    folder = issue("agent", -10, 2)
    line = refusal(DEAD, folder, "agent")
    assert line.startswith(f"{folder}/cert.pem: expired on ")


def test_a_certificate_of_tomorrow_is_refused_before_connecting(issue: Callable[..., Path]) -> None:
    folder = issue("agent", 2, 5)
    line = refusal(DEAD, folder, "agent")
    assert line.startswith(f"{folder}/cert.pem: is not valid before ")


@pytest.mark.parametrize("file", ["ca.pem", "cert.pem", "key.pem"])
@pytest.mark.parametrize("content", [None, b"garbage\n", "another's"])
def test_files_that_do_not_belong_together_are_named(
    certs: Path, foreign: Path, tmp_path: Path, file: str, content: bytes | str | None
) -> None:
    folder = tmp_path / "agent"
    folder.mkdir()
    for each in ("ca.pem", "cert.pem", "key.pem"):
        (folder / each).write_bytes((certs / "agent" / each).read_bytes())
    if content is None:
        (folder / file).unlink()
    else:
        new = content if isinstance(content, bytes) else (foreign / "agent" / file).read_bytes()
        (folder / file).write_bytes(new)
    line = refusal(DEAD, folder, "agent")
    assert str(folder) in line and "expected" in line
    if content is None:
        assert line == f"{folder}/{file}: expected what treenail certs makes, got: No such file or directory"


def test_the_folder_above_is_noticed(certs: Path) -> None:
    assert refusal(DEAD, certs, "agent").endswith(f"No such file or directory; is it {certs}/agent?")


def test_somebody_elses_certificate_is_refused(certs: Path) -> None:
    viewer, router = certs / "viewer", certs / "router"
    assert refusal(DEAD, viewer, "agent") == (
        f"{viewer}/cert.pem: expected the certificate of agent, got that of 'viewer'"
    )
    assert f"{router}/cert.pem: expected the certificate of agent, got the router's" == refusal(DEAD, router, "agent")


@pytest.mark.parametrize(
    ("where", "with_certs", "expected"),
    [
        ("tcp/127.0.0.1:1", True, "endpoint: expected tls/HOST:PORT with --certs "),
        ("tls/127.0.0.1:1", False, "endpoint: expected --certs FOLDER with tls/127.0.0.1:1, got none"),
        ("tls/127.0.0.1", True, "endpoint: expected tls/HOST:PORT, got tls/127.0.0.1"),
    ],
)
@pytest.mark.parametrize("service", ["router", "agent"])
def test_nothing_is_half_secure(
    certs: Path, run_module: Callable[..., Any], service: str, where: str, with_certs: bool, expected: str
) -> None:
    words = ("--certs", str(certs / service)) if with_certs else ()
    process = run_module(f"services.{service}", "--listen" if service == "router" else "--connect", where, *words)
    assert process.end() == 2, process.out
    (line,) = process.err.splitlines()
    assert line.startswith(f"treenail {service}: {expected}")


def test_a_router_needs_the_routers_certificate(
    certs: Path, run_module: Callable[..., Any], issue: Callable[..., Path]
) -> None:
    cases = {
        certs / "agent": "expected the certificate of router, got a client's",
        issue("router", -10, 2): "expired on ",
    }
    for folder, expected in cases.items():
        listen = f"tls/127.0.0.1:{free_port()}"
        process = run_module("services.router", "--certs", str(folder), "--listen", listen)
        assert process.end() == 2
        (line,) = process.err.splitlines()
        assert line.startswith(f"treenail router: {folder}/cert.pem: {expected}")
