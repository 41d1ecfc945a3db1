"""Radon transform and filtered back-projection at once: one linear map, applied to whole batches.

As a dense matrix the map of 64x64 pictures has 4096 x 4096 numbers, and reading them takes longer
than multiplying. The discretisation of `juncnet.radon` commutes exactly with the mirrors of the
square about the rotation axis, and with its diagonal ones, if the lattice of offsets is symmetric
(an odd number of them) and so are the angles. In coordinates that are even or odd under each mirror
the matrix then falls into blocks: of 561, 528, 528 and 496 rows, and one of 1056 rows used twice:
together 7.5 times smaller and 5 times less to multiply, without any approximation. A picture of
even side is first given the row and the column of zeros that it lacks opposite to its first ones.
"""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from juncnet import radon
from juncnet.radon import FilterName

F32 = NDArray[np.float32]
Blocks = dict[str, F32]
Indices = tuple[NDArray[np.intp], NDArray[np.intp]]
Parts = tuple[F32, F32, F32, F32]
MAX_SIZE = 256
"""Largest side of a picture: the matrix grows with its fourth power."""


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
        """What the map commutes with."""
        if self.offsets % 2 == 0 or not _same_lines(self.angles_deg, lambda a: -a):
            return Symmetry.NONE
        square = _same_lines(self.angles_deg, lambda a: 90.0 - a)
        return Symmetry.SQUARE if square else Symmetry.MIRRORS

    @property
    def domain(self) -> int:
        """Side of the square on which the map is built: if mirrored odd, the axis in its middle."""
        return self.size if self.symmetry is Symmetry.NONE else 2 * (self.size // 2) + 1


class Reconstruction:
    """The map from pictures to their filtered back-projections, ready to be applied.

    Args:
        geometry: the map's parameters.
        blocks: its matrix in coordinates of the symmetry, as `build_blocks` returns it.
    """

    def __init__(self, geometry: Geometry, blocks: Blocks) -> None:
        self.geometry = geometry
        self._blocks = blocks
        self._half = geometry.size // 2
        self._even_upper = np.triu_indices(self._half + 1)
        self._even_strict = np.triu_indices(self._half + 1, 1)
        self._odd_upper = np.triu_indices(self._half)
        self._odd_strict = np.triu_indices(self._half, 1)

    @property
    def nbytes(self) -> int:
        """Memory of the matrix in bytes."""
        return sum(block.nbytes for block in self._blocks.values())

    def __call__(self, pictures: F32) -> F32:
        """Return `filtered_back_projection(radon(picture))` of every picture.

        Within 1e-5 of float64 arithmetic for pictures in [0, 1].

        Args:
            pictures: (N, S, S) float32, S the geometry's size.

        Returns:
            (N, S, S) float32. The arithmetic of a batch and of a single picture may differ in the
            last bits, as the matrix library's summation order does.
        """
        size = self.geometry.size
        if pictures.ndim != 3 or pictures.shape[1:] != (size, size):
            raise ValueError(f"pictures: needs (N, {size}, {size}), got {pictures.shape}")
        if self.geometry.symmetry is Symmetry.NONE:
            return self._multiply("all", pictures)
        extended = pictures
        if size % 2 == 0:
            extended = np.zeros((len(pictures), size + 1, size + 1), np.float32)
            extended[:, :size, :size] = pictures
        square = self.geometry.symmetry is Symmetry.SQUARE
        apply = self._square_parts if square else self._mirror_parts
        return _unfold(apply(*_fold(extended)))[:, :size, :size]

    def _multiply(self, name: str, part: F32) -> F32:
        """Return the block's product with each row of `part` (N, ...), in the same shape."""
        block = self._blocks[name]
        flat = part.reshape(len(part), block.shape[1])
        if len(flat) == 1:
            return (block @ flat[0]).reshape(part.shape)
        return (flat @ block.T).reshape(part.shape)

    def _mirror_parts(self, ee: F32, eo: F32, oe: F32, oo: F32) -> Parts:
        multiply = self._multiply
        return multiply("ee", ee), multiply("eo", eo), multiply("oe", oe), multiply("oo", oo)

    def _square_parts(self, ee: F32, eo: F32, oe: F32, oo: F32) -> Parts:
        both = self._multiply("eo", np.concatenate((eo, oe.transpose(0, 2, 1))))
        return (
            self._diagonal_parts("ee", ee, self._even_upper, self._even_strict),
            both[: len(eo)],
            both[len(eo) :].transpose(0, 2, 1),
            self._diagonal_parts("oo", oo, self._odd_upper, self._odd_strict),
        )

    def _diagonal_parts(self, name: str, part: F32, upper: Indices, strict: Indices) -> F32:
        """Return the product for a part that is split further by the mirror on the diagonal."""
        turned = part.transpose(0, 2, 1)
        even = self._multiply(name + "+", (part + turned)[:, *upper])
        odd = self._multiply(name + "-", (part - turned)[:, *strict])
        result = np.empty_like(part)
        result[:, *upper] = even
        result[:, upper[1], upper[0]] = even
        result[:, *strict] += odd
        result[:, strict[1], strict[0]] -= odd
        return result


def block_sizes(geometry: Geometry) -> dict[str, int]:
    """Return the number of rows, and of columns, of each block of the map's matrix."""
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


def build_blocks(geometry: Geometry) -> Blocks:
    """Return the map's matrix by blocks, float32 (n, n) each, rows out and columns in.

    Names: `all` without symmetry; else e and o for parts even and odd under the row mirror, then
    the column mirror; + and - under the diagonal one. Summed over the angles; of two angles that
    mirror each other one is enough, counted twice.
    """
    symmetry = geometry.symmetry
    offsets, size = geometry.offsets, geometry.domain
    matrix = radon.filter_matrix(offsets, geometry.filter_name, geometry.circle)
    back_size = len(matrix)
    blocks: Blocks = {}
    for angle, count in _distinct_angles(geometry):
        forward = _forward_matrix(angle, offsets, size)
        backward = _backward_matrix(angle, back_size, size, geometry.circle)
        filtered = (matrix @ forward.reshape(offsets, -1)).reshape(back_size, size, size)
        into = _coordinates(filtered.astype(np.float32), symmetry, centre=0.5)
        out = _coordinates(backward.astype(np.float32), symmetry, centre=1.0)
        scale = np.float32(count * np.pi / (2 * len(geometry.angles_deg)))
        for name, part in into.items():
            product = np.matmul((out[name] * scale).T, part, dtype=np.float32)
            if name in blocks:
                blocks[name] += product
            else:
                blocks[name] = product
    return blocks


def _same_lines(angles: tuple[float, ...], image_of: Callable[[float], float]) -> bool:
    """Return whether the lines at these angles are, as a set, those at the angles' images."""
    ours = np.sort(np.asarray(angles) % 180.0)
    theirs = np.sort(np.asarray([image_of(angle) for angle in angles]) % 180.0)
    # Across the seam 180 equals 0: compare the turned sorted lists as points of a circle.
    shifts = (np.roll(theirs, k) for k in (-1, 0, 1))
    gaps = (np.abs((ours - shifted + 90.0) % 180.0 - 90.0).max() for shifted in shifts)
    return min(gaps) < 1e-9


def _distinct_angles(geometry: Geometry) -> list[tuple[float, int]]:
    """Return angles and how often to count each: mirror images are counted, not built."""
    if geometry.symmetry is Symmetry.NONE:
        return [(angle, 1) for angle in geometry.angles_deg]
    counts: dict[float, list[float]] = {}
    for angle in geometry.angles_deg:
        folded = angle % 180.0
        counts.setdefault(round(min(folded, 180.0 - folded), 9), []).append(angle)
    return [(same[0], len(same)) for same in counts.values()]


def _forward_matrix(angle: float, offsets: int, size: int) -> NDArray[np.float64]:
    """Return one projection as a matrix (R, size, size): its offsets from the picture's pixels."""
    origin = (float(size // 2), float(size // 2))
    index, weight = radon.bilinear_samples(angle, offsets, (size, size), origin)
    bordered = (size + 2) ** 2
    target = index + np.arange(offsets) * bordered
    matrix = np.zeros(offsets * bordered)
    matrix += np.bincount(target.ravel(), weight.ravel(), minlength=len(matrix))
    return matrix.reshape(offsets, size + 2, size + 2)[:, 1:-1, 1:-1]


def _backward_matrix(angle: float, offsets: int, size: int, circle: bool) -> NDArray[np.float64]:
    """Return one back-projection as a matrix (R', size, size): what each offset adds to a pixel."""
    low, weight_low, weight_high = radon.linear_samples(angle, size, offsets)
    if circle:
        outside = radon.outside_circle(size)
        weight_low[outside] = weight_high[outside] = 0.0
    matrix = np.zeros((offsets, size * size))
    pixel = np.arange(size * size)
    matrix[low.ravel(), pixel] = weight_low.ravel()
    matrix[low.ravel() + 1, pixel] = weight_high.ravel()
    return matrix.reshape(offsets, size, size)


def _coordinates(rows: F32, symmetry: Symmetry, centre: float) -> Blocks:
    """Return rows of a matrix (R, D, D) in coordinates of the symmetry, (R, n) for each block.

    `centre` weighs what lies on a mirror: sums count it twice, so the map's input side takes half.
    """
    if symmetry is Symmetry.NONE:
        return {"all": rows.reshape(len(rows), -1)}
    ee, eo, oe, oo = _fold(rows)
    for part in (ee, eo, oe, oo):
        part *= np.float32(0.25)
    ee[:, 0] *= np.float32(centre)
    ee[:, :, 0] *= np.float32(centre)
    eo[:, 0] *= np.float32(centre)
    oe[:, :, 0] *= np.float32(centre)
    blocks: Blocks = {"eo": eo.reshape(len(eo), -1)}
    if symmetry is Symmetry.MIRRORS:
        for name, part in (("ee", ee), ("oe", oe), ("oo", oo)):
            blocks[name] = part.reshape(len(part), -1)
        return blocks
    for name, part in (("ee", ee), ("oo", oo)):
        upper, strict = np.triu_indices(part.shape[1]), np.triu_indices(part.shape[1], 1)
        weight = np.where(upper[0] == upper[1], 0.5 * centre, 0.5).astype(np.float32)
        turned = part.transpose(0, 2, 1)
        blocks[name + "+"] = (part + turned)[:, *upper] * weight
        blocks[name + "-"] = (part - turned)[:, *strict] * np.float32(0.5)
    return blocks


def _fold(pictures: F32) -> Parts:
    """Return the parts of pictures (N, D, D), D = 2 h + 1, even or odd under row, column mirrors.

    (N, h+1, h+1) even in both, (N, h+1, h) even in rows, (N, h, h+1) even in columns, (N, h, h):
    sums and differences of mirrored pixels, outwards from the axis.
    """
    half = pictures.shape[1] // 2
    down, up = pictures[:, half:], pictures[:, half::-1]
    even, odd = down + up, down[:, 1:] - up[:, 1:]

    def columns(rows: F32) -> tuple[F32, F32]:
        right, left = rows[:, :, half:], rows[:, :, half::-1]
        return right + left, right[:, :, 1:] - left[:, :, 1:]

    return *columns(even), *columns(odd)


def _unfold(parts: Parts) -> F32:
    """Return the pictures (N, D, D) with these halved parts: the inverse of `_fold`, unscaled."""
    ee, eo, oe, oo = parts
    half = oo.shape[1]
    even = _mirror(ee, eo, half)
    odd = _mirror(oe, oo, half)
    pictures = np.empty((len(ee), 2 * half + 1, 2 * half + 1), np.float32)
    pictures[:, half:] = even
    pictures[:, half + 1 :] += odd
    pictures[:, half - 1 :: -1] = even[:, 1:]
    pictures[:, half - 1 :: -1] -= odd
    return pictures


def _mirror(even: F32, odd: F32, half: int) -> F32:
    """Return rows (N, M, 2 h + 1) of their even (N, M, h+1) and odd (N, M, h) parts."""
    rows = np.empty((*even.shape[:2], 2 * half + 1), np.float32)
    rows[:, :, half:] = even
    rows[:, :, half + 1 :] += odd
    rows[:, :, half - 1 :: -1] = even[:, :, 1:]
    rows[:, :, half - 1 :: -1] -= odd
    return rows
