"""How alike two frames are, and which frames of a clip are worth keeping.

Both are asked of a *descriptor*: the luminance averaged to 32x32, shifted to mean 0 and scaled to
length 1, so that a change of exposure alone is no change. The *difference* of two frames is the
distance of their descriptors: 0 the same picture, 1.41 two pictures that have nothing in common.
"""

import numpy as np
from numpy.typing import NDArray

from juncnet.shrink import shrink

SIDE = 32
FLAT = 2.0
"""Grey levels of deviation below which a picture shows nothing."""
NEAR_DUPLICATE = 0.25
"""Frames whose difference is smaller are near-duplicates; see deploy/guides/own-footage.md."""

F32 = NDArray[np.float32]
_CHUNK = 512


def descriptor(luminance: NDArray[np.uint8]) -> F32:
    """Return the descriptor (1024,), float32, of a picture (H, W), uint8.

    Its length is 1, or 0 for a picture of one shade.
    """
    small = shrink(luminance, SIDE).ravel()
    centred = small - small.mean()
    length = float(np.sqrt(np.dot(centred, centred)))
    if length < FLAT * SIDE:
        return np.zeros_like(centred)
    return np.asarray(centred / length, np.float32)


def differences(descriptors: F32, other: F32) -> F32:
    """Return the differences (N,) of descriptors (N, 1024) from one (1024,)."""
    return np.asarray(np.sqrt(np.sum((descriptors - other) ** 2, axis=1)), np.float32)


class Novelty:
    """Tells frames of a clip that show something new from near-duplicates of frames kept before."""

    def __init__(self, threshold: float = NEAR_DUPLICATE) -> None:
        """`threshold`: smallest difference from every kept frame at which a frame is new."""
        self._threshold = threshold
        self._kept = np.empty((0, SIDE * SIDE), np.float32)

    def keep(self, candidate: F32) -> bool:
        """Return whether the picture with this descriptor is new, and remember it then."""
        if len(self._kept) and float(differences(self._kept, candidate).min()) < self._threshold:
            return False
        self._kept = np.concatenate([self._kept, candidate[None]])
        return True


def close_pairs(
    first: F32, second: F32, threshold: float = NEAR_DUPLICATE
) -> list[tuple[int, int, float]]:
    """Return (index in `first`, index in `second`, difference) of near-duplicates, closest first.

    Of each row of `first` (N, 1024) only the closest row of `second` (M, 1024) is told.
    """
    if not len(first) or not len(second):
        return []
    squares = np.sum(second**2, axis=1)
    found: list[tuple[int, int, float]] = []
    for start in range(0, len(first), _CHUNK):
        part = first[start : start + _CHUNK]
        apart = np.sum(part**2, axis=1)[:, None] + squares[None] - 2 * part @ second.T
        nearest = apart.argmin(axis=1)
        values = np.sqrt(np.maximum(apart[np.arange(len(part)), nearest], 0))
        found += [
            (start + i, int(nearest[i]), float(values[i]))
            for i in np.flatnonzero(values < threshold).tolist()
        ]
    return sorted(found, key=lambda pair: pair[2])
