"""A frame of a camera as a small JPEG whose luminance is the camera's own.

A JPEG's Y is full-range, a camera's usually is not. Converting would give a network other pixels in
training than in flight, where it sees the camera's Y as it comes. So Y, U and V are stored as they
are: colours look a little pale, and reading the JPEG as grayscale gives the camera's Y.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.frames import Frame
from juncnet.messages import PixelFormat

Bytes = NDArray[np.uint8]


def as_stored(frame: Frame, height: int) -> Bytes:
    """Return a frame at most `height` high, its shape kept: (H, W, 3) BGR, or (H, W) if gray.

    Made by area average. Of I420 and NV12 the planes count as full-range, see above.
    """
    scale = min(1.0, height / frame.height)
    size = (max(round(frame.width * scale), 2), max(round(frame.height * scale), 2))
    kind = frame.layout.format
    if kind is PixelFormat.GRAY8:
        return _resized(frame.luminance(), size)
    if kind is PixelFormat.BGR8:
        return _resized(frame.bgr(), size)
    u, v = _chroma(frame)
    planes = [_resized(plane, size) for plane in (frame.luminance(), v, u)]
    return np.asarray(cv2.cvtColor(cv2.merge(planes), cv2.COLOR_YCrCb2BGR), np.uint8)


def jpeg(pixels: Bytes, quality: int = 92) -> bytes:
    """Return pixels, (H, W, 3) BGR or (H, W), as JPEG."""
    done, data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ValueError(f"OpenCV cannot write a JPEG of {pixels.shape} {pixels.dtype}")
    return data.tobytes()


def _chroma(frame: Frame) -> tuple[Bytes, Bytes]:
    """Return U and V, each a quarter of the picture, of a packed I420 or NV12 frame."""
    layout = frame.layout
    luma = layout.stride * layout.height
    rest = frame.pixels[luma:]
    if layout.format is PixelFormat.NV12:
        pairs = rest.reshape(layout.height // 2, layout.stride)[:, : layout.width]
        return pairs[:, 0::2], pairs[:, 1::2]
    shape = (layout.height // 2, layout.width // 2)
    count = shape[0] * shape[1]
    return rest[:count].reshape(shape), rest[count : 2 * count].reshape(shape)


def _resized(plane: Bytes, size: tuple[int, int]) -> Bytes:
    if (plane.shape[1], plane.shape[0]) == size:
        return plane
    smaller = plane.shape[1] > size[0]
    how = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(plane, size, interpolation=how), np.uint8)
