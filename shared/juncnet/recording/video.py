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
    """Decodes access units in order; after a loss or damage none is shown until a key frame.

    Gaps in the headers' sequences are no losses here: a recorder that encodes takes the newest
    frame and leaves others out.
    """

    def __init__(self) -> None:
        self._codec: Any = None
        self._headers: dict[int, Stamp] = {}
        self._fed = 0
        self.skipped = 0
        """Access units without a picture: before a key frame, or damaged."""

    def decode(self, packet: VideoPacket) -> Iterator[Frame]:
        """Yield the frames (I420) that an access unit completes, usually one."""
        if packet.lost_before:
            self._codec = None
        if self._codec is None and not packet.key_frame:
            self.skipped += 1
            return
        if self._codec is None:
            self._begin()
        self._fed += 1
        self._headers[self._fed] = packet.header
        unit = Packet(bytes(packet.payload))
        unit.pts = self._fed
        try:
            pictures: Any = self._codec.decode(unit)
        except InvalidDataError:
            self.skipped += len(self._headers)
            self._codec = None
            return
        for picture in pictures:
            header = self._headers.pop(picture.pts)
            planes: Any = picture.reformat(format="yuv420p").to_ndarray()
            layout = FrameLayout.packed(PixelFormat.I420, picture.width, picture.height)
            yield Frame(header, layout, np.ascontiguousarray(planes, np.uint8).reshape(-1))

    def _begin(self) -> None:
        self._headers.clear()
        self._codec = CodecContext.create("h264", "r")
        self._codec.thread_count = 1
        self._codec.options = {"err_detect": "explode"}
        self._codec.flags |= Flags.low_delay
