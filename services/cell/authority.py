"""A small certificate authority in a folder: it signs one certificate for each service and person of the house.

``<folder>/ca/`` holds its key, and ``<folder>/<name>/`` what one machine needs: ca.pem, cert.pem and key.pem.
"""

from __future__ import annotations

import datetime as dt
import ipaddress
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from services.wire.errors import TreenailError

CA_DAYS = 3650
SKEW = dt.timedelta(hours=1)
"""How long before now a certificate begins to be valid: clocks of machines differ."""


class AuthorityError(TreenailError):
    """The folder does not hold what it should, or cannot be written to."""


@dataclass(frozen=True)
class Authority:
    """A certificate and the key that signs."""

    cert: x509.Certificate
    key: ec.EllipticCurvePrivateKey

    @property
    def pem(self) -> bytes:
        """The certificate as it is given to everybody."""
        return self.cert.public_bytes(serialization.Encoding.PEM)

    def signed(self, cert: x509.Certificate) -> bool:
        """Return whether this authority signed a certificate."""
        try:
            cert.verify_directly_issued_by(self.cert)
        except (InvalidSignature, ValueError, TypeError):
            return False
        return True

    def issue(self, folder: Path, name: str, hosts: Sequence[str], days: float) -> x509.Certificate:
        """Make a new key and certificate of ``name`` in ``folder``, and return it.

        With ``hosts`` it is a server's that is reached by those names and addresses, otherwise a client's. It is valid
        for ``days``, but not longer than the authority.
        """
        key = ec.generate_private_key(ec.SECP256R1())
        usage = ExtendedKeyUsageOID.SERVER_AUTH if hosts else ExtendedKeyUsageOID.CLIENT_AUTH
        until = min(now() + dt.timedelta(days=days), self.cert.not_valid_after_utc)
        builder = (
            _builder(name, self.cert.subject, key, until)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_key_usage(sign=False), critical=True)
            .add_extension(x509.ExtendedKeyUsage([usage]), critical=False)
            .add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(self.key.public_key()),
                critical=False,
            )
        )
        if hosts:
            builder = builder.add_extension(x509.SubjectAlternativeName([_general(host) for host in hosts]), False)
        cert = builder.sign(self.key, hashes.SHA256())
        write(folder / "ca.pem", self.pem)
        write(folder / "key.pem", _private(key), secret=True)
        write(folder / "cert.pem", cert.public_bytes(serialization.Encoding.PEM))
        return cert


def now() -> dt.datetime:
    """Return the time of day that certificates are judged by."""
    return dt.datetime.now(dt.UTC)


def authority(folder: Path) -> tuple[Authority, bool]:
    """Return the authority in ``folder``/ca, and whether it was made just now because there was no trace of one.

    Raises AuthorityError when there is half of one, or a certificate of one that is not there.
    """
    place = folder / "ca"
    cert_file, key_file = place / "ca.pem", place / "ca.key"
    here = [path for path in (cert_file, key_file) if path.exists()]
    if not here:
        strays = sorted(folder.glob("*/ca.pem"))
        if strays:
            raise AuthorityError(
                f"{place}: expected the authority that signed {strays[0].parent}, got none; "
                "put its ca.pem and ca.key there, or take another folder"
            )
        return _made(cert_file, key_file), True
    if len(here) == 1:
        missing = key_file if cert_file in here else cert_file
        raise AuthorityError(f"{missing}: expected it beside {here[0].name}, got nothing; put it back")
    found = Authority(certificate(cert_file), private_key(key_file))
    if not _fits(found.cert, found.key):
        raise AuthorityError(f"{key_file}: expected the key of {cert_file.name}, got another one")
    if not _is_authority(found.cert):
        raise AuthorityError(f"{cert_file}: expected an authority's certificate, got another kind")
    if found.cert.not_valid_after_utc <= now():
        raise AuthorityError(f"{cert_file}: expired on {found.cert.not_valid_after_utc:%Y-%m-%d}; take another folder")
    return found, False


def certificate(path: Path) -> x509.Certificate:
    """Return the certificate in a file. Raises AuthorityError."""
    try:
        return x509.load_pem_x509_certificate(read(path))
    except ValueError:
        raise AuthorityError(f"{path}: expected a certificate in PEM, got something else") from None


def private_key(path: Path) -> ec.EllipticCurvePrivateKey:
    """Return the key in a file. Raises AuthorityError."""
    try:
        found = serialization.load_pem_private_key(read(path), password=None)
    except (ValueError, TypeError):
        raise AuthorityError(f"{path}: expected a private key in PEM without a password, got something else") from None
    if not isinstance(found, ec.EllipticCurvePrivateKey):
        raise AuthorityError(f"{path}: expected a key of kind EC, got another kind")
    return found


def intact(folder: Path, name: str) -> x509.Certificate | None:
    """Return the certificate in a folder when it can be read, is that of ``name`` and its key fits, otherwise None."""
    try:
        cert, key = certificate(folder / "cert.pem"), private_key(folder / "key.pem")
    except AuthorityError:
        return None
    names = [part.value for part in cert.subject.get_attributes_for_oid(NameOID.COMMON_NAME)]
    return cert if names == [name] and _fits(cert, key) else None


def hosts_of(cert: x509.Certificate) -> list[str]:
    """Return the names and addresses in a server's certificate."""
    try:
        names = cert.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except x509.ExtensionNotFound:
        return []
    return [str(name.value) for name in names]


def check_host(host: str) -> str:
    """Return an address in its usual form, or a host name. Raises AuthorityError for something else."""
    try:
        return str(ipaddress.ip_address(host))
    except ValueError:
        pass
    labels = host.split(".")
    if len(host) <= 253 and all(_is_label(label) for label in labels) and not labels[-1].isdigit():
        return host.lower()
    raise AuthorityError(f"--host: expected a host name or an IP address, got {host!r}")


def read(path: Path) -> bytes:
    """Return what a file holds. Raises AuthorityError."""
    try:
        return path.read_bytes()
    except OSError as error:
        raise AuthorityError(f"{path}: cannot be read: {error.strerror}") from None


def write(path: Path, content: bytes, *, secret: bool = False) -> None:
    """Write a file in one step; a ``secret`` one is for its owner alone. Raises AuthorityError."""
    aside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        aside.unlink(missing_ok=True)
        with open(os.open(aside, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600 if secret else 0o644), "wb") as file:
            file.write(content)
        aside.replace(path)
    except OSError as error:
        raise AuthorityError(f"{path}: cannot be written: {error.strerror}") from None


def _made(cert_file: Path, key_file: Path) -> Authority:
    """Make an authority and write it."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = "Treenail certificate authority"
    builder = (
        _builder(name, None, key, now() + dt.timedelta(days=CA_DAYS))
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_key_usage(sign=True), critical=True)
    )
    found = Authority(builder.sign(key, hashes.SHA256()), key)
    write(key_file, _private(key), secret=True)
    write(cert_file, found.pem)
    return found


def _builder(
    name: str, issuer: x509.Name | None, key: ec.EllipticCurvePrivateKey, until: dt.datetime
) -> x509.CertificateBuilder:
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer or subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now() - SKEW)
        .not_valid_after(until)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )


def _key_usage(*, sign: bool) -> x509.KeyUsage:
    """Return what a key is for: to sign certificates, or to sign handshakes."""
    never = dict.fromkeys(
        ("content_commitment", "key_encipherment", "data_encipherment", "key_agreement", "encipher_only"), False
    )
    return x509.KeyUsage(digital_signature=not sign, key_cert_sign=sign, crl_sign=sign, decipher_only=False, **never)


def _general(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _private(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )


def _fits(cert: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> bool:
    public = cert.public_key()
    return isinstance(public, ec.EllipticCurvePublicKey) and public == key.public_key()


def _is_authority(cert: x509.Certificate) -> bool:
    try:
        return cert.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    except x509.ExtensionNotFound:
        return False


def _is_label(label: str) -> bool:
    plain = label.replace("-", "").replace("_", "")
    return 0 < len(label) < 64 and plain.isascii() and plain.isalnum() and label[0] != "-" and label[-1] != "-"
