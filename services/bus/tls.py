"""Mutual TLS: who we are, checked before connecting, and why a handshake with the router failed.

Zenoh does the encryption and the checking; what it says about a failure is only that it could not connect. So the same
files are tried here with Python's own ``ssl``, which can say more.
"""

from __future__ import annotations

import re
import socket
import ssl
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from services.bus.access import ROUTER
from services.wire.errors import CellError

SCHEME = "tls/"
HANDSHAKE_S = 2.0
_REFUSED_WITHIN_S = 0.5
"""A router that does not like our certificate says so at once, but only after its own part of the handshake."""
_NO_CHECK_TIME = 0x200000
"""OpenSSL's X509_V_FLAG_NO_CHECK_TIME: dates are checked by us, who can say what they are."""

_UNKNOWN_ISSUER = (7, 18, 19, 20, 21, 30)
"""OpenSSL's codes for a signature that is wrong, missing, or of nobody we know."""
_WRONG_PURPOSE = 26


@dataclass(frozen=True)
class Identity:
    """The three files that say who we are."""

    folder: Path

    @property
    def ca(self) -> Path:
        """Certificate of the authority that signs for everybody in the house."""
        return self.folder / "ca.pem"

    @property
    def cert(self) -> Path:
        """Our certificate."""
        return self.folder / "cert.pem"

    @property
    def key(self) -> Path:
        """Our private key."""
        return self.folder / "key.pem"

    def zenoh(self, *, listen: bool) -> dict[str, object]:
        """Return Zenoh's TLS settings for the router (``listen``) or a client."""
        side = "listen" if listen else "connect"
        return {
            "root_ca_certificate": str(self.ca.resolve()),
            f"{side}_certificate": str(self.cert.resolve()),
            f"{side}_private_key": str(self.key.resolve()),
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        }


def check_endpoints(endpoints: Sequence[str], certs: Path | None) -> None:
    """Raise CellError for an endpoint that is not encrypted though there are certificates, or is without any."""
    for endpoint in endpoints:
        if certs is not None and endpoint.startswith(SCHEME):
            _address(endpoint)
        if certs is not None and not endpoint.startswith(SCHEME):
            raise CellError(f"endpoint: expected {SCHEME}HOST:PORT with --certs {certs}, got {endpoint}")
        if certs is None and endpoint.startswith(SCHEME):
            raise CellError(f"endpoint: expected --certs FOLDER with {endpoint}, got none; see treenail certs --help")


def identity(folder: Path, name: str | None) -> Identity:
    """Return who we are, by the files in ``folder``; ``name`` is who we ought to be, None for anybody but the router.

    Raises CellError when a file is missing or unreadable, when key, certificate and authority do not belong together,
    when the certificate is not valid now, and when it is somebody else's.
    """
    us = Identity(folder)
    for path in (us.ca, us.cert, us.key):
        try:
            path.read_bytes()
        except OSError as error:
            inside = f"; is it {folder / name}?" if name is not None and (folder / name).is_dir() else ""
            raise CellError(f"{path}: expected what treenail certs makes, got: {error.strerror}{inside}") from None
    certificate = _seen_by_peer(us, name)
    got = _name(certificate)
    if name is not None and got != name:
        raise CellError(f"{us.cert}: expected the certificate of {name}, got that of {got!r}")
    now = time.time()
    for when, wrong in (("notBefore", "is not valid before"), ("notAfter", "expired on")):
        moment = str(certificate[when])
        if (ssl.cert_time_to_seconds(moment) > now) == (when == "notBefore"):
            today = time.strftime("%b %d %H:%M:%S %Y GMT", time.gmtime(now))
            raise CellError(f"{us.cert}: {wrong} {moment}, and it is {today}; treenail certs renews it")
    return us


def common_name(folder: Path) -> str:
    """Return whose certificate is in a folder of a client. Raises CellError like ``identity``."""
    return _name(_seen_by_peer(identity(folder, None), None))


class Trouble(NamedTuple):
    """Why a handshake with a router failed."""

    reason: str
    final: bool
    """Whether waiting does not help: files have to be changed, here or there."""


def trouble(endpoint: str, us: Identity) -> Trouble | None:
    """Return why the router at ``endpoint`` and we cannot agree; None when nothing is wrong."""
    host, port = _address(endpoint)
    context = _context(ssl.PROTOCOL_TLS_CLIENT, us)
    try:
        plain = socket.create_connection((host, port), timeout=HANDSHAKE_S)
    except OSError as error:
        return Trouble(f"{endpoint}: nobody listens: {error.strerror or error}", final=False)
    try:
        with plain, context.wrap_socket(plain, server_hostname=host) as secured:
            secured.settimeout(_REFUSED_WITHIN_S)
            with suppress(TimeoutError):  # it has nothing against us
                secured.recv(1)
    except ssl.SSLCertVerificationError as error:
        return Trouble(f"{endpoint}: we refuse the router's certificate: {_reason(error)}", final=True)
    except ssl.SSLError as error:
        if "ALERT" in (error.reason or ""):
            return Trouble(f"{endpoint}: the router refuses {us.cert}: {_reason(error)}", final=True)
        return Trouble(f"{endpoint}: expected a router with certificates, got: {_reason(error)}", final=False)
    except OSError as error:
        return Trouble(f"{endpoint}: expected a router with certificates, got: {error}", final=False)
    if ":" in host:
        return Trouble(
            f"{endpoint}: expected a host name or an IPv4 address: Zenoh takes no IPv6 with tls/", final=True
        )
    return None


def _context(protocol: ssl._SSLMethod, us: Identity) -> ssl.SSLContext:
    """Return a context with our files. Raises CellError when they are not what they should be."""
    context = ssl.SSLContext(protocol)
    try:
        context.load_verify_locations(us.ca)
    except ssl.SSLError as error:
        raise CellError(f"{us.ca}: expected an authority's certificate: {_reason(error)}") from None
    try:
        context.load_cert_chain(us.cert, us.key, password=lambda: b"")
    except ssl.SSLError as error:
        if error.reason == "KEY_VALUES_MISMATCH":
            raise CellError(f"{us.key}: expected the key of {us.cert}, got another one") from None
        raise CellError(f"{us.cert}, {us.key}: expected a certificate and its key: {_reason(error)}") from None
    return context


def _seen_by_peer(us: Identity, name: str | None) -> dict[str, object]:
    """Return our certificate as the other side sees it, which trusts the same authority.

    It is presented in a handshake in memory, as the router's or as a client's. Raises CellError when it is refused.
    """
    server = name == ROUTER
    ours, theirs = _context(ssl.PROTOCOL_TLS_SERVER, us), _context(ssl.PROTOCOL_TLS_CLIENT, us)
    theirs.check_hostname = False
    theirs.verify_mode = ssl.CERT_REQUIRED if server else ssl.CERT_NONE
    ours.verify_mode = ssl.CERT_NONE if server else ssl.CERT_REQUIRED
    for context in (ours, theirs):
        context.verify_flags |= _NO_CHECK_TIME
    up, down = ssl.MemoryBIO(), ssl.MemoryBIO()
    listening = ours.wrap_bio(up, down, server_side=True)
    calling = theirs.wrap_bio(down, up)
    try:
        for side in (calling, listening, calling, listening):
            try:
                side.do_handshake()
            except ssl.SSLWantReadError:
                continue
    except ssl.SSLCertVerificationError as error:
        if error.verify_code == _WRONG_PURPOSE:
            expected, got = (ROUTER, "a client's") if server else (name or "a client", "the router's")
            raise CellError(f"{us.cert}: expected the certificate of {expected}, got {got}") from None
        raise CellError(f"{us.cert}: expected to be signed by {us.ca}: {_reason(error)}") from None
    except ssl.SSLError as error:
        raise CellError(f"{us.cert}: cannot be used: {_reason(error)}") from None
    seen = (calling if server else listening).getpeercert()
    if not seen:
        raise CellError(f"{us.cert}: expected a certificate that can be verified, got none")
    return dict(seen)


def _name(certificate: dict[str, object]) -> str:
    """Return the common name in a certificate as ``ssl`` reads it."""
    subject = certificate.get("subject", ())
    assert isinstance(subject, tuple)
    return next((value for part in subject for key, value in part if key == "commonName"), "")


def _address(endpoint: str) -> tuple[str, int]:
    """Return host and port of an endpoint such as tls/[::1]:7447. Raises CellError when it has none."""
    address = re.match(r"^tls/\[?([^\]/#?]+?)\]?:(\d{1,5})(?:[#?].*)?\Z", endpoint)
    if address is None or not 0 < int(address[2]) < 65536:
        raise CellError(f"endpoint: expected {SCHEME}HOST:PORT, got {endpoint}")
    return address[1], int(address[2])


def _reason(error: ssl.SSLError) -> str:
    """Return OpenSSL's reason in words."""
    if isinstance(error, ssl.SSLCertVerificationError):
        strange = error.verify_code in _UNKNOWN_ISSUER
        return "another authority signed it" if strange else error.verify_message.rstrip(".")
    return (error.reason or str(error)).replace("_", " ").lower()
