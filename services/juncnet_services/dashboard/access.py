"""Who may see the page's data and who may command: pure.

The page itself holds nothing secret. Everything else needs a key, which stands behind the `#` of
the address and so is never sent by a link, and never to another site. Two keys: one watches,
one commands. `Host` and `Origin` are checked besides, so that neither another web page nor a name
that someone has pointed at this host reaches the robot through a browser.
"""

import hmac
import json
import os
import secrets
import socket
import threading
from dataclasses import asdict, dataclass
from enum import IntEnum
from pathlib import Path

HOST = "127.0.0.1"
NOTE = "dashboard.json"


class Right(IntEnum):
    """What a key allows."""

    NONE = 0
    WATCH = 1
    COMMAND = 2


@dataclass(frozen=True)
class Address:
    """Where the page is and what its keys are."""

    port: int
    watch_key: str
    command_key: str

    def url(self, right: Right) -> str:
        """Return the address to open, with the key for `right`."""
        key = self.command_key if right is Right.COMMAND else self.watch_key
        return f"http://{HOST}:{self.port}/#{key}"

    @property
    def hosts(self) -> tuple[str, ...]:
        """What the header `Host` may say."""
        return (f"{HOST}:{self.port}", f"localhost:{self.port}")

    def right_of(self, authorization: str) -> Right:
        """Return what the header `Authorization` (`Bearer KEY`) allows."""
        scheme, _, key = authorization.partition(" ")
        if scheme != "Bearer":
            return Right.NONE
        if hmac.compare_digest(key.encode(), self.command_key.encode()):
            return Right.COMMAND
        if hmac.compare_digest(key.encode(), self.watch_key.encode()):
            return Right.WATCH
        return Right.NONE


def foreign(address: Address, host: str, origin: str | None, site: str | None) -> str | None:
    """Return why a request comes from elsewhere than this page; None: it does not.

    `host`, `origin` and `site` are the headers Host, Origin and Sec-Fetch-Site.
    """
    if host not in address.hosts:
        return f"this page is {address.hosts[0]}, not {host or 'a request without Host'}"
    if origin is not None and origin != f"http://{host}":
        return f"requests from {origin} are refused"
    if site not in (None, "same-origin", "none"):
        return f"{site} requests are refused"
    return None


def address_in(directory: Path, port: int = 0) -> Address:
    """Return the address that the dashboard of this directory keeps through restarts.

    The first to ask makes it, and all others get that one: `port` 0 takes any free one.
    """
    note = directory / NOTE
    kept = _kept(note, port)
    if kept is not None:
        return kept
    address = new_address(port)
    draft = note.with_suffix(f".{os.getpid()}-{threading.get_ident()}")
    draft.touch(mode=0o600)
    draft.write_text(json.dumps(asdict(address)) + "\n")
    try:
        os.link(draft, note)
    except FileExistsError:  # somebody was first, or it has another port or cannot be read
        kept = _kept(note, port)
        if kept is not None:
            return kept
        draft.replace(note)
    finally:
        draft.unlink(missing_ok=True)
    return address


def _kept(note: Path, port: int) -> Address | None:
    try:
        kept = Address(**json.loads(note.read_text()))
    except (OSError, ValueError, TypeError):
        return None
    return kept if port in (0, kept.port) else None


def new_address(port: int = 0) -> Address:
    """Return an address with new keys; `port` 0 takes any free one."""
    return Address(port or _free_port(), secrets.token_urlsafe(12), secrets.token_urlsafe(12))


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])
