"""Where the road is in a picture: small colour pictures, and two ways to a road mask of them."""

from pathlib import Path
from typing import Any, Protocol, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.frames import Frame
from juncnet.messages import PixelFormat

SIZE = (160, 96)
"""Width and height of the small pictures, whatever the camera's shape."""


class MaskError(ValueError):
    """A road mask model cannot be used; the text says why."""


class RoadMask(Protocol):
    """Tells road from everything else."""

    def probability(self, small: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Return the probability of road, float32 (h, w), over the whole of a picture of `shrink`."""
        ...


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
    chroma = frame.pixels[layout.stride * layout.height :]
    if layout.format is PixelFormat.I420:
        planes = chroma.reshape(2, layout.height // 2, layout.stride // 2)
        small[..., 1] = _shrunk(planes[0, :, : layout.width // 2])
        small[..., 2] = _shrunk(planes[1, :, : layout.width // 2])
    elif layout.format is PixelFormat.NV12:
        pairs = chroma.reshape(layout.height // 2, layout.stride // 2, 2)
        small[..., 1:] = _shrunk(pairs[:, : layout.width // 2])
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


class ColourMask:
    """Road is what has the colours of the patch in front of the robot; needs no model.

    Mean and spread of luminance, U and V of the patch are followed over time; a pixel's
    probability falls with its distance from them in units of that spread.
    """

    def __init__(self, patch: tuple[float, float, float, float] = (0.38, 0.80, 0.62, 0.98)) -> None:
        """`patch`: left, top, right, bottom of the patch as fractions of the picture."""
        width, height = SIZE
        self._columns = slice(round(patch[0] * width), round(patch[2] * width))
        self._rows = slice(round(patch[1] * height), round(patch[3] * height))
        self._mean: NDArray[np.float32] | None = None
        self._spread = np.zeros(3, np.float32)

    def probability(self, small: NDArray[np.uint8]) -> NDArray[np.float32]:
        smooth = cv2.medianBlur(small, 3).astype(np.float32)
        seed = smooth[self._rows, self._columns].reshape(-1, 3)
        mean = np.median(seed, axis=0)
        spread = 1.5 * np.median(np.abs(seed - mean), axis=0) + np.array([7.0, 2.5, 2.5])
        if self._mean is None:
            self._mean, self._spread = mean.astype(np.float32), spread.astype(np.float32)
        self._mean += 0.1 * (mean - self._mean)
        self._spread += 0.1 * (spread - self._spread)
        distance = (((smooth - self._mean) / (2.2 * self._spread)) ** 2).sum(axis=2)
        probability = np.exp(-0.7 * distance**2)
        closed = cv2.morphologyEx(probability, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
        return np.asarray(closed, dtype=np.float32)


class NetworkMask:
    """Road is what a small trained network says (`juncnet.learning.road_mask`), on one thread."""

    def __init__(self, path: Path) -> None:
        """Load the ONNX file.

        Raises:
            MaskError: there is no such file, or it is no road mask for pictures of `SIZE`.
        """
        import onnxruntime

        ort = cast(Any, onnxruntime)
        if not path.is_file():
            raise MaskError(f"no road mask model at {path}: give a path, or mask = 'colour'")
        options = ort.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 3
        session = ort.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        shape = session.get_inputs()[0].shape
        expected = [1, SIZE[1], SIZE[0], 3]
        if shape != expected:
            raise MaskError(f"{path} takes pictures of {shape}, road masks need {expected}")
        self._session: Any = session

    def probability(self, small: NDArray[np.uint8]) -> NDArray[np.float32]:
        (answer,) = self._session.run(None, {"picture": small[None]})
        return np.asarray(answer, dtype=np.float32)[0]
