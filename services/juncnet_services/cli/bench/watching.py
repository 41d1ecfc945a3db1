"""A page's requests to its dashboard, without a browser."""

import contextlib
import json
import socket
import struct
from http.client import HTTPConnection, HTTPException
from typing import Any

from juncnet_services.dashboard.access import HOST, Address


class Page:
    """Asks a dashboard for what is new of a robot, as its page does; a context."""

    def __init__(self, address: Address, robot: str) -> None:
        self._address = address
        self._links = {w: HTTPConnection(HOST, address.port, timeout=5) for w in ("state", "still")}
        self._still = f"/still?robot={robot}"
        self._serial = 0
        self._seen = ""

    def __enter__(self) -> "Page":
        return self

    def __exit__(self, *_: object) -> None:
        for link in self._links.values():
            link.close()

    def ask_state(self) -> bool:
        """Ask for the rows that came since the last answer; return whether there was an answer."""
        body = self._get("state", f"/state?after={self._serial}")
        self._serial = json.loads(body)["serial"] if body else 0
        return bool(body)

    def ask_picture(self) -> bool:
        """Ask for a picture that is newer than the last one; return whether there is one."""
        body = self._get("still", self._still + self._seen)
        if body:
            (length,) = struct.unpack_from("<I", body)
            head: dict[str, Any] = json.loads(body[4 : 4 + length])
            self._seen = f"&epoch={head['epoch']}&sequence={head['sequence']}"
        return bool(body)

    def _get(self, which: str, path: str) -> bytes:
        """Return the answer; empty: there is none, or the dashboard was killed."""
        link = self._links[which]
        try:
            link.request(
                "GET", path, headers={"Authorization": f"Bearer {self._address.watch_key}"}
            )
            return link.getresponse().read()
        except (OSError, HTTPException):
            link.close()
            return b""


def ask_and_not_read(address: Address, robot: str) -> socket.socket:
    """Return a connection over which many pictures are asked for and nothing is read."""
    link = socket.create_connection((HOST, address.port))
    link.setblocking(False)
    request = (
        f"GET /still?robot={robot} HTTP/1.1\r\nHost: {address.hosts[0]}\r\n"
        f"Authorization: Bearer {address.watch_key}\r\n\r\n"
    ).encode()
    with contextlib.suppress(BlockingIOError):
        while True:
            link.send(request)
    return link
