"""Several hosts send RTP to the camera's port: one of them is the camera."""

import contextlib
import socket
import threading
import time
from collections.abc import Generator

import pytest

from juncnet_services.frame_capture.contract import CameraError, Counts
from juncnet_services.frame_capture.h264 import split_annex_b
from juncnet_services.frame_capture.h264_rtp import packetise
from juncnet_services.frame_capture.live import Arrival
from juncnet_services.frame_capture.rtp_camera import RtpReceiver
from juncnet_services.frame_capture.sources import RtpSource
from videos import free_port

CAMERA, STRANGER = "127.0.0.2", "127.0.0.3"
STALL_S = 0.4


class MonotonicClock:
    """This host's clock."""

    id = "test"

    def now_ns(self) -> int:
        return time.monotonic_ns()


class Sender:
    """Sends access units of one packet each, all key frames, from an address of its own."""

    def __init__(self, host: str, port: int, ssrc: int) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((host, 0))
        self._where, self._sequence, self.ssrc = ("127.0.0.1", port), 0, ssrc

    def __enter__(self) -> "Sender":
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def send(self, mark: int) -> None:
        """Send the next access unit, its picture marked with a byte."""
        nals = [b"\x67\x42", b"\x68\xce", bytes([0x65, 0x88, mark])]
        for datagram in packetise(nals, self._sequence, self._sequence * 3600, self.ssrc):
            self._socket.sendto(datagram, self._where)
            self._sequence += 1

    @contextlib.contextmanager
    def going_on(self, mark: int) -> Generator[None]:
        """Send again and again, from a thread."""
        ended = threading.Event()

        def run() -> None:
            while not ended.wait(0.02):
                self.send(mark)

        thread = threading.Thread(target=run)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()


def source(port: int, **options: object) -> RtpSource:
    fields = {"kind": "rtp", "port": port, "address": "127.0.0.1", "stall_s": STALL_S}
    return RtpSource.model_validate(fields | options)


def mark_of(arrival: Arrival) -> int:
    (unit,) = arrival.units
    return split_annex_b(unit.payload)[-1][-1]


@contextlib.contextmanager
def senders(port: int) -> Generator[tuple[Sender, Sender]]:
    """Give the camera and a stranger."""
    with Sender(CAMERA, port, 7) as camera, Sender(STRANGER, port, 8) as stranger:
        yield camera, stranger


def test_the_first_sender_is_the_camera_and_loses_nothing() -> None:
    port, counts = free_port(), Counts()
    receiver = RtpReceiver(source(port), MonotonicClock())
    with senders(port) as (camera, stranger), receiver.connect(counts) as arrivals:
        for mark in range(1, 6):
            camera.send(mark)
            stranger.send(99)
        camera.send(6)
        assert [mark_of(next(arrivals)) for _ in range(6)] == [1, 2, 3, 4, 5, 6]
    assert (counts.lost, counts.corrupt) == (0, 0)
    (problem,) = counts.problems
    assert f"{STRANGER} sends too" in problem
    assert f"{CAMERA} is the camera" in problem
    assert "source.sender" in problem


def test_a_named_sender_is_the_camera_though_another_is_first() -> None:
    port = free_port()
    receiver = RtpReceiver(source(port, sender=CAMERA), MonotonicClock())
    with senders(port) as (camera, stranger), receiver.connect(Counts()) as arrivals:
        for mark in (1, 2):
            stranger.send(99)
            camera.send(mark)
        assert [mark_of(next(arrivals)) for _ in range(2)] == [1, 2]


def test_a_camera_that_begins_anew_is_followed() -> None:
    port = free_port()
    receiver = RtpReceiver(source(port), MonotonicClock())
    with senders(port) as (camera, _), receiver.connect(Counts()) as arrivals:
        camera.send(1)
        camera.ssrc = 9
        camera.send(2)
        assert [mark_of(next(arrivals)) for _ in range(2)] == [1, 2]


def test_a_stranger_cannot_hide_that_the_camera_is_silent() -> None:
    port = free_port()
    receiver = RtpReceiver(source(port), MonotonicClock())
    with senders(port) as (camera, stranger):
        with receiver.connect(Counts()) as arrivals:
            camera.send(1)
            assert mark_of(next(arrivals)) == 1
            with stranger.going_on(99), pytest.raises(TimeoutError):
                next(arrivals)
        with receiver.connect(Counts()) as arrivals:  # then anyone may be the camera
            stranger.send(50)
            assert mark_of(next(arrivals)) == 50


def test_silence_beside_a_named_sender_names_it() -> None:
    port = free_port()
    named = source(port, sender=CAMERA, connect_timeout_s=0.2)
    receiver = RtpReceiver(named, MonotonicClock())
    with (
        senders(port) as (_, stranger),
        stranger.going_on(99),
        pytest.raises(CameraError, match=f"is {CAMERA} sending H.264"),
        receiver.connect(Counts()) as arrivals,
    ):
        next(arrivals)
