"""Live H.264 over UDP: joined in the middle, lost, and found again."""

import time
from collections.abc import Callable, Generator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path

import numpy as np
import pytest

from juncnet_services.frame_capture.contract import Camera
from juncnet_services.frame_capture.live import LiveCamera
from juncnet_services.frame_capture.sources import DeviceSource, RtpSource, StreamSource
from juncnet_services.frame_capture.stream import make_sdp, stream_connector
from juncnet_services.frame_capture.v4l2 import device_connector
from videos import band_of, free_port, sender

DEADLINE_S = 15.0
STALL_S = 0.4
CAMERA, STRANGER = "127.0.0.2", "127.0.0.3"


class MonotonicClock:
    """This host's clock."""

    id = "test"

    def now_ns(self) -> int:
        return time.monotonic_ns()


@contextmanager
def watching(source: StreamSource | RtpSource) -> Generator[LiveCamera]:
    connect = stream_connector(source, MonotonicClock(), decode=True)
    with closing(LiveCamera(connect)) as camera:
        yield camera


def until(done: Callable[[], bool], what: str) -> None:
    deadline = time.monotonic() + DEADLINE_S
    while not done():
        assert time.monotonic() < deadline, f"not within {DEADLINE_S} s: {what}"
        time.sleep(0.01)


def see(camera: Camera, count: int) -> list[tuple[int, int]]:
    """Return (band, width) of the next `count` pictures; fails after the deadline."""
    deadline = time.monotonic() + DEADLINE_S
    seen: list[tuple[int, int]] = []
    while len(seen) < count:
        assert time.monotonic() < deadline, f"{len(seen)} pictures; {camera.counts}"
        with camera.take(0.1) as picture:
            if picture is not None:
                assert 0 <= time.monotonic_ns() - picture.captured_ns < 1e9
                pixels = np.zeros(picture.layout.nbytes, np.uint8)
                picture.write(pixels)
                width, height = picture.layout.width, picture.layout.height
                seen.append((band_of(pixels[: width * height].reshape(height, width)), width))
    return seen


def rtp(port: int, _: Path) -> tuple[str, str, StreamSource | RtpSource]:
    source = RtpSource(kind="rtp", port=port, address="127.0.0.1", stall_s=STALL_S)
    return f"rtp://127.0.0.1:{port}", "rtp", source


def sdp_file(port: int, folder: Path) -> tuple[str, str, StreamSource | RtpSource]:
    path = folder / "camera.sdp"
    path.write_text(make_sdp(RtpSource(kind="rtp", port=port, address="127.0.0.1"), "127.0.0.1"))
    source = StreamSource(kind="stream", url=str(path), stall_s=STALL_S)
    return f"rtp://127.0.0.1:{port}", "rtp", source


def transport_stream(port: int, _: Path) -> tuple[str, str, StreamSource | RtpSource]:
    source = StreamSource(kind="stream", url=f"udp://127.0.0.1:{port}", stall_s=STALL_S)
    return f"udp://127.0.0.1:{port}?pkt_size=1316", "mpegts", source


def raw(port: int, _: Path) -> tuple[str, str, StreamSource | RtpSource]:
    url = f"udp://127.0.0.1:{port}"
    source = StreamSource(kind="stream", url=url, format="h264", stall_s=STALL_S)
    return f"{url}?pkt_size=1316", "h264", source


@pytest.mark.parametrize("kind", [rtp, sdp_file, transport_stream, raw])
def test_joined_in_the_middle_lost_and_found(
    kind: Callable[[int, Path], tuple[str, str, StreamSource | RtpSource]], tmp_path: Path
) -> None:
    url, container, source = kind(free_port(), tmp_path)
    with watching(source) as camera:
        with sender(url, container):
            seen = see(camera, 15)
        assert len({band for band, _ in seen}) > 5
        assert camera.counts.reconnects == 0
        assert any(unit.key_frame for unit in camera.access_units())
        until(lambda: len(camera.counts.problems) > 0, "the loss is noticed")
        with sender(url, container, (640, 480)):
            until(lambda: camera.counts.reconnects == 1, "the stream is back")
            assert see(camera, 5)[-1][1] == 640


def test_full_hd_over_rtp() -> None:
    url, container, source = rtp(free_port(), Path())
    with watching(source) as camera, sender(url, container, (1920, 1080)):
        assert {width for _, width in see(camera, 10)} == {1920}


@pytest.mark.parametrize("named", [False, True])
def test_decoded_pictures_are_of_one_sender_only(named: bool) -> None:
    port = free_port()
    url = f"rtp://127.0.0.1:{port}?localaddr="
    fields: dict[str, object] = {"kind": "rtp", "port": port, "address": "127.0.0.1"}
    if named:
        fields["sender"] = CAMERA
    with watching(RtpSource.model_validate(fields)) as camera, ExitStack() as stack:
        if named:
            stack.enter_context(sender(url + STRANGER, "rtp", (640, 480)))
            time.sleep(0.2)
        stack.enter_context(sender(url + CAMERA, "rtp"))
        seen = see(camera, 5)
        if not named:
            stack.enter_context(sender(url + STRANGER, "rtp", (640, 480)))
        seen += see(camera, 30)
    assert {width for _, width in seen} == {320}
    assert camera.counts.reconnects == 0


def test_silent_port_is_explained() -> None:
    source = RtpSource(kind="rtp", port=free_port(), address="127.0.0.1", connect_timeout_s=0.3)
    with watching(source) as camera:
        until(lambda: len(camera.counts.problems) > 0, "a problem is told")
        problem = camera.counts.problems[0]
    assert "nothing received" in problem
    assert "firewall" in problem
    assert "next attempt in 0.5 s" in problem


@pytest.mark.parametrize("content", [None, "m=nonsense"])
def test_wrong_session_description_is_explained(tmp_path: Path, content: str | None) -> None:
    path = tmp_path / "camera.sdp"
    if content is not None:
        path.write_text(content)
    source = StreamSource(kind="stream", url=str(path), connect_timeout_s=0.5)
    with watching(source) as camera:
        until(lambda: len(camera.counts.problems) > 0, "a problem is told")
    assert "does the SDP file exist and name the codec" in camera.counts.problems[0]


def test_missing_device_is_explained(tmp_path: Path) -> None:
    source = DeviceSource(kind="v4l2", device=tmp_path / "video7")
    connect = device_connector(source, MonotonicClock(), decode=True)
    with closing(LiveCamera(connect)) as camera:
        until(lambda: len(camera.counts.problems) > 0, "a problem is told")
    assert "no camera device" in camera.counts.problems[0]
