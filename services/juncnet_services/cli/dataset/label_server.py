"""The labelling page's server: this host only, nothing without the token, one thread a request."""

import json
import secrets
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from pydantic import TypeAdapter, ValidationError

from juncnet.learning.footage.labelling import Action
from juncnet_services.cli.dataset.labelling import Labelling

PAGE = Path(__file__).with_name("label.html")
SCRIPT = PAGE.with_suffix(".js")
LARGEST_REQUEST = 65536
_ACTION: TypeAdapter[Action] = TypeAdapter(Action)


class LabelServer(ThreadingHTTPServer):
    """Serves one labelling session on a loopback port."""

    daemon_threads = True
    # The base class would let another process of this user bind the same port.
    allow_reuse_address = False

    def __init__(self, session: Labelling, port: int = 0) -> None:
        """Listen; `port` 0: any free one.

        Raises:
            OSError: the port is taken.
        """
        super().__init__(("127.0.0.1", port), _Handler)
        self.session = session
        self.token = secrets.token_urlsafe(16)

    @property
    def url(self) -> str:
        """The page's address, the token in it."""
        return f"http://127.0.0.1:{self.server_port}/?token={self.token}"


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    @property
    def _labels(self) -> LabelServer:
        assert isinstance(self.server, LabelServer)
        return self.server

    def do_GET(self) -> None:
        """Answer the page, the state of the session, or a frame."""
        path = urlsplit(self.path).path
        if path == "/page.js":  # Nothing of the user's is in it.
            self._send(SCRIPT.read_bytes(), "text/javascript; charset=utf-8")
            return
        query = self._query()
        if query is None:
            return
        if path == "/":
            self._send(PAGE.read_bytes(), "text/html; charset=utf-8")
        elif path == "/state":
            self._send_json(self._labels.session.state())
        elif path == "/times":
            self._times(query)
        elif path == "/frame":
            self._frame(query)
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "there is no such page")

    def do_POST(self) -> None:
        """Save an action and answer with the state of the session."""
        length = int(self.headers.get("Content-Length") or 0)
        body = self.rfile.read(min(length, LARGEST_REQUEST))
        if self._query() is None:
            return
        if urlsplit(self.path).path != "/action" or length > LARGEST_REQUEST:
            self._refuse(HTTPStatus.NOT_FOUND, "there is no such action")
            return
        try:
            self._labels.session.act(_ACTION.validate_json(body))
        except (ValidationError, KeyError, ValueError) as error:
            self._refuse(HTTPStatus.BAD_REQUEST, str(error))
        except OSError as error:
            self._refuse(HTTPStatus.INTERNAL_SERVER_ERROR, f"not saved: {error}")
        else:
            self._send_json(self._labels.session.state())

    def _query(self) -> dict[str, list[str]] | None:
        """Return the query of a request that may be answered; else refuse it.

        A page from elsewhere whose name is made to point here tells its own name as the host.
        """
        query = parse_qs(urlsplit(self.path).query)
        host = (self.headers.get("Host") or "").rsplit(":", 1)[0]
        token = query.get("token", [""])[0]
        if host in ("127.0.0.1", "localhost") and secrets.compare_digest(
            token.encode(), self._labels.token.encode()
        ):
            return query
        self._refuse(HTTPStatus.FORBIDDEN, "use the address that `juncnet dataset label` printed")
        return None

    def _times(self, query: dict[str, list[str]]) -> None:
        try:
            times_s = self._labels.session.times_s(query["clip"][0])
        except KeyError as error:
            self._refuse(HTTPStatus.NOT_FOUND, f"there is no clip {error}")
        else:
            self._send_json([round(time_s, 6) for time_s in times_s])

    def _frame(self, query: dict[str, list[str]]) -> None:
        try:
            clip, index = query["clip"][0], int(query["index"][0])
            picture = self._labels.session.picture(clip, index)
        except (KeyError, ValueError) as error:
            self._refuse(HTTPStatus.NOT_FOUND, str(error))
        else:
            self._send(picture, "image/jpeg", "private, max-age=3600")

    def _send_json(self, content: dict[str, Any] | list[float]) -> None:
        self._send(json.dumps(content).encode(), "application/json")

    def _refuse(self, status: HTTPStatus, text: str) -> None:
        self._send(text.encode(), "text/plain; charset=utf-8", status=status)

    def _send(
        self,
        data: bytes,
        kind: str,
        caching: str = "no-store",
        status: HTTPStatus = HTTPStatus.OK,
    ) -> None:
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(data)))
        self.send_header("Cache-Control", caching)
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: a line for every frame helps nobody."""
