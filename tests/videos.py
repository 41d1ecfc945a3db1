"""Small H.264 videos and live streams, made on the spot."""

import socket
import threading
from collections.abc import Generator, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.container import OutputContainer
from av.error import FFmpegError
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream
from numpy.typing import NDArray

FPS = 25
BAND_PX = 16


def picture(index: int, width: int, height: int) -> NDArray[np.uint8]:
    """Return the picture of this index, (H, W, 3) uint8: a gradient with a band that moves down.

    The band is white, `BAND_PX` rows high, and begins at row 16 * index modulo the height.
    """
    row = np.linspace(30, 200, width, dtype=np.uint8)
    pixels = np.repeat(np.tile(row, (height, 1))[..., None], 3, axis=2)
    top = BAND_PX * index % height
    pixels[top : top + BAND_PX] = 235
    return pixels


def band_of(luminance: NDArray[np.uint8]) -> int:
    """Return the index, modulo height / 16, of a picture made by `picture`."""
    means = luminance.astype(np.float64).mean(axis=1)
    rows = len(means) // BAND_PX
    return int(means[: rows * BAND_PX].reshape(rows, BAND_PX).mean(axis=1).argmax())


def add_h264(container: OutputContainer, width: int, height: int) -> VideoStream:
    """Add an H.264 stream without B pictures, a key frame every 10 pictures."""
    # av's stubs leave the type of further options open.
    stream = container.add_stream("libx264", rate=FPS)  # pyright: ignore[reportUnknownMemberType]
    stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
    stream.options = {"preset": "ultrafast", "tune": "zerolatency", "x264-params": "threads=1"}
    stream.codec_context.gop_size = 10
    return stream


def encode(stream: VideoStream, frames: Iterable[VideoFrame]) -> "Iterator[Packet[Any]]":
    """Yield the packets of all frames, which are numbered in this order."""
    for index, frame in enumerate(frames):
        frame.pts = index
        # av's stubs leave the type of packets open.
        yield from stream.encode(frame)  # pyright: ignore[reportUnknownMemberType]
    yield from stream.encode(None)  # pyright: ignore[reportUnknownMemberType]


def bands(count: int, width: int, height: int) -> Iterator[VideoFrame]:
    """Yield pictures 0 .. count - 1."""
    for index in range(count):
        yield VideoFrame.from_ndarray(picture(index, width, height), format="bgr24")


def mux(container: OutputContainer, packet: "Packet[Any]") -> None:
    """Write one packet."""
    # av's stubs leave the type of packets open.
    container.mux(packet)  # pyright: ignore[reportUnknownMemberType]


def write_video(path: Path, count: int, width: int = 320, height: int = 240) -> Path:
    """Write `count` pictures at 25 a second to `path`; its suffix names the container."""
    with av.open(str(path), "w") as container:
        stream = add_h264(container, width, height)
        for packet in encode(stream, bands(count, width, height)):
            mux(container, packet)
    return path


def free_port() -> int:
    """Return an even UDP port that nobody uses now (RTP takes it and the next one)."""
    while True:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            port: int = probe.getsockname()[1]
        if port % 2 == 0:
            return port


@contextmanager
def sender(url: str, container_format: str, size: tuple[int, int] = (320, 240)) -> Generator[None]:
    """Send a live stream to `url` from a thread, twice as fast as its time stamps tell."""
    stop = threading.Event()

    def send() -> None:
        width, height = size
        with av.open(url, "w", format=container_format) as container:
            stream = add_h264(container, width, height)
            for packet in encode(stream, bands(100_000, width, height)):
                with suppress(FFmpegError):  # Nobody listens yet; a camera does not mind.
                    mux(container, packet)
                if stop.wait(0.5 / FPS):
                    return

    thread = threading.Thread(target=send, daemon=True)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join(10)
