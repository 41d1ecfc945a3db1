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


def block_sizes(geometry: Geometry) -> dict[str, int]:
    """Return the number of columns of each block of the map's matrix: e and o for parts even and
    odd under the row mirror, then the column mirror; + and - under the diagonal one."""
    odd = geometry.size // 2
    even = odd + 1
    match geometry.symmetry:
        case Symmetry.NONE:
            return {"all": geometry.size**2}
        case Symmetry.MIRRORS:
            return {"ee": even * even, "eo": even * odd, "oe": even * odd, "oo": odd * odd}
        case Symmetry.SQUARE:
            triangles = {"ee+": even * (even + 1), "ee-": even * odd, "oo+": odd * even}
            triangles["oo-"] = odd * (odd - 1)
            return {"eo": even * odd} | {name: n // 2 for name, n in triangles.items()}


def block_rows(geometry: Geometry) -> dict[str, Indices]:
    """Return the rows that each block has, as indices: of the pixels that are reconstructed."""
    inside = reconstructed(geometry)
    if geometry.symmetry is Symmetry.NONE:
        return {"all": np.flatnonzero(inside)}
    parts = part_indices(inside)
    if geometry.symmetry is Symmetry.MIRRORS:
        return parts
    rows = {"eo": parts["eo"]}
    for name, start in (("ee", geometry.size // 2), ("oo", geometry.size // 2 + 1)):
        quadrant = inside[start:, start:]
        rows[name + "+"] = np.flatnonzero(quadrant[np.triu_indices(len(quadrant))])
        rows[name + "-"] = np.flatnonzero(quadrant[np.triu_indices(len(quadrant), 1)])
    return rows


def reconstructed(geometry: Geometry) -> NDArray[np.bool_]:
    """Return which pixels of the (D, D) domain are reconstructed: with `circle` those inside it."""
    if geometry.circle:
        return ~radon.outside_circle(geometry.domain)
    return np.ones((geometry.domain, geometry.domain), bool)


def part_indices(pixels: NDArray[np.bool_]) -> dict[str, Indices]:
    """Return where `pixels` (D, D), symmetric, lie in the flattened parts of a folded picture."""
    axis = len(pixels) // 2
    quadrant = pixels[axis:, axis:]
    parts = {"ee": quadrant, "eo": quadrant[:, 1:], "oe": quadrant[1:], "oo": quadrant[1:, 1:]}
    return {name: np.flatnonzero(part) for name, part in parts.items()}


def _same_lines(angles: tuple[float, ...], image_of: Callable[[float], float]) -> bool:
    """Return whether the lines at these angles are, as a set, those at the angles' images."""
    ours = np.sort(np.asarray(angles) % 180.0)
    theirs = np.sort(np.asarray([image_of(angle) for angle in angles]) % 180.0)
    # Across the seam 180 equals 0: compare the turned sorted lists as points of a circle.
    shifts = (np.roll(theirs, k) for k in (-1, 0, 1))
    gaps = (np.abs((ours - shifted + 90.0) % 180.0 - 90.0).max() for shifted in shifts)
    return min(gaps) < 1e-9
