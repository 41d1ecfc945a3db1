"""Pictures of a camera that gives no H.264 of its own, as H.264 for the recording."""

from fractions import Fraction
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray

from juncnet.frames import Frame, FrameLayout
from juncnet.messages import PixelFormat, VideoPacket

TIME_BASE = Fraction(1, 1_000_000)
_FORMATS = {
    PixelFormat.I420: "yuv420p",
    PixelFormat.NV12: "nv12",
    PixelFormat.BGR8: "bgr24",
    PixelFormat.GRAY8: "gray",
}


class Encoder:
    """Encodes frames one by one, each into one access unit, without delay; in one thread.

    Quality is what `crf` says; speed is bought with size. The last row or column of an odd picture
    is left out.
    """

    def __init__(self, crf: int, key_frame_every: int) -> None:
        self._crf, self._every = crf, key_frame_every
        self._layout: FrameLayout | None = None
        self._codec: Any = None
        self._count = 0

    def restart(self) -> None:
        """Make the next access unit one that decoding can start with."""
        self._codec = None

    def encode(self, frame: Frame) -> VideoPacket:
        """Return the access unit of a frame, under its header."""
        codec = self._codec
        if codec is None or frame.layout != self._layout:
            codec = self._open(frame.layout)
        picture = av.VideoFrame.from_ndarray(_planes(frame), format=_FORMATS[frame.layout.format])
        if frame.layout.format is not PixelFormat.I420:
            picture = picture.reformat(format="yuv420p")
        picture.pts, picture.time_base = self._count * 40_000, TIME_BASE
        self._count += 1
        packets = codec.encode(picture)
        data = b"".join(bytes(packet) for packet in packets)
        key_frame = any(packet.is_keyframe for packet in packets)
        return VideoPacket.of(data, header=frame.header, key_frame=key_frame)

    def _open(self, layout: FrameLayout) -> Any:
        codec: Any = av.CodecContext.create("libx264", "w")
        codec.width, codec.height = layout.width // 2 * 2, layout.height // 2 * 2
        codec.pix_fmt = "yuv420p"
        codec.time_base, codec.thread_count = TIME_BASE, 1
        x264 = f"keyint={self._every}:min-keyint={self._every}:scenecut=0:repeat-headers=1:annexb=1"
        codec.options = {
            "preset": "ultrafast",
            "tune": "zerolatency",
            "crf": str(self._crf),
            "x264-params": x264,
        }
        self._layout, self._codec, self._count = layout, codec, 0
        return codec


def _planes(frame: Frame) -> NDArray[np.uint8]:
    layout = frame.layout
    if layout.format in (PixelFormat.I420, PixelFormat.NV12):
        whole = frame.pixels.reshape(layout.height * 3 // 2, layout.stride)
        return np.ascontiguousarray(whole[:, : layout.width])
    return np.ascontiguousarray(frame.plane()[: layout.height // 2 * 2, : layout.width // 2 * 2])
