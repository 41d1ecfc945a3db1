"""Coordinates in which a map that commutes with the mirrors of the square falls into blocks.

An orbit is a pixel with its mirror images, as many places as the group has elements (G); on a
mirror some coincide. Sums of an orbit's pixels with signs, one row of signs after the other, are
its coordinates: even or odd ("e", "o") under the mirror of the rows, then of the columns; "+" and
"-" under the diagonal one. A map that commutes with the mirrors leads from a coordinate to itself
only: a block for each row of signs. The diagonal mirror exchanges the parts "eo" and "oe": one
block serves both.

On a mirror some coordinates vanish or repeat. The orbits are sorted so that for every row of signs
those that count are neighbours: first those on one kind of mirror, the generic ones, those on the
other kind, the centre.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from juncnet import radon
from juncnet.radon_geometry import Geometry, Indices, Symmetry

F32 = NDArray[np.float32]

_MIRRORS = np.array([[1, 1, 1, 1], [1, -1, 1, -1], [1, 1, -1, -1], [1, -1, -1, 1]], np.float32)
"""Signs of the parts ee, oe, eo, oo for a pixel (y, x), (-y, x), (y, -x), (-y, -x)."""
_NONE = np.zeros(4, np.float32)
_EE, _OE, _EO, _OO = _MIRRORS
_SQUARE = np.block(
    [
        [_EE, _EE],
        [_EE, -_EE],
        [_OO, _OO],
        [_OO, -_OO],
        [_EO, _NONE],
        [_NONE, _EO],
        [_NONE, _OE],
        [_OE, _NONE],
    ]
)
"""Signs for those, then for the four of (x, y): of ee+, ee-, oo+, oo-, eo of (y, x) and of (x, y),
and oe of (x, y) and of (y, x), which is the same as eo with rows and columns exchanged."""


@dataclass(frozen=True)
class Block:
    """Where a block's coordinates lie, in the flattened coordinates (G * n) of a picture and in
    those (G * m) of its reconstruction; once for each part that the block serves."""

    inputs: tuple[slice, ...]
    outputs: tuple[slice, ...]

    @property
    def shape(self) -> tuple[int, int]:
        """Number of rows and of columns of the block."""
        rows, columns = self.outputs[0], self.inputs[0]
        return rows.stop - rows.start, columns.stop - columns.start


class Coordinates:
    """The coordinates of pictures and of their reconstructions.

    Attributes:
        signs: (G, G) float32, -1, 0 or 1: what each pixel of an orbit adds to each coordinate.
        norms: (G,) float32: how many pixels a coordinate is the sum of.
        images: (G, n) places of the orbits' pixels in the flattened domain (D * D).
        inputs: (G, n) the same in the flattened picture (S * S), S * S where it has no such pixel.
        kept: (m,) which of the n orbits are reconstructed.
        outputs: (S * S,) where each pixel lies in (G, m), flattened; G * m if not reconstructed.
        weights: (G, n) float32: distinct pixels of a coordinate as a fraction of its norm.
        counts: (G, n) bool: which coordinates neither vanish nor repeat.
        blocks: by name, where each block's coordinates lie.
    """

    def __init__(self, geometry: Geometry) -> None:
        size, domain = geometry.size, geometry.domain
        symmetry = geometry.symmetry
        self.signs = {Symmetry.MIRRORS: _MIRRORS, Symmetry.SQUARE: _SQUARE}.get(
            symmetry, np.ones((1, 1), np.float32)
        )
        self.norms = np.abs(self.signs).sum(axis=1)
        self.images, runs = _orbits(domain, symmetry)
        self.inputs = _within(self.images, domain, size)
        inside = np.ones((domain, domain), bool)
        if geometry.circle:
            inside = ~radon.outside_circle(domain)
        inside = inside.ravel()[self.images[0]]
        self.kept = np.flatnonzero(inside)
        group, kept = len(self.signs), len(self.kept)
        places = np.full(size * size + 1, group * kept, np.intp)
        places[self.inputs[:, self.kept]] = np.arange(group * kept).reshape(group, kept)
        self.outputs = places[:-1]
        kept_runs = np.bincount(np.repeat(np.arange(4), runs)[inside], minlength=4)
        inputs = _spans(np.cumsum([0, *runs]), symmetry, repeated=False)
        outputs = _spans(np.cumsum([0, *kept_runs]), symmetry, repeated=True)
        self.blocks = {name: Block(inputs[name], outputs[name]) for name in inputs}
        self.weights = _distinct(self.images, self.signs) / self.norms[:, None]
        self.counts = np.zeros((group, self.images.shape[1]), bool)
        for block in self.blocks.values():
            for span in block.inputs:
                self.counts.ravel()[span] = True

    def of_rows(self, rows: NDArray[np.floating]) -> F32:
        """Return the coordinates (R, G, n) of the rows of a matrix, (R, D, D)."""
        flat = rows.reshape(len(rows), -1).astype(np.float32)
        return self.signs @ flat.take(self.images, axis=1)


def _orbits(domain: int, symmetry: Symmetry) -> tuple[Indices, list[int]]:
    """Return the orbits' pixels (G, n) in the flattened square, and how many are of each kind."""
    if symmetry is Symmetry.NONE:
        return np.arange(domain * domain)[None], [0, domain * domain, 0, 0]
    half = domain // 2
    if symmetry is Symmetry.SQUARE:
        y, x = np.tril_indices(half + 1)
        other = y == x
    else:
        y, x = (axis.ravel() for axis in np.indices((half + 1, half + 1)))
        other = y == 0
    kind = np.where(other, np.where(x == 0, 3, 2), np.where(x == 0, 0, 1))
    order = np.argsort(kind, kind="stable")
    y, x = y[order], x[order]

    def places(y: Indices, x: Indices) -> list[Indices]:
        around = ((y, x), (-y, x), (y, -x), (-y, -x))
        return [(half + row) * domain + half + column for row, column in around]

    images = places(y, x) + (places(x, y) if symmetry is Symmetry.SQUARE else [])
    return np.array(images), np.bincount(kind, minlength=4).tolist()


def _spans(starts: Indices, symmetry: Symmetry, repeated: bool) -> dict[str, tuple[slice, ...]]:
    """Return where the blocks' coordinates lie; `starts` are those of the four kinds, and the end.

    The span of a part that the mirror on the diagonal leads into the other one goes on from a row
    of signs into the next; between them lies the centre, whose coordinate is zero. On the diagonal
    the second row repeats the first: a picture's sums need it once, each of its pixels `repeated`.
    """
    _, generic, second, centre, end = starts.tolist()

    def row(number: int, start: int, stop: int) -> tuple[slice, ...]:
        return (slice(number * end + start, number * end + stop),)

    if symmetry is Symmetry.NONE:
        return {"all": row(0, 0, end)}
    if symmetry is Symmetry.MIRRORS:
        return {
            "ee": row(0, 0, end),
            "oe": row(1, 0, second),
            "eo": row(2, generic, centre),
            "oo": row(3, generic, second),
        }
    last = end + (centre if repeated else second)
    return {
        "ee+": row(0, 0, end),
        "ee-": row(1, 0, second),
        "oo+": row(2, generic, centre),
        "oo-": row(3, generic, second),
        "eo": row(4, generic, last) + row(6, generic, last),
    }


def _within(images: Indices, domain: int, size: int) -> Indices:
    """Return places in the flattened square of `domain` as places in the flattened picture, which
    may lack its last row and column; `size` squared for what lies on them."""
    y, x = np.divmod(images, domain)
    return np.where((y < size) & (x < size), y * size + x, size * size)


def _distinct(images: Indices, signs: F32) -> F32:
    """Return how many different pixels each coordinate is the sum of, (G, n)."""
    counts = np.empty(images.shape, np.float32)
    for row, sign in enumerate(signs):
        pixels = np.sort(images[sign != 0.0], axis=0)
        counts[row] = 1 + (np.diff(pixels, axis=0) != 0).sum(axis=0)
    return counts
