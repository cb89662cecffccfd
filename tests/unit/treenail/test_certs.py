"""``treenail certs``: what it makes, keeps, renews and refuses."""

from __future__ import annotations

import argparse
import datetime as dt
import stat
from collections.abc import Callable
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from services.bus.access import NAMES
from services.bus.tls import identity
from services.cell import authority, certificates
from services.cell.authority import AuthorityError, certificate, hosts_of
from services.cell.certificates import certify
from treenail.commands import certs


@pytest.fixture
def at(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Moves the time of day by some days from today."""
    today = dt.datetime.now(dt.UTC)

    def move(days: float) -> None:
        for module in (authority, certificates):
            monkeypatch.setattr(module, "now", lambda: today + dt.timedelta(days=days))

    return move


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_everybody_gets_a_certificate_that_the_services_take(tmp_path: Path) -> None:
    made, done = certify(tmp_path / "c", ["cell-pc", "10.0.0.5"], 90)
    assert (made.what, [row.name for row in done], {row.what for row in done}) == ("made", list(NAMES), {"made"})
    assert set(files(tmp_path / "c")) == {"ca/ca.key", "ca/ca.pem"} | {
        f"{name}/{file}" for name in NAMES for file in ("ca.pem", "cert.pem", "key.pem")
    }
    for name in NAMES:
        identity(tmp_path / "c" / name, name)
        cert = certificate(tmp_path / "c" / name / "cert.pem")
        assert [part.value for part in cert.subject.get_attributes_for_oid(NameOID.COMMON_NAME)] == [name]
        (usage,) = cert.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value
        server = name == "router"
        assert usage == (ExtendedKeyUsageOID.SERVER_AUTH if server else ExtendedKeyUsageOID.CLIENT_AUTH)
        hosts = hosts_of(cert)
        assert ({"localhost", "127.0.0.1", "::1", "router", "cell-pc", "10.0.0.5"} <= set(hosts)) == server
        assert server or hosts == []


def test_keys_are_for_their_owner_alone(tmp_path: Path) -> None:
    certify(tmp_path, [], 90)
    secrets = [tmp_path / "ca" / "ca.key", *tmp_path.glob("*/key.pem")]
    assert len(secrets) == 1 + len(NAMES)
    assert {stat.S_IMODE(path.stat().st_mode) for path in secrets} == {0o600}


def test_a_second_time_changes_nothing(tmp_path: Path) -> None:
    certify(tmp_path, ["cell-pc"], 90)
    before = files(tmp_path)
    made, done = certify(tmp_path, [], 30)
    assert files(tmp_path) == before
    assert {made.what, *(row.what for row in done)} == {"kept"}


def test_only_what_is_asked_for_is_made_and_the_rest_follows(tmp_path: Path) -> None:
    certify(tmp_path, [], 90, ["agent"])
    before = files(tmp_path)
    assert {path.split("/")[0] for path in before} == {"ca", "agent"}
    _, done = certify(tmp_path, [], 90)
    assert {row.name: row.what for row in done} == {name: "kept" if name == "agent" else "made" for name in NAMES}
    assert before.items() <= files(tmp_path).items()


def test_a_new_host_renews_the_routers_certificate_and_keeps_the_old_hosts(tmp_path: Path) -> None:
    certify(tmp_path, ["first"], 90)
    before = files(tmp_path)
    _, done = certify(tmp_path, ["second.example", "FE80::1"], 90)
    assert done[0].what == "renewed (new hosts: second.example fe80::1)"
    assert {"first", "second.example", "fe80::1"} <= set(hosts_of(certificate(tmp_path / "router" / "cert.pem")))
    changed = {path for path, content in files(tmp_path).items() if before[path] != content}
    assert changed == {"router/cert.pem", "router/key.pem"}


@pytest.mark.parametrize(
    ("days", "later", "renewed"),
    [(365, 334, False), (365, 336, True), (365, 400, True), (6, 3, False), (6, 5, True)],
)
def test_what_expires_soon_is_renewed(
    tmp_path: Path, at: Callable[[float], None], days: int, later: float, renewed: bool
) -> None:
    certify(tmp_path, [], days, ["agent"])
    at(later)
    made, (done,) = certify(tmp_path, [], days, ["agent"])
    assert made.what == "kept"
    assert done.what.startswith("renewed (expire") == renewed
    left = certificate(tmp_path / "agent" / "cert.pem").not_valid_after_utc - authority.now()
    assert (left > dt.timedelta(days=days - 1)) == renewed


def test_no_certificate_outlives_its_authority(tmp_path: Path, at: Callable[[float], None]) -> None:
    certify(tmp_path, [], 90, ["agent"])
    at(authority.CA_DAYS - 10)
    made, (done,) = certify(tmp_path, [], 90, ["agent"])
    assert done.until == made.until
    at(authority.CA_DAYS + 1)
    with pytest.raises(AuthorityError, match=r"ca\.pem: expired on \d{4}-\d\d-\d\d"):
        certify(tmp_path, [], 90, ["agent"])


@pytest.mark.parametrize("file", ["key.pem", "ca.pem"])
def test_what_is_missing_or_damaged_is_made_good(tmp_path: Path, file: str) -> None:
    certify(tmp_path, [], 90, ["agent"])
    (tmp_path / "agent" / file).write_text("garbage")
    _, (done,) = certify(tmp_path, [], 90, ["agent"])
    assert done.what == ("made again (it was damaged)" if file == "key.pem" else "kept (ca.pem put back)")
    identity(tmp_path / "agent", "agent")


def test_somebody_elses_certificate_in_a_folder_is_replaced(tmp_path: Path) -> None:
    certify(tmp_path, [], 90, ["agent", "viewer"])
    for path in (tmp_path / "viewer").iterdir():
        (tmp_path / "agent" / path.name).write_bytes(path.read_bytes())
    _, done = certify(tmp_path, [], 90, ["agent", "viewer"])
    assert [row.what for row in done] == ["made again (it was damaged)", "kept"]
    identity(tmp_path / "agent", "agent")


def refused(folder: Path) -> str:
    """Return why nothing is done, having looked that nothing is."""
    before = files(folder)
    with pytest.raises(AuthorityError) as caught:
        certify(folder, [], 90)
    assert files(folder) == before
    (line,) = str(caught.value).splitlines()
    return line


def test_another_authority_is_never_mixed_in(tmp_path: Path) -> None:
    ours, theirs = tmp_path / "ours", tmp_path / "theirs"
    certify(ours, [], 90)
    certify(theirs, [], 90)
    (ours / "agent" / "cert.pem").write_bytes((theirs / "agent" / "cert.pem").read_bytes())
    assert f"{ours}/agent/cert.pem: expected one of the authority in {ours}/ca" in refused(ours)
    (theirs / "ca" / "ca.key").write_bytes((ours / "ca" / "ca.key").read_bytes())
    assert refused(theirs) == f"{theirs}/ca/ca.key: expected the key of ca.pem, got another one"


def test_an_authority_that_is_gone_is_not_replaced(tmp_path: Path) -> None:
    certify(tmp_path, [], 90)
    key = tmp_path / "ca" / "ca.key"
    key.rename(tmp_path / "safe")
    assert f"{key}: expected it beside ca.pem" in refused(tmp_path)
    (tmp_path / "ca" / "ca.pem").unlink()
    assert "expected the authority that signed" in refused(tmp_path)


@pytest.mark.parametrize(("file", "expected"), [("ca.pem", "a certificate in PEM"), ("ca.key", "a private key in PEM")])
def test_an_authority_that_is_damaged_is_not_replaced(tmp_path: Path, file: str, expected: str) -> None:
    certify(tmp_path, [], 90)
    (tmp_path / "ca" / file).write_text("garbage")
    assert f"{tmp_path}/ca/{file}: expected {expected}" in refused(tmp_path)


def test_a_service_is_no_authority(tmp_path: Path) -> None:
    certify(tmp_path / "a", [], 90, ["agent"])
    place = tmp_path / "b" / "ca"
    place.mkdir(parents=True)
    (place / "ca.pem").write_bytes((tmp_path / "a" / "agent" / "cert.pem").read_bytes())
    (place / "ca.key").write_bytes((tmp_path / "a" / "agent" / "key.pem").read_bytes())
    assert "expected an authority's certificate, got another kind" in refused(tmp_path / "b")


def test_a_folder_that_cannot_be_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(AuthorityError, match=r"file/c/ca/ca\.key: cannot be written: Not a directory"):
        certify(tmp_path / "file" / "c", [], 90)


@pytest.mark.parametrize("host", ["", "a b", "-x", "x-", "a..b", "1.2.3", "tls/x", "x:7447", "ä", "z" * 64])
def test_a_host_that_cannot_be_is_refused_and_nothing_is_made(tmp_path: Path, host: str) -> None:
    with pytest.raises(AuthorityError, match=r"^--host: expected a host name or an IP address, got "):
        certify(tmp_path / "c", [host], 90)
    assert not (tmp_path / "c").exists()


def test_the_command_says_what_it_did(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    parser = argparse.ArgumentParser()
    certs.add_arguments(parser)
    words = ["--out", str(tmp_path / "c"), "--host", "x", "y", "--host", "10.1.2.3", "--only", "router", "agent"]
    certs.act(parser.parse_args(words))
    said = capsys.readouterr().out
    for word in ("ca ", "router", "agent", "made", "10.1.2.3", "stays here, and secret"):
        assert word in said
    assert "viewer" not in said


@pytest.mark.parametrize("days", ["0", "-1", "3651"])
def test_a_length_that_cannot_be_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str], days: str) -> None:
    parser = argparse.ArgumentParser()
    certs.add_arguments(parser)
    with pytest.raises(SystemExit):
        parser.parse_args(["--out", str(tmp_path / "c"), "--days", days])
    assert f"--days: expected a whole number from 1 to 3650, got '{days}'" in capsys.readouterr().err
