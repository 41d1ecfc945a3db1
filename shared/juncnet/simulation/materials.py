"""Fine textures of the ground: small tiles that repeat, and smooth noise that does not."""

from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

Material = Literal["grass", "asphalt", "concrete", "cobble", "gravel", "dirt", "slabs", "plain"]
MATERIALS: tuple[Material, ...] = (
    "grass",
    "asphalt",
    "concrete",
    "cobble",
    "gravel",
    "dirt",
    "slabs",
    "plain",
)
Bytes = NDArray[np.uint8]
Floats = NDArray[np.float32]


def smooth_noise(height: int, width: int, cells: float, rng: np.random.Generator) -> Floats:
    """Return (height, width) float32 noise, mean 0, deviation about 1, that never repeats.

    `cells` is the width of its bumps in pixels.
    """
    rows, cols = int(height / cells) + 4, int(width / cells) + 4
    grid = rng.standard_normal((rows, cols)).astype(np.float32)
    big = cv2.resize(
        grid, (round(cols * cells) + 1, round(rows * cells) + 1), interpolation=cv2.INTER_CUBIC
    )
    skip = round(cells)
    part = np.asarray(big[skip : skip + height, skip : skip + width], np.float32)
    return part * 1.4


def periodic_noise(size: int, cells: int, rng: np.random.Generator) -> Floats:
    """Return (size, size) float32 noise with `cells` bumps a side that continues at its edges."""
    if cells >= size:
        return rng.standard_normal((size, size)).astype(np.float32)
    grid = rng.standard_normal((cells, cells)).astype(np.float32)
    padded = np.pad(grid, 2, mode="wrap")
    step = size / cells
    side = round((cells + 4) * step)
    big = cv2.resize(padded, (side, side), interpolation=cv2.INTER_CUBIC)
    skip = round(2 * step)
    return np.asarray(big[skip : skip + size, skip : skip + size], np.float32) * 1.3


def _octaves(size: int, weights: dict[int, float], rng: np.random.Generator) -> Floats:
    total = np.zeros((size, size), np.float32)
    for cells, weight in weights.items():
        total += weight * periodic_noise(size, max(2, cells), rng)
    return total


def _stones(size: int, stone_px: float, rng: np.random.Generator) -> Floats:
    """Return rows of set stones with dark joints between them, every second row shifted."""
    rows = max(2, 2 * round(size / stone_px / 2))
    shade = rng.standard_normal((rows, rows)).astype(np.float32) * 13
    position = (np.arange(size) + 0.5) * rows / size
    row = position.astype(np.intp)[:, None]
    along = position[None, :] + 0.5 * (row % 2)
    column = along.astype(np.intp) % rows
    edge = np.minimum(np.abs(along % 1 - 0.5), 1) + np.zeros((size, 1))
    edge = np.maximum(edge, np.abs(position[:, None] % 1 - 0.5))
    joint = np.clip((edge - 0.34) / 0.16, 0, 1) * 34
    return (shade[row % rows, column] - joint + 8).astype(np.float32)


def tile(material: Material, metres_per_px: float, contrast: float, seed: int) -> Bytes:
    """Return (S, S) uint8 texture of a material, 128 for no change of its brightness.

    Args:
        material: What it shows.
        metres_per_px: Size of a pixel on the ground.
        contrast: Factor on its amplitude, 1 is natural.
        seed: Of its chance.
    """
    size = 1024 if metres_per_px < 0.09 else 512
    rng = np.random.default_rng([seed, MATERIALS.index(material)])
    per_m = size * metres_per_px  # metres a side
    fine, mid, low = size, round(per_m / 0.15), round(per_m / 0.8)
    if material == "grass":
        noise = _octaves(size, {fine: 9, min(size // 2, mid): 11, low: 8, low // 4: 5}, rng)
    elif material == "asphalt":
        noise = _octaves(size, {fine: 4.5, mid: 2, low: 1.6, low // 4: 2.2}, rng)
    elif material == "concrete":
        noise = _octaves(size, {fine: 2.5, mid: 2, low: 2.5, low // 4: 3}, rng)
    elif material == "cobble":
        noise = _stones(size, 0.2 / metres_per_px, rng)
        noise += _octaves(size, {fine: 4, low: 3}, rng)
    elif material == "gravel":
        noise = _octaves(size, {fine: 14, mid: 8, low: 4, low // 4: 3}, rng)
    elif material == "dirt":
        noise = _octaves(size, {fine: 5, mid: 6, low: 6, low // 4: 4}, rng)
    elif material == "slabs":
        noise = _stones(size, 0.5 / metres_per_px, rng) * 0.45 + _octaves(size, {fine: 3}, rng)
    else:
        noise = np.zeros((size, size), np.float32)
    return np.clip(128 + contrast * noise, 0, 255).astype(np.uint8)


def spread(texture: Bytes, height: int, width: int) -> Bytes:
    """Return the tile repeated over (height, width), uint8."""
    size = len(texture)
    return np.ascontiguousarray(
        np.tile(texture, (-(-height // size), -(-width // size)))[:height, :width]
    )


def detail_tile(metres: float, size: int, seed: int) -> Bytes:
    """Return (size, size) uint8 grain of the ground close to the camera, about 128, continuing.

    `metres` is its side on the ground: grains of millimetres, pebbles and tufts of centimetres.
    """
    rng = np.random.default_rng(seed)
    weights = {size: 9.0, round(metres / 0.02): 7.0, round(metres / 0.05): 5.0}
    noise = _octaves(size, weights, rng)
    return np.clip(128 + noise, 0, 255).astype(np.uint8)
