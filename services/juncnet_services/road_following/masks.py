"""Where the road is in a small picture: by its colour, or by a small trained network."""

from pathlib import Path
from typing import Any, Protocol, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.small_picture import SIZE


class MaskError(ValueError):
    """A road mask model cannot be used; the text says why."""


class RoadMask(Protocol):
    """Tells road from everything else."""

    def probability(self, small: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Return the probability of road, float32 (h, w), of a `shrink`ed picture."""
        ...


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
