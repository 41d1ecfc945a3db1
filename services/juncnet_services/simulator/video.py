"""The simulated camera's network stream: H.264 over RTP, as a drone sends it."""

import random
import socket
import threading
from contextlib import suppress
from fractions import Fraction
from queue import Empty, Full, Queue
from typing import Any

import av
import numpy as np
from av.video.codeccontext import VideoCodecContext
from av.video.frame import PictureType, VideoFrame
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from juncnet.frames import FrameLayout
from juncnet_services.frame_capture.h264 import split_annex_b
from juncnet_services.frame_capture.h264_rtp import packetise
from juncnet_services.frame_capture.rtp import is_picture_loss_indication

TICK_S = 0.2
CLOCK_HZ = 90_000
"""Of RTP time stamps of video."""


class VideoOptions(BaseModel):
    """Where the camera's stream goes, and how it is encoded."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    address: str = "127.0.0.1"
    port: int = Field(default=5600, ge=1, le=65535)
    bits_per_s: int = Field(default=8_000_000, ge=100_000, le=200_000_000)
    key_frame_every_s: float = Field(default=2.0, gt=0, le=60)


class Encoder:
    """Encodes pictures of one size to H.264 access units, without delay."""

    def __init__(self, layout: FrameLayout, fps: float, options: VideoOptions) -> None:
        context = av.CodecContext.create("libx264", "w")
        assert isinstance(context, VideoCodecContext)
        rate = Fraction(fps).limit_denominator(1000)
        context.width, context.height, context.pix_fmt = layout.width, layout.height, "yuv420p"
        context.framerate, context.time_base = rate, 1 / rate
        context.bit_rate = options.bits_per_s
        context.gop_size = max(1, round(options.key_frame_every_s * fps))
        context.thread_count = 1
        context.options = {
            "preset": "ultrafast",
            "tune": "zerolatency",
            "x264-params": f"vbv-maxrate={options.bits_per_s // 1000}"
            f":vbv-bufsize={options.bits_per_s // 4000}:slice-max-size=0",
        }
        self._context, self._layout, self._pictures = context, layout, 0

    def encode(self, pixels: NDArray[np.uint8], *, key_frame: bool) -> list[bytes]:
        """Return the NAL units of a picture, flat I420 of the layout; with `key_frame` an IDR."""
        height, width = self._layout.height, self._layout.width
        planes = pixels.reshape(height * 3 // 2, width)
        frame = VideoFrame.from_ndarray(planes, format="yuv420p")
        frame.pts, self._pictures = self._pictures, self._pictures + 1
        frame.pict_type = PictureType.I if key_frame else PictureType.NONE
        packets: list[Any] = self._context.encode(frame)  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]  # av: bare Packet
        return [nal for packet in packets for nal in split_annex_b(bytes(packet))]


class VideoStream:
    """Encodes and sends the newest picture in a thread of its own; answers RTCP's PLI."""

    def __init__(self, layout: FrameLayout, fps: float, options: VideoOptions) -> None:
        self._layout, self._options = layout, options
        self._encoder = Encoder(layout, fps, options)
        self._step = round(CLOCK_HZ / fps)
        self._waiting: Queue[NDArray[np.uint8]] = Queue(maxsize=1)
        self._closing = threading.Event()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("", 0))
        self._socket.setblocking(False)
        self._thread = threading.Thread(target=self._run, name="video", daemon=True)
        self._thread.start()

    def offer(self, pixels: NDArray[np.uint8]) -> None:
        """Encode and send a copy of `pixels` (flat I420); a picture that still waits gives way."""
        with suppress(Empty):
            self._waiting.get_nowait()
        with suppress(Full):
            self._waiting.put_nowait(pixels.reshape(-1).copy())

    def close(self) -> None:
        """End the thread and the stream."""
        self._closing.set()
        self._thread.join(2 * TICK_S)
        self._socket.close()

    def _run(self) -> None:
        source, sequence, pictures = random.getrandbits(32), random.getrandbits(16), 0
        where = (self._options.address, self._options.port)
        while not self._closing.is_set():
            try:
                pixels = self._waiting.get(timeout=TICK_S)
            except Empty:
                continue
            nals = self._encoder.encode(pixels, key_frame=self._asked() or pictures == 0)
            timestamp = pictures * self._step % 2**32
            for datagram in packetise(nals, sequence, timestamp, source):
                sequence = (sequence + 1) % 0x10000
                with suppress(OSError):  # nobody listens yet, or the buffer is full: it is lost
                    self._socket.sendto(datagram, where)
            pictures += 1

    def _asked(self) -> bool:
        """Return whether a receiver has asked for a key frame since the last call."""
        asked = False
        while True:
            try:
                asked |= is_picture_loss_indication(self._socket.recv(2048))
            except OSError:
                return asked
