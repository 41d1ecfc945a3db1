"""Certificates as a process uses them: a folder with `ca.pem`, `certificate.pem` and `key.pem`.

`deploy/certificates` makes one such folder a role. Reading one tries a TLS handshake in memory,
with the standard library: what fails here would fail on a link, where Zenoh only says that nobody
is there.
"""

import contextlib
import ipaddress
import ssl
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

from juncnet.access import Role

CERTIFICATES_VARIABLE = "JUNCNET_CERTIFICATES"
"""Environment variable with the folder that tools use when none is named."""
CA, CERTIFICATE, KEY = "ca.pem", "certificate.pem", "key.pem"
REMEDY = "make and copy certificates with deploy/certificates"


class IdentityError(ValueError):
    """Certificates cannot be used; the text names the file, the cause and the remedy."""


@dataclass(frozen=True)
class Identity:
    """A certificate that its CA has signed, in date, with its key."""

    folder: Path
    role: Role
    ends: datetime
    """When it expires, in UTC."""
    hosts: tuple[str, ...] = ()
    """Names and addresses under which a vehicle may be dialled; empty for other roles."""

    @property
    def is_server(self) -> bool:
        """Whether it lets others in, rather than dialling."""
        return self.role is Role.DRONE

    def tls(self) -> dict[str, Any]:
        """Return the section `transport.link.tls` of a Zenoh configuration."""
        end = "listen" if self.is_server else "connect"
        return {
            "root_ca_certificate": str(self.folder / CA),
            f"{end}_certificate": str(self.folder / CERTIFICATE),
            f"{end}_private_key": str(self.folder / KEY),
            "enable_mtls": True,
            # Zenoh trusts the web's public CAs too: only the name tells our vehicle from theirs.
            "verify_name_on_connect": True,
        }


def read_identity(folder: Path) -> Identity:
    """Return the identity in `folder`.

    Raises:
        IdentityError: a file is missing, the key can be read by others or is another's, the
            certificate is of another CA, out of date or of no role.
    """
    folder = folder.expanduser().absolute()
    for name in (CA, CERTIFICATE, KEY):
        if not (folder / name).is_file():
            raise IdentityError(f"{folder / name}: there is no such file: {REMEDY}")
    if (folder / KEY).stat().st_mode & 0o077:
        raise IdentityError(f"{folder / KEY}: others can read it: chmod 600 {folder / KEY}")
    try:
        fields = _shake_hands(folder)
    except ssl.SSLCertVerificationError as error:
        path = folder / CERTIFICATE
        raise IdentityError(f"{path}: {error.verify_message}: {REMEDY}") from error
    except (ssl.SSLError, OSError) as error:
        raise IdentityError(f"{folder}: {error}: {REMEDY}") from error
    return _identity(folder, fields)


def _identity(folder: Path, fields: Mapping[str, Any]) -> Identity:
    names = [value for part in fields["subject"] for key, value in part if key == "commonName"]
    if names not in [[role] for role in Role]:
        known = ", ".join(Role)
        raise IdentityError(
            f"{folder / CERTIFICATE}: it is of {names}, which is no role ({known}): {REMEDY}"
        )
    ends = datetime.fromtimestamp(ssl.cert_time_to_seconds(fields["notAfter"]), UTC)
    hosts = tuple(_host(str(value)) for _, value in fields.get("subjectAltName", ()))
    return Identity(folder, Role(names[0]), ends, hosts)


def _host(name: str) -> str:
    """Return an address in its short form, a name as it is."""
    try:
        return str(ipaddress.ip_address(name))
    except ValueError:
        return name


def _shake_hands(folder: Path) -> Mapping[str, Any]:
    """Return the fields of the certificate as the other end of a link sees them.

    It is shown to a server, then to a client: it is good for one of them.

    Raises:
        ssl.SSLError: the other end does not accept it.
    """
    try:
        return _shown_to_server(folder)
    except ssl.SSLCertVerificationError as error:
        if "purpose" not in error.verify_message:
            raise
    return _shown_to_client(folder)


def _shown_to_server(folder: Path) -> Mapping[str, Any]:
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    server.load_cert_chain(folder / CERTIFICATE, folder / KEY)
    server.load_verify_locations(folder / CA)
    server.verify_mode = ssl.CERT_REQUIRED
    client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.check_hostname, client.verify_mode = False, ssl.CERT_NONE
    client.load_cert_chain(folder / CERTIFICATE, folder / KEY)
    return _fields(_handshake(client, server)[1])


def _shown_to_client(folder: Path) -> Mapping[str, Any]:
    server = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    server.load_cert_chain(folder / CERTIFICATE, folder / KEY)
    client = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    client.check_hostname = False
    client.load_verify_locations(folder / CA)
    return _fields(_handshake(client, server)[0])


def _handshake(
    client_side: ssl.SSLContext, server_side: ssl.SSLContext
) -> tuple[ssl.SSLObject, ssl.SSLObject]:
    """Run a handshake in memory and return both ends."""
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    client = client_side.wrap_bio(to_client, to_server)
    server = server_side.wrap_bio(to_server, to_client, server_side=True)
    for _ in range(3):  # hello; answer with the certificate; the client's end of it
        for end in (client, server):
            with contextlib.suppress(ssl.SSLWantReadError):
                end.do_handshake()
    return client, server


def _fields(end: ssl.SSLObject) -> Mapping[str, Any]:
    return cast("Mapping[str, Any]", end.getpeercert() or {})
