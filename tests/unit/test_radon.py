"""The Radon transform against analytic truths and against scikit-image."""

import importlib
import warnings
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from juncnet.radon import FILTERS, evenly_spaced_angles, filtered_back_projection, radon

oracle: Any = importlib.import_module("skimage.transform")  # it has no types
Floats = NDArray[np.floating[Any]]
HALF_TURN = evenly_spaced_angles(60)


def disc(size: int, radius: float) -> NDArray[np.float64]:
    y, x = np.mgrid[:size, :size] - size // 2
    return (np.hypot(x, y) <= radius).astype(np.float64)


def test_a_centre_dot_becomes_a_straight_line() -> None:
    image = np.zeros((33, 33))
    image[16, 16] = 1.0
    sinogram = radon(image, HALF_TURN)
    assert (sinogram.argmax(axis=0) == 16).all()
    assert np.abs(sinogram[:14]).max() == 0.0
    assert np.abs(sinogram[19:]).max() == 0.0


@pytest.mark.parametrize("circle", [True, False])
def test_a_dot_becomes_a_sinusoid(circle: bool) -> None:
    image = np.zeros((64, 64))
    row, column = -9, 14
    image[32 + row, 32 + column] = 1.0
    sinogram = radon(image, HALF_TURN, circle)
    rho = np.arange(len(sinogram)) - len(sinogram) // 2
    theta = np.deg2rad(HALF_TURN)
    centroid = rho @ sinogram / sinogram.sum(axis=0)
    np.testing.assert_allclose(centroid, column * np.cos(theta) - row * np.sin(theta), atol=0.5)


def test_mass_inside_the_circle_is_the_same_at_every_angle() -> None:
    image = disc(64, 20.0) * np.linspace(0.2, 1.0, 64)
    masses = radon(image, HALF_TURN).sum(axis=0)
    np.testing.assert_allclose(masses, image.sum(), rtol=0.01)


def test_both_are_linear() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.random((2, 31, 31))
    np.testing.assert_allclose(
        radon(2 * a - 3 * b, HALF_TURN),
        2 * radon(a, HALF_TURN) - 3 * radon(b, HALF_TURN),
        atol=1e-10,
    )
    s, t = radon(a, HALF_TURN), radon(b, HALF_TURN)
    np.testing.assert_allclose(
        filtered_back_projection(s + 2 * t, HALF_TURN),
        filtered_back_projection(s, HALF_TURN) + 2 * filtered_back_projection(t, HALF_TURN),
        atol=1e-10,
    )


def test_a_disc_is_reconstructed() -> None:
    image = disc(65, 20.0)
    angles = evenly_spaced_angles(180)
    result = filtered_back_projection(radon(image, angles), angles)
    assert abs(result[disc(65, 17.0) > 0].mean() - 1.0) < 0.01
    assert np.abs(result - image)[disc(65, 17.0) > 0].max() < 0.1
    ring = (disc(65, 31.0) > 0) & (disc(65, 23.0) == 0)
    assert np.abs(result[ring]).max() < 0.1


@pytest.mark.parametrize("shape", [(64, 64), (33, 33), (24, 40), (41, 26)])
@pytest.mark.parametrize("circle", [True, False])
@pytest.mark.parametrize("angles", [evenly_spaced_angles(20), (3.0, 77.0, 100.5, -45.0)])
def test_agrees_with_scikit_image(
    shape: tuple[int, int], circle: bool, angles: tuple[float, ...]
) -> None:
    image = np.random.default_rng(3).random(shape)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        expected: Any = oracle.radon(image, np.asarray(angles), circle=circle)
    sinogram = radon(image, angles, circle)
    np.testing.assert_allclose(sinogram, expected, atol=1e-9)
    for name in (*FILTERS, None):
        back: Any = oracle.iradon(expected, np.asarray(angles), filter_name=name, circle=circle)
        ours = filtered_back_projection(sinogram, angles, name, circle)
        np.testing.assert_allclose(ours, back, atol=1e-9)


def test_what_cannot_be_done_is_refused_by_name() -> None:
    image = np.zeros((8, 8))
    with pytest.raises(ValueError, match="angles_deg"):
        radon(image, [])
    with pytest.raises(ValueError, match="angles_deg"):
        radon(image, [float("nan")])
    with pytest.raises(ValueError, match="picture"):
        radon(np.zeros((8, 8, 3)), HALF_TURN)
    with pytest.raises(ValueError, match="float"):
        radon(np.zeros((8, 8), np.uint8), HALF_TURN)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="does not fit"):
        filtered_back_projection(np.zeros((8, 3)), HALF_TURN)
    with pytest.raises(ValueError, match="gauss"):
        filtered_back_projection(
            np.zeros((8, 60)),
            HALF_TURN,
            "gauss",  # pyright: ignore[reportArgumentType]
        )
