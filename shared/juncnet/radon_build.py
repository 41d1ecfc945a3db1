"""Building the matrix of a reconstruction map, angle by angle."""

from math import sqrt

import numpy as np

from juncnet import radon
from juncnet.radon import Floats
from juncnet.radon_coordinates import F32, Coordinates
from juncnet.radon_geometry import Geometry, Indices, Symmetry
from juncnet.radon_operator import Correction, Matrix

NEGLIGIBLE = 1e-7
"""What no picture in [0, 1] could show: the rounding of sines, cosines and sums."""
LOW_RANK_ERROR = 1e-5
"""By how much a product of low rank may differ in what it adds to a pixel."""
PARTS = 4
"""Even or odd under the mirrors of rows and of columns: each a quarter of the coordinates."""


def build(geometry: Geometry) -> Matrix:
    """Return the map's matrix, float32, within seconds for 64x64 pictures and 180 angles."""
    coordinates = Coordinates(geometry)
    blocks = _build_blocks(geometry, coordinates)
    if geometry.lattice == geometry.offsets:
        return Matrix(blocks)
    return Matrix(blocks, _rim_corrections(geometry, coordinates), _cut_correction(geometry))


def _build_blocks(geometry: Geometry, coordinates: Coordinates) -> dict[str, F32]:
    """Return the map's matrix by blocks, float32, rows out and columns in.

    They are those of the symmetric lattice. Summed over the angles; of two angles that mirror each
    other one is enough, counted twice.
    """
    even, _ = _edge_weights(geometry)
    lattice = np.outer(even, even)
    blocks = {name: np.zeros(block.shape, np.float32) for name, block in coordinates.blocks.items()}
    for angle, count in _distinct_angles(geometry):
        into, out = _both_ways(geometry, coordinates, angle, lattice)
        for name, block in coordinates.blocks.items():
            rows = out[:, block.outputs[0]] * np.float32(count)
            blocks[name] += rows.T @ into[:, block.inputs[0]]
    return blocks


def _both_ways(
    geometry: Geometry, coordinates: Coordinates, angle: float, lattice: Floats
) -> tuple[F32, F32]:
    """Return one angle's part of the map as the product of two: from a picture's coordinates to a
    projection, (R', G * n), R' the offsets that `lattice` has, and from there, filtered, to the
    reconstruction's, (R', G * m), transposed."""
    filtering, size = _filter(geometry), geometry.domain
    offsets = np.flatnonzero(lattice.any(axis=0))
    forward = _forward_matrix(angle, lattice, size)[offsets]
    backward = _backward_matrix(angle, len(filtering), size, geometry.circle)
    backward *= np.pi / (2 * len(geometry.angles_deg))
    filtered = filtering[:, offsets].T @ backward.reshape(len(backward), -1)
    into, out = (
        coordinates.of_rows(rows.reshape(-1, size, size)) / coordinates.norms[:, None]
        for rows in (forward, filtered)
    )
    into *= coordinates.weights * coordinates.counts
    out = out[:, :, coordinates.kept]
    return into.reshape(len(into), -1), out.reshape(len(out), -1)


def _edge_weights(geometry: Geometry) -> tuple[Floats, Floats]:
    """Return how much each line of the lattice counts, along y and along rho: the part that is even
    under the mirror, and the odd one. Their sum is one, but zero on the last line where the lattice
    has been given an opposite of its first one."""
    even, odd = np.ones(geometry.lattice), np.zeros(geometry.lattice)
    if geometry.lattice != geometry.offsets:
        even[[0, -1]] = 0.5
        odd[[0, -1]] = 0.5, -0.5
    return even, odd


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


def _rim_corrections(geometry: Geometry, coordinates: Coordinates) -> tuple[Correction, ...]:
    """Return what the true lattice's edges add: to each part of the reconstruction, from the other
    parts of the picture.

    Their sources are pixels at the rim. What the first offset of each angle adds has few degrees of
    freedom, and is kept as a product.
    """
    even, odd = _edge_weights(geometry)
    ends_of_lines, first_offset = np.outer(odd, even + odd), np.outer(even, odd)
    distance = radon.distance_from_axis(geometry.domain).ravel()[coordinates.images[0]]
    at_rim = coordinates.counts & (distance > geometry.offsets // 2 - sqrt(2.0))
    sources = np.flatnonzero(at_rim)
    from_part = sources // (at_rim.size // PARTS)
    pairs = [
        (targets, sources[from_part != part])
        for part, targets in enumerate(_outputs_by_part(coordinates))
    ]
    corrections: list[Correction] = []
    for lattice in (ends_of_lines, first_offset):
        matrices = [np.zeros((len(rows), len(columns)), np.float32) for rows, columns in pairs]
        for angle in geometry.angles_deg:
            into, out = _both_ways(geometry, coordinates, angle, lattice)
            for matrix, (targets, others) in zip(matrices, pairs, strict=True):
                matrix += out[:, targets].T @ into[:, others]
        for matrix, (targets, others) in zip(matrices, pairs, strict=True):
            reached = np.abs(matrix).max(axis=0, initial=0.0) > NEGLIGIBLE
            if reached.any():
                factors = _factors(matrix[:, reached])
                corrections.append(Correction(targets, others[reached], factors))
    return tuple(corrections)


def _outputs_by_part(coordinates: Coordinates) -> list[Indices]:
    """Return where the coordinates of each part of a reconstruction lie: ee, eo, oe and oo."""
    spans = [span for block in coordinates.blocks.values() for span in block.outputs]
    size = len(coordinates.signs) * len(coordinates.kept) // PARTS
    by_part = [[span for span in spans if span.start // size == part] for part in range(PARTS)]
    return [np.arange(min(s.start for s in p), max(s.stop for s in p)) for p in by_part]


def _factors(matrix: F32) -> tuple[F32, ...]:
    """Return a matrix (T, P) as a product of two if that saves half of its numbers, or as it is.

    With sources from -1 to 1 its result differs by less than LOW_RANK_ERROR.
    """
    left, values, right = np.linalg.svd(matrix.astype(np.float64), full_matrices=False)
    tail = np.sqrt(np.cumsum(values[::-1] ** 2))[::-1] * sqrt(matrix.shape[1])
    rank = int((tail > LOW_RANK_ERROR).sum())
    if 2 * rank * sum(matrix.shape) >= matrix.size:
        return (matrix,)
    pair = left[:, :rank] * values[:rank], right[:rank]
    return tuple(factor.astype(np.float32) for factor in pair)


def _cut_correction(geometry: Geometry) -> tuple[Correction, ...]:
    """Return the difference of the true map and the mirrored one for the pixels that only the
    latter's back-projection reaches."""
    cut, size, offsets = _cut_off(geometry), geometry.size, geometry.offsets
    if not len(cut):
        return ()
    total = np.zeros((len(cut), size * size))
    even, odd = _edge_weights(geometry)
    lattice = np.outer(even + odd, even + odd)
    mirrored_filter = _filter(geometry)
    true_filter = radon.filter_matrix(offsets, geometry.filter_name, geometry.circle)
    for angle in geometry.angles_deg:
        forward = _forward_matrix(angle, lattice, geometry.domain)
        projection = forward[:, :size, :size].reshape(geometry.lattice, -1)
        for sign, filtering in ((1.0, true_filter), (-1.0, mirrored_filter)):
            back = _backward_matrix(angle, len(filtering), size, geometry.circle)
            back = back.reshape(len(filtering), -1)[:, cut]
            total += sign * (back.T @ filtering) @ projection[: filtering.shape[1]]
    total *= np.pi / (2 * len(geometry.angles_deg))
    return (Correction(cut, np.arange(size * size), (total.astype(np.float32),)),)


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
