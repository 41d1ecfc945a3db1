"""Building the matrix of a reconstruction map, angle by angle."""

from itertools import accumulate
from math import sqrt

import numpy as np

from juncnet import radon
from juncnet.radon import Floats
from juncnet.radon_geometry import (
    Geometry,
    Indices,
    Symmetry,
    block_rows,
    part_indices,
    reconstructed,
)
from juncnet.radon_operator import Blocks, Correction, Matrix, coordinates

NEGLIGIBLE = 1e-7
"""What no picture in [0, 1] could show: the rounding of sines, cosines and sums."""
PARTS = ("ee", "eo", "oe", "oo")
"""A picture's parts, even or odd under the mirrors of rows and of columns, as they are folded."""


def build(geometry: Geometry) -> Matrix:
    """Return the map's matrix, float32, within seconds for 64x64 pictures and 180 angles."""
    blocks = _build_blocks(geometry)
    if geometry.lattice == geometry.offsets:
        return Matrix(blocks)
    return Matrix(blocks, _rim_corrections(geometry), _cut_correction(geometry))


def _build_blocks(geometry: Geometry) -> Blocks:
    """Return the map's matrix by blocks, float32, rows out and columns in.

    They are those of the symmetric lattice. Summed over the angles; of two angles that mirror each
    other one is enough, counted twice.
    """
    symmetry = geometry.symmetry
    rows = block_rows(geometry)
    even, _ = _lattice_weights(geometry)
    blocks: Blocks = {}
    for angle, count in _distinct_angles(geometry):
        into, out = _both_ways(geometry, angle, even, symmetry)
        for name, part in into.items():
            block = np.matmul(
                out[name][:, rows[name]].T, part * np.float32(count), dtype=np.float32
            )
            blocks[name] = blocks[name] + block if name in blocks else block
    return blocks


def _both_ways(
    geometry: Geometry, angle: float, lattice: Floats, symmetry: Symmetry
) -> tuple[Blocks, Blocks]:
    """Return one angle's part of the map, (R', n) for each part of the picture: filtered projection
    and back-projection."""
    filtering, size = _filter(geometry), geometry.domain
    forward = _forward_matrix(angle, lattice, size)
    filtered = (filtering @ forward.reshape(len(lattice), -1)).reshape(-1, size, size)
    backward = _backward_matrix(angle, len(filtering), size, geometry.circle)
    backward *= np.pi / (2 * len(geometry.angles_deg))
    return (
        coordinates(filtered.astype(np.float32), symmetry, centre=0.5),
        coordinates(backward.astype(np.float32), symmetry, centre=1.0),
    )


def _lattice_weights(geometry: Geometry) -> tuple[Floats, Floats]:
    """Return how much each point (y, rho) of the lattice counts: the part that is even under both
    its mirrors, and the rest. Their sum is one, but zero on the last row and column where the
    lattice has been given an opposite of its first ones."""
    even, odd = np.ones(geometry.lattice), np.zeros(geometry.lattice)
    if geometry.lattice != geometry.offsets:
        even[[0, -1]] = 0.5
        odd[[0, -1]] = 0.5, -0.5
    symmetric = np.outer(even, even)
    return symmetric, np.outer(even + odd, even + odd) - symmetric


def _filter(geometry: Geometry) -> Floats:
    """Return the filter's matrix on the lattice that the blocks are built for."""
    mirrored = geometry.symmetry is not Symmetry.NONE
    return radon.filter_matrix(geometry.offsets, geometry.filter_name, geometry.circle, mirrored)


def _cut_off(geometry: Geometry) -> Indices:
    """Return the pixels that the mirrored lattice's back-projection reaches, but the true one not:
    at some angle their rho lies beyond the last offset, where there is no opposite of the first."""
    size = geometry.size
    offsets = radon.back_projection_size(geometry.offsets, geometry.circle)
    missed = np.zeros((size, size), bool)
    for angle in geometry.angles_deg:
        true = radon.linear_samples(angle, size, offsets)
        mirrored = radon.linear_samples(angle, size, offsets | 1)
        missed |= (true[1] + true[2] < 0.5) & (mirrored[1] + mirrored[2] > 0.5)
    if geometry.circle:
        missed[radon.outside_circle(size)] = False
    return np.flatnonzero(missed)


def _rim_corrections(geometry: Geometry) -> tuple[Correction, ...]:
    """Return what the rest of the lattice adds: to each part of the picture, from the others.

    The rest lies on the lattice's edges, so its sources are pixels at the rim.
    """
    _, rest = _lattice_weights(geometry)
    distance = radon.distance_from_axis(geometry.domain)
    rim = part_indices(distance > geometry.offsets // 2 - sqrt(2.0))
    rows = part_indices(reconstructed(geometry))
    total: Blocks = {}
    for angle in geometry.angles_deg:
        into, out = _both_ways(geometry, angle, rest, Symmetry.MIRRORS)
        for part in PARTS:
            others = np.hstack([into[other][:, rim[other]] for other in PARTS if other != part])
            added = out[part][:, rows[part]].T @ others
            total[part] = total[part] + added if part in total else added
    sizes = [len(indices) for indices in part_indices(np.ones_like(distance, bool)).values()]
    start: dict[str, int] = dict(zip(PARTS, accumulate(sizes, initial=0), strict=False))
    corrections: list[Correction] = []
    for part, matrix in total.items():
        sources = np.hstack([start[other] + rim[other] for other in PARTS if other != part])
        reached = np.abs(matrix).max(axis=0, initial=0.0) > NEGLIGIBLE
        corrections.append(
            Correction(start[part] + rows[part], sources[reached], matrix[:, reached])
        )
    return tuple(corrections)


def _cut_correction(geometry: Geometry) -> tuple[Correction, ...]:
    """Return the difference of the true map and the mirrored one for the pixels that only the
    latter's back-projection reaches."""
    cut, size, offsets = _cut_off(geometry), geometry.size, geometry.offsets
    if not len(cut):
        return ()
    total = np.zeros((len(cut), size * size))
    even, rest = _lattice_weights(geometry)
    mirrored_filter = _filter(geometry)
    true_filter = radon.filter_matrix(offsets, geometry.filter_name, geometry.circle)
    for angle in geometry.angles_deg:
        forward = _forward_matrix(angle, even + rest, geometry.domain)
        projection = forward[:, :size, :size].reshape(geometry.lattice, -1)
        for sign, filtering in ((1.0, true_filter), (-1.0, mirrored_filter)):
            back = _backward_matrix(angle, len(filtering), size, geometry.circle)
            back = back.reshape(len(filtering), -1)[:, cut]
            total += sign * (back.T @ filtering) @ projection[: filtering.shape[1]]
    total *= np.pi / (2 * len(geometry.angles_deg))
    return (Correction(cut, np.arange(size * size), total.astype(np.float32)),)


def _distinct_angles(geometry: Geometry) -> list[tuple[float, int]]:
    """Return angles and how often to count each: mirror images are counted, not built."""
    if geometry.symmetry is Symmetry.NONE:
        return [(angle, 1) for angle in geometry.angles_deg]
    counts: dict[float, list[float]] = {}
    for angle in geometry.angles_deg:
        folded = angle % 180.0
        counts.setdefault(round(min(folded, 180.0 - folded), 9), []).append(angle)
    return [(same[0], len(same)) for same in counts.values()]


def _forward_matrix(angle: float, lattice: Floats, size: int) -> Floats:
    """Return one projection as a matrix (R, size, size): its offsets from the picture's pixels, its
    points weighed by `lattice` (R, R)."""
    offsets = len(lattice)
    origin = (float(size // 2), float(size // 2))
    index, weight = radon.bilinear_samples(angle, offsets, (size, size), origin)
    bordered = (size + 2) ** 2
    target = index + np.arange(offsets) * bordered
    matrix = np.zeros(offsets * bordered)
    matrix += np.bincount(target.ravel(), (weight * lattice).ravel(), minlength=len(matrix))
    return matrix.reshape(offsets, size + 2, size + 2)[:, 1:-1, 1:-1]


def _backward_matrix(angle: float, offsets: int, size: int, circle: bool) -> Floats:
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
