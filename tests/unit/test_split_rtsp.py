"""RTSP as the drone's side speaks it, against a camera of a few lines."""

import base64
import socket
import threading
from collections.abc import Iterator

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from juncnet.flight import HostClock
from juncnet_services.frame_capture.contract import AccessUnit, CameraError, Counts
from juncnet_services.frame_capture.h264 import split_annex_b
from juncnet_services.frame_capture.h264_rtp import packetise
from juncnet_services.frame_capture.rtsp import (
    Conversation,
    RtspError,
    RtspReceiver,
    find_video,
)
from juncnet_services.frame_capture.sources import StreamSource

SPS, PPS, PICTURE = b"\x67\x42\x00\x1f\xe9", b"\x68\xce\x38\x80", b"\x65\x88" + b"\x11" * 3000
SETS = ",".join(base64.b64encode(nal).decode() for nal in (SPS, PPS))
DESCRIPTION = (
    "v=0\r\no=- 0 0 IN IP4 0.0.0.0\r\ns=camera\r\nm=audio 0 RTP/AVP 0\r\na=control:sound\r\n"
    "m=video 0 RTP/AVP 96\r\na=rtpmap:96 H264/90000\r\n"
    f"a=fmtp:96 packetization-mode=1;sprop-parameter-sets={SETS}\r\na=control:track1\r\n"
)


class RtspCamera:
    """Answers one client, with a password if `challenge` is given, and sends two pictures."""

    def __init__(self, challenge: str = "") -> None:
        self._challenge = challenge
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listener.getsockname()[1])
        self.requests: list[str] = []
        self._thread = threading.Thread(target=self._serve)

    def __enter__(self) -> "RtspCamera":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._listener.close()
        self._thread.join(5)

    def _serve(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return
        with connection, connection.makefile("rb") as lines:
            for request in iter(lambda: self._request(lines), ""):
                self.requests.append(request)
                if self._challenge and "Authorization" not in request:
                    connection.sendall(
                        self._answer(401, "", f"WWW-Authenticate: {self._challenge}")
                    )
                    continue
                method = request.split()[0]
                body = DESCRIPTION if method == "DESCRIBE" else ""
                connection.sendall(self._answer(200, body, "Session: 42;timeout=60"))
                if method == "PLAY":
                    for number in range(2):
                        for packet in packetise([PICTURE], 10 * number, 3600 * number, 5):
                            head = b"$\0" + len(packet).to_bytes(2, "big")
                            connection.sendall(b"$\1\0\2xx" + head + packet)
                    return

    @staticmethod
    def _request(lines: "Iterator[bytes]") -> str:
        text = b""
        for line in lines:
            text += line
            if line == b"\r\n":
                break
        return text.decode()

    @staticmethod
    def _answer(status: int, body: str, *headers: str) -> bytes:
        lines = [f"RTSP/1.0 {status} x", *headers, f"Content-Length: {len(body)}", "", body]
        return "\r\n".join(lines).encode()


def played(camera: RtspCamera, login: str = "") -> list[AccessUnit]:
    source = StreamSource(kind="stream", url=f"rtsp://{login}127.0.0.1:{camera.port}/live")
    units: list[AccessUnit] = []
    with pytest.raises(CameraError, match="closed"):
        listen(source, units)
    return units


def listen(source: StreamSource, units: list[AccessUnit]) -> None:
    with RtspReceiver(source, HostClock()).connect(Counts()) as arrivals:
        for arrival in arrivals:
            units += arrival.units


def test_pictures_come_with_the_parameter_sets_of_the_description() -> None:
    with RtspCamera() as camera:
        units = played(camera)
    assert split_annex_b(units[0].payload) == [SPS, PPS, PICTURE]
    assert units[0].key_frame
    assert [r.split()[0] for r in camera.requests] == ["DESCRIBE", "SETUP", "PLAY"]
    assert camera.requests[1].split()[1].endswith("/live/track1")


@pytest.mark.parametrize("challenge", ['Basic realm="c"', 'Digest realm="c", nonce="n"'])
def test_a_password_is_given_when_asked_for_and_not_shown_in_the_url(challenge: str) -> None:
    with RtspCamera(challenge) as camera:
        assert played(camera, "user:pass%20word@")
    assert challenge.split()[0] in camera.requests[1]
    assert not any("pass" in request for request in camera.requests)


def test_nobody_there_is_told_with_what_to_check() -> None:
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    source = StreamSource(kind="stream", url=f"rtsp://u:secret@127.0.0.1:{port}/live")
    with pytest.raises(CameraError, match="reachable") as error:
        listen(source, [])
    assert "secret" not in str(error.value)


@given(st.binary(max_size=300))
@settings(max_examples=300, deadline=None)
def test_arbitrary_answers_are_refused_or_understood(data: bytes) -> None:
    ours, camera = socket.socketpair()
    with ours, camera:
        camera.sendall(data)
        camera.shutdown(socket.SHUT_WR)
        ours.settimeout(1.0)
        talk = Conversation(ours, "rtsp://camera/live")
        with pytest.raises(RtspError):
            ask_for_ever(talk)


def ask_for_ever(talk: Conversation) -> None:
    while True:
        talk.ask("DESCRIBE", "rtsp://camera/live")


@given(st.text(max_size=200))
@settings(max_examples=300, deadline=None)
def test_arbitrary_descriptions_have_no_video(text: str) -> None:
    with pytest.raises(RtspError, match=r"no H\.264"):
        find_video(text, "rtsp://camera/live")
