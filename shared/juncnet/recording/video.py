"""Recorded H.264 back to frames, each under the header of the picture that it was."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from juncnet.frames import Frame, FrameLayout
from juncnet.h264_decoder import AccessUnitDecoder
from juncnet.messages import PixelFormat, VideoPacket


class VideoDecoder:
    """Decodes access units in order; after a loss or damage none is shown until a key frame.

    Gaps in the headers' sequences are no losses here: a recorder that encodes takes the newest
    frame and leaves others out.
    """

    def __init__(self) -> None:
        self._units = AccessUnitDecoder()

    @property
    def skipped(self) -> int:
        """Access units without a picture: before a key frame, or damaged."""
        return self._units.skipped + self._units.corrupt

    def decode(self, packet: VideoPacket) -> Iterator[Frame]:
        """Yield the frames (I420) that an access unit completes, usually one."""
        for picture, header in self._units.feed(packet, follows=not packet.lost_before):
            planes: Any = picture.reformat(format="yuv420p").to_ndarray()
            layout = FrameLayout.packed(PixelFormat.I420, picture.width, picture.height)
            yield Frame(header, layout, np.ascontiguousarray(planes, np.uint8).reshape(-1))
