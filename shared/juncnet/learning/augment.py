"""Random variation of training pictures that no label depends on."""

import cv2
import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
F32 = NDArray[np.float32]


def mirror(
    gray: Bytes, masks: Bytes | None, rng: np.random.Generator
) -> tuple[Bytes, Bytes | None]:
    """Return pictures (N, S, S) and their masks (N, M, M), half of them mirrored left to right."""
    flipped = rng.random(len(gray)) < 0.5
    gray = np.where(flipped[:, None, None], gray[:, :, ::-1], gray)
    if masks is not None:
        masks = np.where(flipped[:, None, None], masks[:, :, ::-1], masks)
    return gray, masks


def vary(gray: Bytes, rng: np.random.Generator, strength: float) -> Bytes:
    """Return pictures (N, S, S) as another camera might have taken them.

    Gamma, contrast, brightness, shading, blur, noise, a dark or light patch; 0 leaves them be.
    """
    if strength == 0:
        return gray
    n, size = len(gray), gray.shape[1]
    x = _toned(gray, rng, strength)
    ramp = np.linspace(-1, 1, size, dtype=np.float32)
    x += rng.normal(0, 0.05 * strength, (n, 1, 1)).astype(np.float32) * ramp[None, :, None]
    x += rng.normal(0, 0.05 * strength, (n, 1, 1)).astype(np.float32) * ramp[None, None, :]
    blurred = rng.random(n) < 0.3 * strength
    patched = rng.random(n) < 0.2 * strength
    for index in range(n):
        if blurred[index]:
            cv2.GaussianBlur(x[index], (0, 0), float(rng.uniform(0.3, 0.9)), dst=x[index])
        if patched[index]:
            _patch(x[index], rng)
    deviation = rng.uniform(0, 0.03 * strength, (n, 1, 1)).astype(np.float32)
    x += rng.standard_normal(x.shape, np.float32) * deviation
    return (np.clip(x, 0, 1) * 255.0 + 0.5).astype(np.uint8)


def _toned(gray: Bytes, rng: np.random.Generator, strength: float) -> F32:
    """Return pictures in [0, 1], roughly, of another gamma, contrast and brightness."""
    shape = (len(gray), 1)
    levels = np.linspace(0, 1, 256, dtype=np.float32)[None]
    curve = levels ** np.exp(rng.normal(0, 0.3 * strength, shape))
    curve = (curve - 0.5) * np.exp(rng.uniform(-0.5, 0.3, shape) * strength) + 0.5
    curve += rng.uniform(-0.12, 0.12, shape) * strength
    rows = np.arange(len(gray))[:, None, None]
    return curve.astype(np.float32)[rows, gray]


def _patch(picture: F32, rng: np.random.Generator) -> None:
    """Make a convex patch of the picture darker or lighter, as a shadow or a reflection does."""
    size = len(picture)
    corners = rng.uniform(-0.2, 1.2, (3, 2)) * size
    mask = np.zeros(picture.shape, np.uint8)
    cv2.fillConvexPoly(mask, corners.astype(np.int32), 1)
    picture[mask == 1] *= np.float32(rng.uniform(0.5, 1.3))
