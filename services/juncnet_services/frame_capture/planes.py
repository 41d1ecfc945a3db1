"""Decoded pictures as frames: which layout, and their planes copied once into the transport."""

from functools import partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from juncnet.frames import FrameLayout
from juncnet.messages import PixelFormat
from juncnet_services.frame_capture.contract import Picture

if TYPE_CHECKING:
    from av.video.frame import VideoFrame

FORMATS = {
    "yuv420p": PixelFormat.I420,
    "yuvj420p": PixelFormat.I420,
    "nv12": PixelFormat.NV12,
    "bgr24": PixelFormat.BGR8,
    "gray": PixelFormat.GRAY8,
}
"""FFmpeg's pixel formats that travel as they are; every other is converted to I420."""
PLANAR = (PixelFormat.I420, PixelFormat.NV12)


def picture_of(frame: "VideoFrame", captured_ns: int) -> Picture:
    """Return the picture of a decoded frame, its planes not copied yet.

    I420 and NV12 need even sizes: the last column or row of an odd picture is left out.

    Raises:
        MessageError: a size outside 2..16384.
    """
    if frame.format.name not in FORMATS:
        frame = frame.reformat(format="yuv420p")
    kind = FORMATS[frame.format.name]
    even = 2 if kind in PLANAR else 1
    width, height = frame.width // even * even, frame.height // even * even
    layout = FrameLayout.packed(kind, width, height)
    return Picture(layout, partial(write_planes, frame, layout), captured_ns)


def write_planes(frame: "VideoFrame", layout: FrameLayout, out: NDArray[np.uint8]) -> None:
    """Copy the planes of `frame`, without padding, into `out`: flat uint8 of `layout.nbytes`."""
    start = 0
    for index, plane in enumerate(frame.planes):
        rows = layout.height if index == 0 else layout.height // 2
        width = _row_bytes(layout, index)
        padded = np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)
        out[start : start + rows * width].reshape(rows, width)[...] = padded[:rows, :width]
        start += rows * width


def write_pixels(pixels: NDArray[np.uint8], out: NDArray[np.uint8]) -> None:
    """Copy `pixels` (any shape, uint8) into `out`, flat uint8 of the same number of bytes."""
    out[...] = pixels.reshape(-1)


def _row_bytes(layout: FrameLayout, plane: int) -> int:
    if plane > 0 and layout.format is PixelFormat.I420:
        return layout.width // 2
    return layout.stride
