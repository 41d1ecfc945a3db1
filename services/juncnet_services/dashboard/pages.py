"""The page and its data over HTTP, on loopback: nothing is pushed, whoever is slow gets less.

A page asks for the newest state and the newest picture, again and again; every answer is made
when it is asked for and not kept. So a slow, stopped or killed browser holds one thread and one
picture at most, and no request waits behind another page's.
"""

import json
import threading
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from socket import socket
from typing import Any
from urllib.parse import parse_qs, urlsplit

from juncnet_services.dashboard.access import HOST, Address, Right, foreign
from juncnet_services.dashboard.board import Board
from juncnet_services.dashboard.choices import shipped_models
from juncnet_services.dashboard.requests import asked

PAGE = Path(__file__).parent / "page"
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".svg": "image/svg+xml",
}
HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
    "img-src 'self' blob:; connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; "
    "form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}
MAX_BODY = 64 * 1024
MAX_CONNECTIONS = 64
IDLE_S = 15.0
"""A connection that neither sends nor takes anything for so long is closed."""


@dataclass(frozen=True)
class About:
    """What a page is told of the dashboard itself."""

    epoch: str
    view_only: bool
    picture_age_s: float
    picture_rate_hz: float
    followers: tuple[str, ...]


@contextmanager
def served(board: Board, address: Address, about: About) -> Generator[None]:
    """Serve the page at `address` while the context lasts.

    Raises:
        OSError: the port is taken.
    """
    with PageServer(board, address, about) as server:
        thread = threading.Thread(target=server.serve_forever, name="pages", daemon=True)
        thread.start()
        try:
            yield
        finally:
            server.ending = True
            server.shutdown()
            thread.join()


class PageServer(ThreadingHTTPServer):
    """Listens on loopback; a thread a connection, at most `MAX_CONNECTIONS`."""

    daemon_threads = True
    block_on_close = False
    ending = False
    """Whether connections are closed after the answer that they wait for."""

    def __init__(self, board: Board, address: Address, about: About) -> None:
        self.board, self.address, self.about = board, address, about
        self._places = threading.BoundedSemaphore(MAX_CONNECTIONS)
        super().__init__((HOST, address.port), PageHandler)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Give the connection a thread, or close it when there are too many."""
        if self._places.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Serve one connection."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._places.release()

    def handle_error(self, request: socket | tuple[bytes, socket], client_address: Any) -> None:
        """A browser that went away in the middle is no error."""


class PageHandler(BaseHTTPRequestHandler):
    """Answers one connection: the page's files to anyone here, all else to who has a key."""

    protocol_version = "HTTP/1.1"
    server: PageServer  # pyright: ignore[reportIncompatibleVariableOverride]
    timeout = IDLE_S
    disable_nagle_algorithm = True

    def do_GET(self) -> None:
        """Answer with a file of the page, the state or a picture."""
        url = urlsplit(self.path)
        query = {name: values[-1] for name, values in parse_qs(url.query).items()}
        match url.path:
            case "/state":
                self._with_right(Right.WATCH, lambda: self._state(query))
            case "/still":
                self._with_right(Right.WATCH, lambda: self._still(query))
            case "/models":
                self._with_right(Right.COMMAND, lambda: self._json({"models": shipped_models()}))
            case _:
                self._with_right(Right.NONE, lambda: self._file(url.path))

    def do_POST(self) -> None:
        """Carry out what the page asks for."""
        length = self.headers.get("Content-Length", "")
        if not length.isdecimal() or int(length) > MAX_BODY:
            self.close_connection = True
            self._error(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"at most {MAX_BODY} bytes")
            return
        body = self.rfile.read(int(length))
        if self.path != "/ask" or self.headers.get_content_type() != "application/json":
            self._error(HTTPStatus.NOT_FOUND, "orders are JSON, to /ask")
            return
        self._with_right(Right.COMMAND, lambda: self._ask(body))

    def _with_right(self, needed: Right, answer: Callable[[], None]) -> None:
        """Answer if the request comes from this page with a key for what it needs."""
        headers, address = self.headers, self.server.address
        reason = foreign(
            address, headers.get("Host", ""), headers.get("Origin"), headers.get("Sec-Fetch-Site")
        )
        if reason is not None:
            self._error(HTTPStatus.FORBIDDEN, reason)
        elif self._right() < needed:
            self._error(HTTPStatus.FORBIDDEN, "this key does not allow that: open the full address")
        else:
            answer()

    def _right(self) -> Right:
        right = self.server.address.right_of(self.headers.get("Authorization", ""))
        return min(right, Right.WATCH) if self.server.about.view_only else right

    def _state(self, query: dict[str, str]) -> None:
        about = asdict(self.server.about) | {"may_command": self._right() is Right.COMMAND}
        body = self.server.board.state(_number(query.get("after")), about)
        self._send(HTTPStatus.OK, "application/json", body)

    def _still(self, query: dict[str, str]) -> None:
        after = (_number(query.get("epoch")), _number(query.get("sequence")))
        body = self.server.board.still(query.get("robot", ""), after)
        if body is None:
            self._send(HTTPStatus.NO_CONTENT, "application/octet-stream", b"")
        else:
            self._send(HTTPStatus.OK, "application/octet-stream", body)

    def _ask(self, body: bytes) -> None:
        try:
            wanted = asked(body)
        except ValueError as error:
            self._error(HTTPStatus.BAD_REQUEST, str(error))
            return
        self._json(self.server.board.orders.carry_out(wanted).model_dump())

    def _file(self, path: str) -> None:
        file = PAGE / ("index.html" if path == "/" else path.removeprefix("/"))
        if file.parent != PAGE or file.suffix not in TYPES or not file.is_file():
            self._error(HTTPStatus.NOT_FOUND, f"there is no {path}")
            return
        self._send(HTTPStatus.OK, TYPES[file.suffix], file.read_bytes())

    def _json(self, content: dict[str, Any]) -> None:
        self._send(HTTPStatus.OK, "application/json", json.dumps(content).encode())

    def _error(self, status: HTTPStatus, reason: str) -> None:
        body = json.dumps({"accepted": False, "reason": reason}).encode()
        self._send(status, "application/json", body)

    def _send(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self.close_connection |= self.server.ending
        self.send_response(status)
        for name, value in HEADERS.items():
            self.send_header(name, value)
        if status is not HTTPStatus.NO_CONTENT:
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are not logged: there are twenty a second."""


def _number(text: str | None) -> int:
    return int(text) if text is not None and text.isdecimal() and len(text) < 20 else 0
