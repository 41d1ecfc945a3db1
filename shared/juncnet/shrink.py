"""Resizing by exact area average without converting the big picture to float.

Averaging 1080p straight to 64x64 costs OpenCV milliseconds, as the height is no multiple of 64.
Summing whole rows of bytes is what processors do best, so each band of rows is summed first; only
the rows that two bands share and the small rest are worked on in float32.
"""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]


def shrink(picture: NDArray[np.uint8], size: int) -> F32:
    """Return a picture (H, W) resized to (size, size), float32 in 0..255.

    Every pixel is the mean of the area that it covers, pixels on its edge counted by their part,
    within 0.001 grey levels of float64 arithmetic. A picture with fewer than twice `size` rows or
    columns is resized by OpenCV (`INTER_AREA` in float32), which interpolates where it enlarges.
    """
    import cv2

    height, width = picture.shape
    if picture.shape == (size, size):
        return picture.astype(np.float32)
    if min(height, width) < 2 * size:
        resized = cv2.resize(picture.astype(np.float32), (size, size), interpolation=cv2.INTER_AREA)
        return np.asarray(resized, np.float32)
    bands = _band_sums(picture, size)
    bands *= np.float32(size / height)
    resized = cv2.resize(bands, (size, size), interpolation=cv2.INTER_AREA)
    return np.asarray(resized, np.float32)


def _band_sums(picture: NDArray[np.uint8], size: int) -> F32:
    """Return the sums (size, W) over equally high bands of rows; sums of bytes are exact."""
    import cv2

    starts, stops, cut, above, below = _bands(picture.shape[0], size)
    sums = np.empty((size, picture.shape[1]), np.float32)
    for band, (start, stop) in enumerate(zip(starts, stops, strict=True)):
        cv2.reduce(picture[start:stop], 0, cv2.REDUCE_SUM, sums[band : band + 1], cv2.CV_32F)
    rows = picture[cut].astype(np.float32)
    sums[:-1] += rows * above
    sums[1:] += rows * below
    return sums


@lru_cache(maxsize=64)
def _bands(height: int, size: int) -> tuple[list[int], list[int], NDArray[np.intp], F32, F32]:
    """Return how `height` rows are shared by `size` bands.

    The first row of each band that is all its own and the row after its last one (size); then, for
    each of the size - 1 borders, the row that it cuts and its parts above and below the border,
    (size - 1, 1). Both parts are 0 where a border lies between two rows.
    """
    whole, part = np.divmod(np.arange(1, size) * height, size)
    cut = part > 0
    above = (part / size).astype(np.float32)[:, None]
    below = np.where(cut[:, None], np.float32(1.0) - above, np.float32(0.0))
    starts, stops = [0, *(whole + cut).tolist()], [*whole.tolist(), height]
    return starts, stops, whole, above, below
