"""H.264 from an RTSP camera, forwarded as it came: nothing but the standard library.

One TCP connection carries it all (RFC 2326, 10.12). A password in the URL is given as Basic or as
Digest with MD5 (RFC 2617), which is what cameras ask for.
"""

import base64
import hashlib
import re
import socket
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from urllib.parse import unquote, urljoin, urlsplit

from juncnet.clocks import NS_PER_S, Clock
from juncnet_services.frame_capture.contract import CameraError, Counts
from juncnet_services.frame_capture.h264_rtp import Depacketiser
from juncnet_services.frame_capture.live import Arrival
from juncnet_services.frame_capture.rtp import RtpError, RtpOrder, parse_rtp
from juncnet_services.frame_capture.sources import StreamSource

PORT = 554
MAX_HEADER = 65536
KEEP_ALIVE_S = 20.0
"""Cameras end a session of which they hear nothing for a minute."""


class RtspError(ValueError):
    """The camera answered what cannot be used; the text says what."""


@dataclass(frozen=True)
class Answer:
    """A response of the camera; names of headers in lower case."""

    status: int
    headers: dict[str, str]
    body: bytes


@dataclass(frozen=True)
class Track:
    """The video in a session description: where to set it up, its type, its parameter sets."""

    control: str
    payload_type: int
    parameter_sets: tuple[bytes, ...]


def find_video(description: str, base: str) -> Track:
    """Return the first H.264 track of a session description (RFC 8866, RFC 6184 8.2).

    Raises:
        RtspError: there is none.
    """
    for media in re.split(r"(?m)^m=", description)[1:]:
        found = re.search(r"(?mi)^a=rtpmap:(\d+) H264/90000", media)
        if not media.startswith("video") or found is None:
            continue
        control = re.search(r"(?m)^a=control:(\S+)", media)
        sprop = re.search(r"sprop-parameter-sets=([A-Za-z0-9+/=,]+)", media)
        sets = tuple(_decoded(word) for word in sprop[1].split(",")) if sprop else ()
        try:
            url = urljoin(base if base.endswith("/") else base + "/", control[1] if control else "")
        except ValueError as error:
            raise RtspError(f"a=control: {error}") from error
        return Track(url, int(found[1]), tuple(nal for nal in sets if nal))
    raise RtspError("no H.264 video in what the camera describes")


def _decoded(word: str) -> bytes:
    try:
        return base64.b64decode(word, validate=True)
    except ValueError:
        return b""


@dataclass
class Conversation:
    """Requests and answers on one connection; `url` with a password, if the camera wants one."""

    connection: socket.socket
    url: str
    _waiting: bytearray = field(default_factory=bytearray)
    _requests: int = 0
    _challenge: str = ""

    def ask(self, method: str, url: str, **headers: str) -> Answer:
        """Return the camera's answer; asked again with the password if it wants one.

        Raises:
            RtspError: it refuses, or answers nonsense.
        """
        self.tell(method, url, **headers)
        answer = self._answer()
        if answer.status == 401 and not self._challenge:
            self._challenge = answer.headers.get("www-authenticate", "")
            self.tell(method, url, **headers)
            answer = self._answer()
        if answer.status != 200:
            raise RtspError(f"{method} was answered with {answer.status}")
        return answer

    def tell(self, method: str, url: str, **headers: str) -> None:
        """Send a request without waiting for its answer."""
        self._requests += 1
        lines = [f"{method} {url} RTSP/1.0", f"CSeq: {self._requests}", "User-Agent: juncnet"]
        lines += [f"{name}: {value}" for name, value in headers.items()]
        if self._challenge:
            lines.append(f"Authorization: {self._authorization(method, url)}")
        self.connection.sendall("\r\n".join([*lines, "", ""]).encode())

    def packet(self) -> tuple[int, bytes]:
        """Return (channel, packet) of the next interleaved packet; answers between are skipped."""
        while self._peek(1) != b"$":
            self._answer()
        head = self._take(4)
        return head[1], self._take(int.from_bytes(head[2:4], "big"))

    def _answer(self) -> Answer:
        while self._peek(1) == b"$":
            self._take(4 + int.from_bytes(self._peek(4)[2:4], "big"))
        while (end := self._waiting.find(b"\r\n\r\n")) < 0:
            if len(self._waiting) > MAX_HEADER:
                raise RtspError("the camera's answer has no end")
            self._receive()
        first, *rest = self._take(end + 4).decode(errors="replace").split("\r\n")
        status = re.match(r"RTSP/1\.\d (\d{3})", first)
        if status is None:
            raise RtspError(f"not RTSP: {first[:60]!r}")
        pairs = (line.partition(":") for line in rest if ":" in line)
        headers = {name.strip().lower(): value.strip() for name, _, value in pairs}
        length = headers.get("content-length", "0")
        if not re.fullmatch("[0-9]{1,9}", length) or int(length) > MAX_HEADER:
            raise RtspError(f"an answer of {length[:20]} bytes")
        return Answer(int(status[1]), headers, self._take(int(length)))

    def _peek(self, count: int) -> bytes:
        while len(self._waiting) < count:
            self._receive()
        return bytes(self._waiting[:count])

    def _take(self, count: int) -> bytes:
        taken = self._peek(count)
        del self._waiting[:count]
        return taken

    def _receive(self) -> None:
        data = self.connection.recv(65536)
        if not data:
            raise RtspError("the camera has closed the connection")
        self._waiting += data

    def _authorization(self, method: str, url: str) -> str:
        parts = urlsplit(self.url)
        user, password = unquote(parts.username or ""), unquote(parts.password or "")
        if not self._challenge.lower().startswith("digest"):
            return "Basic " + base64.b64encode(f"{user}:{password}".encode()).decode()
        values = dict(re.findall(r'(\w+)="([^"]*)"', self._challenge))
        realm, nonce = values.get("realm", ""), values.get("nonce", "")
        response = _md5(f"{_md5(f'{user}:{realm}:{password}')}:{nonce}:{_md5(f'{method}:{url}')}")
        fields = {"username": user, "realm": realm, "nonce": nonce, "uri": url}
        fields["response"] = response
        return "Digest " + ", ".join(f'{name}="{value}"' for name, value in fields.items())


def _md5(text: str) -> str:
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()


class RtspReceiver:
    """Plays one RTSP camera."""

    def __init__(self, source: StreamSource, clock: Clock) -> None:
        self._source, self._clock = source, clock
        parts = urlsplit(source.url)
        self._host, self._port = parts.hostname or "", parts.port or PORT
        self._name = parts._replace(netloc=parts.netloc.rpartition("@")[2]).geturl()

    @contextmanager
    def connect(self, counts: Counts) -> Generator[Iterator[Arrival]]:
        """Ask the camera to play, and give what arrives until it is silent for too long.

        Raises:
            CameraError: it is not there, or not as it should be.
        """
        try:
            timeout_s = self._source.connect_timeout_s
            with socket.create_connection((self._host, self._port), timeout_s) as connection:
                talk = Conversation(connection, self._source.url)
                described = talk.ask("DESCRIBE", self._name, Accept="application/sdp")
                base = described.headers.get("content-base", self._name)
                track = find_video(described.body.decode(errors="replace"), base)
                transport = "RTP/AVP/TCP;unicast;interleaved=0-1"
                session = talk.ask("SETUP", track.control, Transport=transport).headers
                identity = session.get("session", "").partition(";")[0]
                talk.ask("PLAY", base, Session=identity, Range="npt=0.000-")
                connection.settimeout(self._source.stall_s)
                yield self._arrivals(talk, track, identity, counts)
        except (OSError, RtspError, ValueError) as error:
            raise CameraError(
                f"{self._name}: {error}; is the camera on and reachable, and are address, port, "
                "path and password right?"
            ) from error

    def _arrivals(
        self, talk: Conversation, track: Track, session: str, counts: Counts
    ) -> Iterator[Arrival]:
        order, pictures = RtpOrder(), Depacketiser(counts, track.parameter_sets)
        told_ns = self._clock.now_ns()
        while True:
            channel, data = talk.packet()
            now_ns = self._clock.now_ns()
            if now_ns - told_ns > KEEP_ALIVE_S * NS_PER_S:
                told_ns = now_ns
                talk.tell("OPTIONS", self._name, Session=session)
            if channel != 0:
                continue
            try:
                packet = parse_rtp(data)
            except RtpError:
                counts.corrupt += 1
                continue
            if packet.payload_type != track.payload_type:
                continue
            for lost, released in order.push(packet):
                units = pictures.push(released, lost, now_ns)
                if units:
                    yield Arrival([], units)
