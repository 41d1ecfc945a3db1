"""What `juncnet doctor` sees of links: certificates and their dates, clocks, who can be reached.

The vehicle's router is dialled with TLS as Zenoh would: what is wrong there is named here.
"""

import contextlib
import socket
import ssl
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

from juncnet.access import Role
from juncnet.flight import flights_root
from juncnet.identity import CA, CERTIFICATE, KEY, Identity, IdentityError, read_identity
from juncnet.layout import Layout
from juncnet.links import ROUTER, is_loopback
from juncnet_services.cli.doctor.findings import Finding, failure, ok, warning

SOON = timedelta(days=30)
PLAUSIBLE = datetime(2026, 1, 1, tzinfo=UTC)
"""No clock that is right shows less."""
DIAL_S = 3.0
REFUSAL_S = 0.5
"""With TLS 1.3 a router tells only after the handshake that it refuses our certificate."""
MAKE = "make and copy certificates with deploy/certificates"


def certificates(layout: Layout, now: datetime) -> Iterator[Finding]:
    """Look at this host's certificates; `now` is the wall clock's time in UTC."""
    about, folder = "certificates", layout.links.certificates
    if folder is None:
        yield _without_certificates(layout)
        return
    try:
        identity = read_identity(folder)
    except IdentityError as error:
        text, _, remedy = str(error).rpartition(": ")
        yield failure(about, text, remedy)
        return
    wanted = Role.NAVIGATION if layout.links.vehicle is not None else Role.DRONE
    if identity.role is not wanted:
        yield failure(
            about,
            f"{identity.folder} is of role {identity.role}, this layout needs {wanted}",
            f"name the folder of {wanted} in [links] certificates",
        )
        return
    left = identity.ends - now
    text = f"{identity.role}, until {identity.ends:%Y-%m-%d} ({left.days} days)"
    if identity.hosts:
        text += f", dialled as {', '.join(identity.hosts)}"
    if left < SOON:
        renew = f"deploy/certificates --renew {identity.role}, and copy it here"
        yield warning(about, text, renew)
    else:
        yield ok(about, text)


def _without_certificates(layout: Layout) -> Finding:
    open_to_all = layout.links.allow_anyone_on_the_network_to_fly_this_robot
    if open_to_all:
        return warning(
            "certificates", "none: ANYONE ON THE NETWORK CAN FLY THIS ROBOT", f"{MAKE}, unless so"
        )
    return ok("certificates", "none: links on this host only, where any local user can command")


def wall_clock(now: datetime) -> Finding:
    """Look at the wall clock, by which certificates are judged."""
    if now < PLAUSIBLE:
        return failure(
            "clock",
            f"this host believes that it is {now:%Y-%m-%d %H:%M}: certificates will not be valid",
            "set it (timedatectl set-time, or NTP); a computer without a clock battery forgets it",
        )
    return ok("clock", f"{now:%Y-%m-%d %H:%M} UTC")


def sockets() -> Finding:
    """Look at the directory in which processes of this host meet."""
    try:
        root = flights_root()
        mode = root.stat().st_mode & 0o777
    except OSError as error:
        return failure("sockets", str(error), "set XDG_RUNTIME_DIR to a directory of your own")
    if mode & 0o077:
        return failure("sockets", f"others can enter {root} ({mode:o})", f"chmod 700 {root}")
    return ok("sockets", f"{root} is private")


def router(layout: Layout, runs: bool) -> Iterator[Finding]:
    """Look at where this layout lets others in; `runs`: whether it does so already."""
    if ROUTER not in layout.processes:
        return
    section = layout.sections.get(ROUTER, {})
    host, port = str(section.get("host", "127.0.0.1")), int(section.get("port", 0))
    with_tls = "with certificates" if layout.links.certificates else "without certificates"
    text = f"lets others in on {host}:{port or 'any free port'}, {with_tls}"
    for number in (port, int(section.get("video_port") or 0)):
        if number and not runs and not _is_free(host, number):
            yield failure(
                "router",
                f"{host}:{number} is taken or not an address of this host",
                "end the other program (ss -ltnp), or choose another in [router]",
            )
            return
    yield ok("router", text)


def vehicle_link(layout: Layout) -> Iterator[Finding]:
    """Dial the vehicle's router, and say what stands in the way."""
    links = layout.links
    identity: Identity | None = None
    if links.certificates is not None:
        with contextlib.suppress(IdentityError):
            identity = read_identity(links.certificates)
    for address in (links.vehicle, links.video):
        if address is not None:
            yield dial(address, identity)


def dial(address: str, identity: Identity | None) -> Finding:
    """Link to the router at `address` (host:port) as Zenoh would, and end that link."""
    host, _, port = address.rpartition("/")[2].rpartition(":")
    host = host.strip("[]")
    about = "link"
    try:
        began = time.monotonic()
        with socket.create_connection((host, int(port)), DIAL_S) as link:
            if identity is not None:
                _shake_hands(link, host, identity)
            took_ms = 1000 * (time.monotonic() - began)
    except ssl.SSLCertVerificationError as error:
        named = "mismatch" in error.verify_message or "doesn't match" in error.verify_message
        remedy = f"deploy/certificates --host {host}, and copy drone/ to the vehicle"
        return failure(about, f"{address}: {error.verify_message}", remedy if named else MAKE)
    except ssl.SSLError as error:
        return failure(
            about,
            f"{address}: {error.reason or error}",
            f"the vehicle speaks no TLS, or refuses {identity and identity.folder}: {MAKE}",
        )
    except (OSError, ValueError) as error:
        return failure(
            about,
            f"{address}: {error}",
            "is the vehicle on, its layout up, this host in its WiFi? Name it in [links] vehicle",
        )
    if identity is None and not is_loopback(host):
        return warning(about, f"{address} answers, without certificates", MAKE)
    return ok(about, f"{address} answers in {took_ms:.0f} ms")


def _shake_hands(link: socket.socket, host: str, identity: Identity) -> None:
    """Do the TLS handshake and wait for a refusal.

    Raises:
        ssl.SSLError: one end does not accept the other.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.load_verify_locations(identity.folder / CA)
    context.load_cert_chain(identity.folder / CERTIFICATE, identity.folder / KEY)
    with context.wrap_socket(link, server_hostname=host) as secured:
        secured.settimeout(REFUSAL_S)
        with contextlib.suppress(TimeoutError):
            secured.recv(1)


def _is_free(host: str, port: int) -> bool:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(family) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError:
            return False
    return True


def existing(path: Path) -> Path:
    """Return `path`, or the nearest folder above it that exists."""
    return next(p for p in (path, *path.absolute().parents) if p.exists())
