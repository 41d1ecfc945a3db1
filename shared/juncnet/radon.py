"""The Radon transform and filtered back-projection, as the paper's equations 1 to 6 have them.

The discretisation is scikit-image's (`radon`, `iradon` with linear interpolation), written anew
with numpy only: the rotation axis is the pixel (H // 2, W // 2), offsets count pixels from it, and
angles are in degrees. Axis letters: `(H, W)` image, `(R, A)` sinogram (offsets by angles).

With `circle` a projection is as wide as the picture's shorter side and the reconstruction is zero
outside the inscribed circle; without, it is as wide as the diagonal and nothing is cut off.
"""

from collections.abc import Sequence
from math import ceil, floor, sqrt
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
FilterName = Literal["ramp", "shepp-logan", "cosine", "hamming", "hann"]
FILTERS: tuple[FilterName, ...] = get_args(FilterName)


def evenly_spaced_angles(count: int) -> tuple[float, ...]:
    """Return `count` angles that divide the half turn evenly, from 0 [degrees]."""
    return tuple(180.0 * i / count for i in range(count))


def projection_size(height: int, width: int, circle: bool) -> int:
    """Return R, the number of offsets of one projection of an (height, width) picture."""
    return min(height, width) if circle else ceil(sqrt(2) * max(height, width))


def reconstruction_size(offsets: int, circle: bool) -> int:
    """Return the side of the square that is reconstructed from projections of R offsets."""
    return offsets if circle else floor(sqrt(offsets**2 / 2.0))


def radon(image: Floats, angles_deg: Sequence[float], circle: bool = True) -> Floats:
    """Return the sinogram of a picture: its line integrals by offset and angle.

    The paper's equations 1 and 2: g(rho, theta) is the double integral of
    f(x, y) delta(x cos theta + y sin theta - rho). The delta becomes sums along one axis of the
    picture turned by theta and sampled with bilinear interpolation, zero outside the picture.

    Args:
        image: (H, W) float32 or float64, any range; rows are read with their sign as they lie.
        angles_deg: the A angles theta.
        circle: crop to the central square, offsets within it; its corners still count.

    Returns:
        (R, A) of the image's dtype, R as `projection_size` gives it; row R // 2 is rho = 0.

    Raises:
        ValueError: not a picture, no angle, or an angle that is not finite.
    """
    angles = checked_angles(angles_deg)
    square, origin = _central_square(_checked_picture(image), circle)
    offsets = projection_size(image.shape[0], image.shape[1], circle)
    bordered = np.pad(square, 1)
    sinogram = np.empty((offsets, len(angles)), image.dtype)
    for column, angle in enumerate(angles):
        index, weight = bilinear_samples(angle, offsets, square.shape, origin)
        values = bordered.ravel()[index]
        sinogram[:, column] = np.einsum("kyr,kyr->r", values, weight.astype(image.dtype))
    return sinogram


def filtered_back_projection(
    sinogram: Floats,
    angles_deg: Sequence[float],
    filter_name: FilterName | None = "ramp",
    circle: bool = True,
    output_size: int | None = None,
) -> Floats:
    """Return the picture whose sinogram this is, as far as the angles tell.

    The paper's equations 3 to 6: by the Fourier slice theorem (3, 4) the one-dimensional transform
    G(omega, theta) of a projection is a line through the picture's two-dimensional transform; in
    polar coordinates (5) the inverse transform gains the factor |omega|, the ramp filter; what
    remains (6) is the back-projection, the integral over theta of the filtered projection at
    rho = x cos theta + y sin theta, here read with linear interpolation.

    Args:
        sinogram: (R, A) float32 or float64, as `radon` returns it.
        angles_deg: the A angles theta.
        filter_name: the window on |omega|; `ramp` has none, None leaves |omega| out as well.
        circle: as given to `radon`; the result is zero outside the inscribed circle.
        output_size: side of the result; None: as `reconstruction_size` gives it.

    Returns:
        (S, S) of the sinogram's dtype.

    Raises:
        ValueError: an unknown filter, or angles that do not fit the sinogram.
    """
    angles = checked_angles(angles_deg)
    if sinogram.ndim != 2 or sinogram.shape[1] != len(angles):
        raise ValueError(f"sinogram of shape {sinogram.shape} does not fit {len(angles)} angles")
    offsets = sinogram.shape[0]
    size = output_size or reconstruction_size(offsets, circle)
    filtered = filter_matrix(offsets, filter_name, circle) @ sinogram.astype(np.float64)
    total = np.zeros((size, size))
    for column, angle in enumerate(angles):
        low, weight_low, weight_high = linear_samples(angle, size, len(filtered))
        total += weight_low * filtered[low, column] + weight_high * filtered[low + 1, column]
    if circle:
        total[outside_circle(size)] = 0.0
    return (total * (np.pi / (2 * len(angles)))).astype(sinogram.dtype)


def checked_angles(angles_deg: Sequence[float]) -> tuple[float, ...]:
    """Return the angles as floats; ValueError when there is none or one is not finite."""
    angles = tuple(float(angle) for angle in angles_deg)
    if not angles or not np.isfinite(angles).all():
        raise ValueError("angles_deg: needs at least one angle, all of them finite")
    return angles


def bilinear_samples(
    angle_deg: float, offsets: int, shape: tuple[int, int], origin: tuple[float, float]
) -> tuple[NDArray[np.intp], Floats]:
    """Return where the turned picture is read from: the delta of equations 1 and 2, discretised.

    Args:
        angle_deg: theta.
        offsets: R, the side of the square lattice that is turned.
        shape: (h, w) of the picture.
        origin: row and column of the rotation axis in the picture.

    Returns:
        index (4, R, R): the four neighbours of lattice point (y, rho) in the flattened picture with
        a border of one zero pixel; weight (4, R, R) float64. Points outside read the border.
    """
    axis = np.arange(offsets) - float(offsets // 2)
    cos, sin = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
    columns = cos * axis + sin * axis[:, None] + origin[1]
    rows = -sin * axis + cos * axis[:, None] + origin[0]
    height, width = shape
    row, column = np.floor(rows), np.floor(columns)
    down, right = rows - row, columns - column
    top, left = row.astype(np.intp) + 1, column.astype(np.intp) + 1
    y = np.clip(np.stack((top, top, top + 1, top + 1)), 0, height + 1)
    x = np.clip(np.stack((left, left + 1, left, left + 1)), 0, width + 1)
    weight = np.stack(
        ((1 - down) * (1 - right), (1 - down) * right, down * (1 - right), down * right)
    )
    return y * (width + 2) + x, weight


def linear_samples(
    angle_deg: float, size: int, offsets: int
) -> tuple[NDArray[np.intp], Floats, Floats]:
    """Return where each pixel reads a projection: rho of equation 6 between two offsets.

    Returns:
        low (size, size): the offset's row below rho; the weights of that row and of the next, both
        zero where rho lies outside the projection. `offsets` is the number of its rows, 2 or more.
    """
    axis = np.arange(size) - size // 2
    theta = np.deg2rad(angle_deg)
    rho = axis * np.cos(theta) - axis[:, None] * np.sin(theta)
    centre = offsets // 2
    inside = (rho >= -centre) & (rho <= offsets - 1 - centre)
    position = np.where(inside, rho + centre, 0.0)
    low = np.minimum(position.astype(np.intp), offsets - 2)
    high_part = position - low
    return low, np.where(inside, 1.0 - high_part, 0.0), np.where(inside, high_part, 0.0)


def outside_circle(size: int) -> NDArray[np.bool_]:
    """Return which pixels of a (size, size) picture lie outside its inscribed circle."""
    return distance_from_axis(size) > size // 2


def distance_from_axis(size: int) -> Floats:
    """Return how far each pixel of a (size, size) picture lies from the rotation axis [pixels]."""
    axis = np.arange(size) - size // 2
    return np.sqrt(axis**2 + axis[:, None] ** 2)


def back_projection_size(offsets: int, circle: bool) -> int:
    """Return R', the number of offsets that are filtered: with `circle` more than R, by zeros."""
    return ceil(sqrt(2) * offsets) if circle else offsets


def filter_matrix(
    offsets: int, filter_name: FilterName | None, circle: bool, mirrored: bool = False
) -> Floats:
    """Return the filter of equation 5 as a matrix from the offsets of a projection to those of the
    back-projection.

    Returns:
        (R', R) float64, a Toeplitz matrix. `mirrored` adds to an even number of offsets, of either
        side, the opposite of the first one.
    """
    padded = back_projection_size(offsets, circle)
    length = max(64, 2 ** ceil(np.log2(2 * padded)))
    kernel = np.real(np.fft.ifft(filter_response(length, filter_name)))
    sizes = (padded | 1, offsets | 1) if mirrored else (padded, offsets)
    back, front = (np.arange(n) - n // 2 for n in sizes)
    return kernel[(back[:, None] - front) % length]


def filter_response(length: int, filter_name: FilterName | None) -> Floats:
    """Return |omega| times the window in FFT order, (length,) float64, length even.

    The ramp is the transform of its own samples (Kak and Slaney, chapter 3, equation 61), which
    spares the reconstruction a small bias.

    Raises:
        ValueError: an unknown filter.
    """
    if filter_name is None:
        return np.ones(length)
    if filter_name not in FILTERS:
        raise ValueError(f"unknown filter {filter_name!r}: one of {', '.join(FILTERS)} or None")
    distance = np.minimum(np.arange(length), length - np.arange(length))
    samples = np.zeros(length)
    samples[0] = 0.25
    samples[1::2] = -1.0 / (np.pi * distance[1::2]) ** 2
    return 2.0 * np.real(np.fft.fft(samples)) * _window(length, filter_name)


def _window(length: int, filter_name: FilterName) -> Floats:
    """Return the window of a filter, (length,) in FFT order. Hamming and Hann are lopsided by half
    a sample, as scikit-image's are; the real part taken after them evens that out."""
    match filter_name:
        case "ramp":
            return np.ones(length)
        case "shepp-logan":
            return np.sinc(np.fft.fftfreq(length))
        case "cosine":
            return np.fft.fftshift(np.sin(np.linspace(0, np.pi, length, endpoint=False)))
        case "hamming":
            return np.fft.fftshift(np.hamming(length))
        case "hann":
            return np.fft.fftshift(np.hanning(length))


def _checked_picture(image: Floats) -> Floats:
    if image.ndim != 2 or min(image.shape) < 2:
        raise ValueError(f"needs a picture (H, W) of at least 2x2 pixels, got {image.shape}")
    if not np.issubdtype(image.dtype, np.floating):
        raise ValueError(f"needs a float picture, got {image.dtype}")
    return image


def _central_square(image: Floats, circle: bool) -> tuple[Floats, tuple[float, float]]:
    """Return the part of the picture that is projected and the rotation axis in it."""
    height, width = image.shape
    if circle:
        side = min(height, width)
        top, left = (ceil((full - side) / 2) for full in (height, width))
        image = image[top : top + side, left : left + side]
        height, width = side, side
    return image, (float(height // 2), float(width // 2))
