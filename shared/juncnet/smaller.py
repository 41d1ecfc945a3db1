"""Smaller pictures in the format that they came in: for whoever looks or records, beside a flight.

Planar pictures are never converted at full size: that costs more than all that follows.
"""

import numpy as np
from numpy.typing import NDArray

from juncnet.frames import Frame, FrameLayout
from juncnet.messages import PixelFormat


def smaller(frame: Frame, max_width: int) -> Frame:
    """Return the picture at most `max_width` (2 or more) wide, under its header, in its format.

    It keeps its shape within a pixel, two where the format needs even sizes. One that is not wider
    is returned as it is, still in the memory that it came in; any other has memory of its own.
    """
    layout = frame.layout
    if layout.width <= max_width:
        return frame
    planar = layout.format in (PixelFormat.I420, PixelFormat.NV12)
    even = 2 if planar else 1
    width = max_width // even * even
    height = max(2, round(layout.height * width / layout.width / even) * even)
    planes = [_shrunk(frame.plane(), (width, height))]
    planes += [_shrunk(plane, (width // 2, height // 2)) for plane in frame.chroma()]
    pixels = np.concatenate([plane.reshape(-1) for plane in planes])
    return Frame(frame.header, FrameLayout.packed(layout.format, width, height), pixels)


def _shrunk(plane: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.uint8]:
    """Return a plane (H, W) or (H, W, C) at `size` (width, height): halved while it can be.

    A half is the mean of 2x2 pixels, which is as fast as a copy; the rest is interpolated.
    """
    import cv2

    height, width = plane.shape[:2]
    while width >= 2 * size[0] and height >= 2 * size[1]:
        width, height = width // 2, height // 2
        even = plane[: 2 * height, : 2 * width]
        plane = np.asarray(
            cv2.resize(even, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8
        )
    if (width, height) == size:
        return plane
    return np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_LINEAR), dtype=np.uint8)
