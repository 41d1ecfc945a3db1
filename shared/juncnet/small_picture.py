"""The small colour picture that road masks are made of: the same for flying and for training."""

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.frames import Frame
from juncnet.messages import PixelFormat

SIZE = (160, 96)
"""Width and height of the small pictures, whatever the camera's shape."""


def shrink(frame: Frame) -> NDArray[np.uint8]:
    """Return the picture as uint8 (96, 160, 3): luminance, U and V, each averaged over its area.

    Planar formats are never converted at full size; grey pictures get U = V = 128.
    """
    width, height = SIZE
    layout = frame.layout
    if layout.format is PixelFormat.BGR8:
        return np.asarray(cv2.cvtColor(_shrunk(frame.plane()), cv2.COLOR_BGR2YUV), dtype=np.uint8)
    small = np.full((height, width, 3), 128, np.uint8)
    small[..., 0] = _shrunk(frame.plane())
    planes = frame.chroma()
    if layout.format is PixelFormat.I420:
        small[..., 1], small[..., 2] = (_shrunk(plane) for plane in planes)
    elif layout.format is PixelFormat.NV12:
        small[..., 1:] = _shrunk(planes[0])
    return small


def _shrunk(plane: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a plane (H, W) or (H, W, C) at `SIZE`: by a whole factor first, which is fast."""
    height, width = plane.shape[:2]
    factor = min(width // SIZE[0], height // SIZE[1])
    if factor > 1:
        plane = plane[: height // factor * factor, : width // factor * factor]
        whole = (width // factor, height // factor)
        plane = np.asarray(cv2.resize(plane, whole, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return np.asarray(cv2.resize(plane, SIZE, interpolation=cv2.INTER_LINEAR), dtype=np.uint8)
