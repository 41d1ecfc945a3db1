"""Trees and bushes as pictures that always face the camera."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.simulation.materials import Bytes, periodic_noise
from juncnet.simulation.palettes import Colour, Light, Palette, lit, yuv_planes

Shape = Literal["broad", "conifer", "bush"]
_SIZE = 512
_LEVELS = 6


@dataclass(frozen=True)
class Sprite:
    """A picture of a plant that fills a square: its foot bottom centre, its crown as wide as it.

    Level k is (512 >> k) pixels a side: `luma` and `mask` (S, S), `chroma` (S, S, 2), all uint8.
    """

    luma: tuple[Bytes, ...]
    chroma: tuple[Bytes, ...]
    mask: tuple[Bytes, ...]


@lru_cache(maxsize=4)
def draw_sprites(palette: Palette, light: Light, seed: int) -> dict[Shape, list[Sprite]]:
    """Return some sprites of every shape in the palette's colours, shared by all who ask."""
    rng = np.random.default_rng([seed, 11])
    counts: dict[Shape, int] = {"broad": 5, "conifer": 3, "bush": 3}
    return {
        shape: [_sprite(shape, palette, light, rng) for _ in range(count)]
        for shape, count in counts.items()
    }


def _sprite(shape: Shape, palette: Palette, light: Light, rng: np.random.Generator) -> Sprite:
    mix = rng.uniform(0, 1)
    leaf = _between(palette.leaf, palette.leaf_other, mix)
    picture = np.zeros((_SIZE, _SIZE, 3), np.float32)
    mask = np.zeros((_SIZE, _SIZE), np.uint8)
    if shape != "bush":
        _trunk(picture, mask, lit(palette.trunk, light), rng, 0.5 if shape == "broad" else 0.2)
    if shape == "conifer":
        leaf = _between(leaf, (0.7 * leaf[0], 0.75 * leaf[1], 0.6 * leaf[2]), 0.8)
        _branches(picture, mask, lit(leaf, light), light.shading, rng)
    else:
        _crown(picture, mask, lit(leaf, light), light.shading, shape == "bush", rng)
    y, u, v = yuv_planes(picture)
    luma = np.clip(y + 3 * periodic_noise(_SIZE, _SIZE, rng), 16, 235).astype(np.uint8)
    chroma = np.clip(np.stack([u, v], -1), 0, 255).astype(np.uint8)
    return Sprite(_spread(luma, mask), _spread(chroma, mask), _halves(mask))


def _between(a: Colour, b: Colour, mix: float) -> Colour:
    return (a[0] + (b[0] - a[0]) * mix, a[1] + (b[1] - a[1]) * mix, a[2] + (b[2] - a[2]) * mix)


def _trunk(
    picture: NDArray[np.float32],
    mask: Bytes,
    colour: Colour,
    rng: np.random.Generator,
    top: float,
) -> None:
    half, lean = rng.uniform(0.016, 0.028) * _SIZE, rng.uniform(-0.03, 0.03) * _SIZE
    middle, high = _SIZE / 2, _SIZE * (1 - top)
    shape = np.array(
        [
            [middle - 1.5 * half, _SIZE],
            [middle - half + lean, high],
            [middle + half + lean, high],
            [middle + 1.5 * half, _SIZE],
        ]
    )
    cv2.fillPoly(picture, [shape.astype(np.int32)], colour)
    dark = (0.6 * colour[0], 0.6 * colour[1], 0.6 * colour[2])
    shape[:2, 0] += half
    cv2.fillPoly(picture, [shape.astype(np.int32)], dark)
    shape[:2, 0] -= half
    cv2.fillPoly(mask, [shape.astype(np.int32)], 255)


def _crown(
    picture: NDArray[np.float32],
    mask: Bytes,
    colour: Colour,
    shading: float,
    bush: bool,
    rng: np.random.Generator,
) -> None:
    """Draw a crown of clumps of leaves, dark below and inside, light above and to the left."""
    low, high = (0.98, 0.06) if bush else (0.72, 0.04)
    centre, half = (low + high) / 2 * _SIZE, (low - high) / 2 * _SIZE
    lobes = [(rng.uniform(0, 6.28), rng.uniform(0.25, 0.62)) for _ in range(9)]
    spots: list[tuple[float, float, float]] = []
    for angle, out in lobes:
        cx, cy, size = math.cos(angle) * out, math.sin(angle) * out, rng.uniform(0.3, 0.42)
        for _ in range(90):
            a, r = rng.uniform(0, 6.28), size * math.sqrt(rng.random())
            spots.append((cx + r * math.cos(a), cy + r * math.sin(a), r / size))
    spots.sort(key=lambda s: -s[1] + 0.5 * s[2] + rng.normal(0, 0.25))
    for px, py, rim in spots:
        bright = 0.95 - 0.75 * shading * (0.85 * py + 0.3 * px) + rng.normal(0, 0.1)
        bright *= 1.1 - 0.25 * rim
        x, y = _SIZE / 2 + 0.95 * px * _SIZE / 2, centre + 0.95 * py * half
        radius = rng.uniform(3, 13)
        tone = tuple(float(np.clip(c * bright, 3, 250)) for c in colour)
        axes = (int(radius), int(radius * rng.uniform(0.5, 0.9)))
        place, turn = (int(x), int(y)), float(rng.uniform(0, 180))
        cv2.ellipse(picture, place, axes, turn, 0, 360, tone, -1)
        cv2.ellipse(mask, place, axes, turn, 0, 360, 255, -1)


def _branches(
    picture: NDArray[np.float32],
    mask: Bytes,
    colour: Colour,
    shading: float,
    rng: np.random.Generator,
) -> None:
    """Draw a conifer: tiers of hanging branches from the bottom up."""
    for level in np.linspace(0.9, 0.02, 34):
        reach = (0.06 + 0.94 * level) * 0.46 * _SIZE * rng.uniform(0.8, 1.05)
        for _ in range(26):
            side = rng.uniform(-1, 1)
            x0, y0 = _SIZE / 2, level * _SIZE - 0.05 * _SIZE
            x1 = x0 + side * reach
            y1 = y0 + (0.03 + 0.06 * abs(side)) * _SIZE * (0.4 + level) + rng.normal(0, 5)
            bright = 1.0 - shading * (0.5 * side + 0.35) + rng.normal(0, 0.16)
            bright *= 0.6 + 0.5 * abs(side)
            tone = tuple(float(np.clip(c * bright, 3, 250)) for c in colour)
            a, b = (int(x0 + 0.3 * (x1 - x0)), int(y0)), (int(x1), int(y1))
            cv2.line(picture, a, b, tone, int(rng.integers(3, 9)))
            cv2.line(mask, a, b, 255, 4)
    picture[mask == 0] = 0


def _halves(plane: Bytes) -> tuple[Bytes, ...]:
    levels = [plane]
    for _ in range(_LEVELS - 1):
        side = levels[-1].shape[0] // 2
        levels.append(
            np.asarray(cv2.resize(levels[-1], (side, side), interpolation=cv2.INTER_AREA), np.uint8)
        )
    return tuple(levels)


def _spread(plane: Bytes, mask: Bytes) -> tuple[Bytes, ...]:
    """Return half-size levels, colours outside the mask grown from those inside it."""
    weight = (mask > 0).astype(np.float32)
    sharp = plane.astype(np.float32) * (weight[..., None] if plane.ndim == 3 else weight)
    soft, share = cv2.GaussianBlur(sharp, (0, 0), 9), cv2.GaussianBlur(weight, (0, 0), 9)
    mean = sharp.reshape(-1, *plane.shape[2:]).sum(axis=0) / weight.sum()
    share3 = share[..., None] if plane.ndim == 3 else share
    grown = np.where(share3 > 0.02, soft / np.maximum(share3, 0.02), mean)
    inside = mask > 0
    filled = np.where(inside[..., None] if plane.ndim == 3 else inside, plane, grown)
    return _halves(filled.astype(np.uint8))
