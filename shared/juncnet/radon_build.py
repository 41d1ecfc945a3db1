"""Building the matrix of a reconstruction map, angle by angle."""

import numpy as np

from juncnet import radon
from juncnet.radon import Floats
from juncnet.radon_geometry import Geometry, Symmetry
from juncnet.radon_operator import Blocks, Correction, Indices, Matrix, coordinates

NEGLIGIBLE = 1e-9
"""Weights below this are the rounding of sines and cosines."""


def build(geometry: Geometry) -> Matrix:
    """Return the map's matrix, float32, within seconds for 64x64 pictures and 180 angles."""
    blocks = _build_blocks(geometry)
    if geometry.symmetry is Symmetry.NONE:
        return Matrix(blocks)
    cut = _cut_off(geometry)
    corrections = (_rim_correction(geometry, cut), _cut_correction(geometry, cut))
    return Matrix(blocks, tuple(c for c in corrections if c.matrix.size))


def _build_blocks(geometry: Geometry) -> Blocks:
    """Return the map's matrix by blocks, float32 (n, n) each, rows out and columns in.

    Names: `all` without symmetry; else e and o for parts even and odd under the row mirror, then
    the column mirror; + and - under the diagonal one. Summed over the angles; of two angles that
    mirror each other one is enough, counted twice.
    """
    symmetry = geometry.symmetry
    offsets, size = geometry.lattice, geometry.domain
    matrix = _filter(geometry)
    back_size = len(matrix)
    blocks: Blocks = {}
    for angle, count in _distinct_angles(geometry):
        forward = _forward_matrix(angle, offsets, size)
        backward = _backward_matrix(angle, back_size, size, geometry.circle)
        filtered = (matrix @ forward.reshape(offsets, -1)).reshape(back_size, size, size)
        into = coordinates(filtered.astype(np.float32), symmetry, centre=0.5)
        out = coordinates(backward.astype(np.float32), symmetry, centre=1.0)
        scale = np.float32(count * np.pi / (2 * len(geometry.angles_deg)))
        for name, part in into.items():
            product = np.matmul((out[name] * scale).T, part, dtype=np.float32)
            if name in blocks:
                blocks[name] += product
            else:
                blocks[name] = product
    return blocks


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


def _rim_correction(geometry: Geometry, cut: Indices) -> Correction:
    """Return what takes back the lattice points that the mirrored lattice has too many.

    They lie in its last row and its last column, so only pixels at the rim are concerned.
    """
    size, lattice = geometry.size, geometry.lattice
    inside = np.ones((size, size), bool)
    if geometry.circle:
        inside = ~radon.outside_circle(size)
    inside.ravel()[cut] = False
    targets = np.flatnonzero(inside)
    if lattice == geometry.offsets:
        return Correction(targets, targets[:0], np.zeros((len(targets), 0), np.float32))
    touched = np.zeros(size * size)
    for angle in geometry.angles_deg:
        touched += _extra_matrix(geometry, angle).sum(axis=0)
    sources = np.flatnonzero(touched > NEGLIGIBLE)
    total = np.zeros((len(targets), len(sources)), np.float32)
    filtering = _filter(geometry)
    for angle in geometry.angles_deg:
        back = _backward_matrix(angle, len(filtering), size, geometry.circle)
        back = back.reshape(len(filtering), -1)[:, targets].astype(np.float32)
        total += back.T @ (filtering @ _extra_matrix(geometry, angle)[:, sources]).astype(
            np.float32
        )
    total *= np.float32(-np.pi / (2 * len(geometry.angles_deg)))
    return Correction(targets, sources, total)


def _cut_correction(geometry: Geometry, cut: Indices) -> Correction:
    """Return the difference of the true map and the mirrored one for the pixels `cut`."""
    size, offsets = geometry.size, geometry.offsets
    sources = np.arange(size * size)
    total = np.zeros((len(cut), len(sources)))
    if not len(cut):
        return Correction(cut, sources, total.astype(np.float32))
    mirrored_filter = _filter(geometry)
    true_filter = radon.filter_matrix(offsets, geometry.filter_name, geometry.circle)
    for angle in geometry.angles_deg:
        forward = _forward_matrix(angle, geometry.lattice, geometry.domain)[:, :size, :size]
        forward = forward.reshape(geometry.lattice, -1)
        true = (forward - _extra_matrix(geometry, angle))[:offsets]
        for sign, filtering, projection in (
            (1.0, true_filter, true),
            (-1.0, mirrored_filter, forward),
        ):
            back = _backward_matrix(angle, len(filtering), size, geometry.circle)
            back = back.reshape(len(filtering), -1)[:, cut]
            total += sign * (back.T @ filtering) @ projection
    total *= np.pi / (2 * len(geometry.angles_deg))
    return Correction(cut, sources, total.astype(np.float32))


def _extra_matrix(geometry: Geometry, angle: float) -> Floats:
    """Return the part of a projection (lattice, S * S) that is due to the lattice's last row and
    column, of which the true lattice has none."""
    size = geometry.size
    matrix = _forward_matrix(angle, geometry.lattice, geometry.domain, only_last=True)
    return matrix[:, :size, :size].reshape(geometry.lattice, -1)


def _distinct_angles(geometry: Geometry) -> list[tuple[float, int]]:
    """Return angles and how often to count each: mirror images are counted, not built."""
    if geometry.symmetry is Symmetry.NONE:
        return [(angle, 1) for angle in geometry.angles_deg]
    counts: dict[float, list[float]] = {}
    for angle in geometry.angles_deg:
        folded = angle % 180.0
        counts.setdefault(round(min(folded, 180.0 - folded), 9), []).append(angle)
    return [(same[0], len(same)) for same in counts.values()]


def _forward_matrix(angle: float, offsets: int, size: int, only_last: bool = False) -> Floats:
    """Return one projection as a matrix (R, size, size): its offsets from the picture's pixels.

    `only_last`: only what the lattice's last row and last column contribute.
    """
    origin = (float(size // 2), float(size // 2))
    index, weight = radon.bilinear_samples(angle, offsets, (size, size), origin)
    if only_last:
        weight[:, :-1, :-1] = 0.0
    bordered = (size + 2) ** 2
    target = index + np.arange(offsets) * bordered
    matrix = np.zeros(offsets * bordered)
    matrix += np.bincount(target.ravel(), weight.ravel(), minlength=len(matrix))
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
