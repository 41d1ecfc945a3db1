"""A CA on disk that issues a certificate a role: keys on the curve P-256, files for their owner.

The purpose of a certificate (extended key usage) is part of it: a viewer's cannot stand for a
vehicle, and a vehicle's cannot link to another.
"""

import datetime
import ipaddress
import os
import re
from collections.abc import Sequence
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from juncnet.access import Role
from juncnet.identity import CA, CERTIFICATE, KEY

AUTHORITY_DAYS = 3650
EARLIER = datetime.timedelta(days=1)
"""Certificates are valid from this long ago: clocks differ."""
ALWAYS = ("localhost", "127.0.0.1", "::1")
HOST_NAME = re.compile(
    r"[A-Za-z0-9]([A-Za-z0-9-]*[A-Za-z0-9])?(\.[A-Za-z0-9]([A-Za-z0-9-]*[A-Za-z0-9])?)*"
)


class Authority:
    """A CA: its certificate and its key."""

    def __init__(self, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey) -> None:
        self.certificate, self._key = certificate, key

    def issue(self, folder: Path, role: Role, hosts: Sequence[str], days: int) -> None:
        """Write CA, a new certificate of `role` and its key into `folder`.

        Raises:
            ValueError: a host is neither a name nor an address.
        """
        server = role is Role.DRONE
        purpose = ExtendedKeyUsageOID.SERVER_AUTH if server else ExtendedKeyUsageOID.CLIENT_AUTH
        key = ec.generate_private_key(ec.SECP256R1())
        builder = (
            _builder(_name(role), key, days)
            .issuer_name(self.certificate.subject)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.ExtendedKeyUsage([purpose]), critical=True)
            .add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(self._key.public_key()),
                critical=False,
            )
        )
        if server:
            names = [_general_name(host_name(host)) for host in dict.fromkeys([*hosts, *ALWAYS])]
            builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
        _make_private(folder)
        _write(folder / CA, _pem(self.certificate))
        _write(folder / KEY, _key_pem(key))
        _write(folder / CERTIFICATE, _pem(builder.sign(self._key, hashes.SHA256())))


def open_authority(folder: Path) -> Authority:
    """Return the CA in `folder`, made if there is none.

    Raises:
        ValueError: what is there is no CA of ours.
    """
    if not (folder / KEY).exists():
        _found(folder)
    try:
        certificate = x509.load_pem_x509_certificate((folder / CA).read_bytes())
        key = serialization.load_pem_private_key((folder / KEY).read_bytes(), None)
    except (ValueError, TypeError, OSError) as error:
        raise ValueError(
            f"{folder}: not a CA ({error}): --new-authority makes a new one"
        ) from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise ValueError(f"{folder / KEY}: not a key of ours: --new-authority makes a new one")
    return Authority(certificate, key)


def issued_hosts(folder: Path) -> tuple[str, ...]:
    """Return the names and addresses of the certificate in `folder`, valid or not; none without."""
    try:
        certificate = x509.load_pem_x509_certificate((folder / CERTIFICATE).read_bytes())
        names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (OSError, ValueError, x509.ExtensionNotFound):
        return ()
    return tuple(str(n.value) for n in names if isinstance(n, (x509.DNSName, x509.IPAddress)))


def _found(folder: Path) -> None:
    key = ec.generate_private_key(ec.SECP256R1())
    name = _name("JuncNet CA")
    usage = x509.KeyUsage(
        digital_signature=False,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=True,
        crl_sign=True,
        encipher_only=False,
        decipher_only=False,
    )
    certificate = (
        _builder(name, key, AUTHORITY_DAYS)
        .issuer_name(name)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .sign(key, hashes.SHA256())
    )
    _make_private(folder)
    _write(folder / CA, _pem(certificate))
    _write(folder / KEY, _key_pem(key))


def _builder(
    subject: x509.Name, key: ec.EllipticCurvePrivateKey, days: int
) -> x509.CertificateBuilder:
    now = datetime.datetime.now(datetime.UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - EARLIER)
        .not_valid_after(now + datetime.timedelta(days=days))
    )


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def host_name(text: str) -> str:
    """Return a host's name, or its address in the short form.

    Raises:
        ValueError: it is neither.
    """
    try:
        return str(ipaddress.ip_address(text))
    except ValueError:
        if HOST_NAME.fullmatch(text) is None:
            raise ValueError(f"--host {text}: neither a host name nor an address") from None
        return text


def _general_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _pem(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)


def _key_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )


def _make_private(folder: Path) -> None:
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    folder.chmod(0o700)


def _write(path: Path, data: bytes) -> None:
    """Write a file that only its owner can read, in one step."""
    draft = path.with_suffix(".new")
    draft.unlink(missing_ok=True)
    handle = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(handle, "wb") as file:
        file.write(data)
    draft.replace(path)
