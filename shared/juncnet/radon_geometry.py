"""The parameters of a reconstruction map and the symmetry that follows from them."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from juncnet import radon
from juncnet.radon import FilterName

Indices = NDArray[np.intp]

MAX_SIZE = 256
"""Largest side of a picture: the map's matrix grows with its fourth power."""


class Symmetry(StrEnum):
    """What the map commutes with."""

    NONE = "none"
    MIRRORS = "mirrors"
    """Up-down and left-right."""
    SQUARE = "square"
    """Those and the diagonals: the whole group of the square."""


@dataclass(frozen=True)
class Geometry:
    """The parameters that the map depends on.

    `size` is the side of the square picture; angles in degrees; `filter_name` and `circle` as
    `juncnet.radon` takes them.
    """

    size: int
    angles_deg: tuple[float, ...]
    filter_name: FilterName | None = "ramp"
    circle: bool = False

    def __post_init__(self) -> None:
        if not 2 <= self.size <= MAX_SIZE:
            raise ValueError(f"size: {self.size} outside 2..{MAX_SIZE}")
        radon.checked_angles(self.angles_deg)
        radon.filter_response(64, self.filter_name)

    @property
    def offsets(self) -> int:
        """R, the number of offsets of a projection."""
        return radon.projection_size(self.size, self.size, self.circle)

    @property
    def symmetry(self) -> Symmetry:
        """What the map commutes with, what its `Matrix` corrects aside."""
        if not _same_lines(self.angles_deg, lambda a: -a):
            return Symmetry.NONE
        square = _same_lines(self.angles_deg, lambda a: 90.0 - a)
        return Symmetry.SQUARE if square else Symmetry.MIRRORS

    @property
    def lattice(self) -> int:
        """Number of offsets that the blocks are built for: odd if mirrored."""
        return self.offsets if self.symmetry is Symmetry.NONE else self.offsets | 1

    @property
    def domain(self) -> int:
        """Side of the square on which the map is built: if mirrored odd, the axis in its middle."""
        return self.size if self.symmetry is Symmetry.NONE else 2 * (self.size // 2) + 1


def _same_lines(angles: tuple[float, ...], image_of: Callable[[float], float]) -> bool:
    """Return whether the lines at these angles are, as a set, those at the angles' images."""
    ours = np.sort(np.asarray(angles) % 180.0)
    theirs = np.sort(np.asarray([image_of(angle) for angle in angles]) % 180.0)
    # Across the seam 180 equals 0: compare the turned sorted lists as points of a circle.
    shifts = (np.roll(theirs, k) for k in (-1, 0, 1))
    gaps = (np.abs((ours - shifted + 90.0) % 180.0 - 90.0).max() for shifted in shifts)
    return min(gaps) < 1e-9
