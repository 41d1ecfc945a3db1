"""What a lens, a moving camera and a video encoder do to a picture."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]


class Lens:
    """Radial distortion of one camera: r becomes r (1 + k r^2), r = 1 at half the diagonal."""

    def __init__(self, k: float, size: tuple[int, int]) -> None:
        """Prepare for pictures of the aspect of `size` (width, height); 0 distorts nothing."""
        self._k, self._aspect = k, size[0] / size[1]
        self._maps: dict[tuple[int, ...], tuple[NDArray[np.float32], NDArray[np.float32]]] = {}

    @classmethod
    def drawn(cls, rng: np.random.Generator, largest: float, size: tuple[int, int]) -> "Lens":
        """Return a lens with a distortion of -largest to largest."""
        return cls(float(rng.uniform(-largest, largest)), size)

    def bend(self, picture: Bytes, smooth: bool = True) -> Bytes:
        """Return the picture (H, W), or with `smooth` false a mask, as this lens shows it."""
        if self._k == 0:
            return picture
        if picture.shape not in self._maps:
            self._maps[picture.shape] = self._map(picture.shape[0], picture.shape[1])
        flags = cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST
        x, y = self._maps[picture.shape]
        bent = cv2.remap(picture, x, y, flags, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(bent, np.uint8)

    def _map(self, height: int, width: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        x, y = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
        r2 = ((x * self._aspect) ** 2 + y**2) / (self._aspect**2 + 1)
        scale = (1 + self._k * r2) / (1 + max(self._k, 0.0))
        columns, rows = (x * scale + 1) / 2 * (width - 1), (y * scale + 1) / 2 * (height - 1)
        return columns.astype(np.float32), rows.astype(np.float32)


@dataclass(frozen=True)
class Faults:
    """How often pictures are blurred by motion and compressed, 0..1."""

    motion_blur: float
    compression: float

    def add(self, picture: Bytes, rng: np.random.Generator) -> Bytes:
        """Return the picture (H, W) with the faults that were drawn for it, or none."""
        if rng.random() < self.motion_blur:
            length = int(rng.integers(2, 8))
            kernel = np.zeros((length, length), np.float32)
            slope = float(rng.uniform(-1, 1))
            steps = np.arange(length)
            rows = np.clip(np.rint((steps - length / 2) * slope + length / 2), 0, length - 1)
            kernel[rows.astype(int), steps] = 1.0 / length
            kernel = kernel.T if rng.random() < 0.5 else kernel
            picture = np.asarray(cv2.filter2D(picture, -1, kernel), np.uint8)
        if rng.random() < self.compression:
            quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(15, 81))]
            packed = cv2.imencode(".jpg", picture, quality)[1]
            picture = np.asarray(cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE), np.uint8)
        return picture
