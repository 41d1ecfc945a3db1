"""Recorded H.264 back to frames, each under the header of the picture that it was."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from av.codec import CodecContext
from av.codec.context import Flags
from av.error import InvalidDataError
from av.packet import Packet

from juncnet.frames import Frame, FrameLayout
from juncnet.messages import PixelFormat, Stamp, VideoPacket


class VideoDecoder:
    """Decodes access units in order; skips what cannot be decoded until the next key frame."""

    def __init__(self) -> None:
        self._codec: Any = None
        self._headers: list[Stamp] = []
        self.skipped = 0
        """Access units without a picture: before the first key frame, or damaged."""

    def decode(self, packet: VideoPacket) -> Iterator[Frame]:
        """Yield the frames (I420) that an access unit completes, usually one."""
        if packet.key_frame and self._codec is None:
            self._codec = CodecContext.create("h264", "r")
            self._codec.thread_count = 1
            self._codec.flags |= Flags.low_delay
        if self._codec is None:
            self.skipped += 1
            return
        self._headers.append(packet.header)
        try:
            pictures: Any = self._codec.decode(Packet(bytes(packet.payload)))
        except InvalidDataError:
            pictures = []
            self.skipped += len(self._headers)
            self._codec = None
            self._headers.clear()
        for picture in pictures:
            header = self._headers.pop(0)
            planes: Any = picture.reformat(format="yuv420p").to_ndarray()
            layout = FrameLayout.packed(PixelFormat.I420, picture.width, picture.height)
            yield Frame(header, layout, np.ascontiguousarray(planes, np.uint8).reshape(-1))
