"""Paints what lies on the ground: mud, puddles, repairs, fallen leaves, and shadows."""

import math

import cv2
import numpy as np

from juncnet.simulation.canvas import Canvas, Points, blob, resample
from juncnet.simulation.palettes import Palette, lit, yuv
from juncnet.simulation.world import Style, World


def patches(canvas: Canvas, world: World, palette: Palette) -> None:
    """Paint mud, puddles that show the sky, and repaired surface."""
    gain = canvas.light.gain
    sky = tuple(
        0.3 * (z + h) / 2 / g + 0.35 * s
        for z, h, g, s in zip(
            canvas.light.zenith, canvas.light.horizon, gain, palette.soil, strict=True
        )
    )
    for patch in world.patches:
        rng = np.random.default_rng([world.seed, patch.seed, 5])
        outline = blob(patch.x_m, patch.y_m, patch.radius_m, rng)
        if patch.kind == "mud":
            canvas.fill(outline, palette.soil, "dirt", 0.72)
            inner = blob(patch.x_m, patch.y_m, 0.6 * patch.radius_m, rng, 0.4)
            canvas.shade_fill(inner, -14)
        elif patch.kind == "puddle":
            rim = outline + 0.16 * (outline - outline.mean(axis=0))
            canvas.fill(rim, palette.soil, "dirt", 0.7)
            canvas.fill(outline, (sky[0], sky[1], sky[2]), "plain", 0.9)
        else:
            canvas.fill(outline, palette.asphalt, "asphalt", 0.75)


def leaves(canvas: Canvas, world: World, palette: Palette, rng: np.random.Generator) -> None:
    """Scatter single leaves near roads, more at their edges; one pixel or two each."""
    if canvas.metres_per_px > 0.08 or palette.litter_density <= 0.02:
        return
    y, u, v = yuv(lit(palette.litter, canvas.light, 1.1))
    for _, road in sorted(world.roads.items()):
        centre = resample(road.centre, 0.5)
        count = int(palette.litter_density * len(centre) * 0.5 * (road.width_m + 6))
        at = centre[rng.integers(0, len(centre), count)]
        # Leaves gather at the sides: two humps about the edges.
        side = rng.choice([-1.0, 1.0], count) * (road.width_m / 2 + rng.normal(0, 1.1, count))
        angle = rng.uniform(0, 2 * math.pi, count)
        points = at + np.abs(side)[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)
        _dots(canvas, points, rng, (y, u, v))


def _dots(
    canvas: Canvas, points: Points, rng: np.random.Generator, colour: tuple[int, int, int]
) -> None:
    height, width = canvas.size
    column = ((points[:, 0] - canvas.x_min) / canvas.metres_per_px).astype(int)
    row = ((canvas.y_max - points[:, 1]) / canvas.metres_per_px).astype(int)
    kept = (column > 0) & (column < width - 2) & (row > 0) & (row < height - 2)
    column, row = column[kept], row[kept]
    shade = rng.integers(-16, 24, len(row))
    level = np.clip(colour[0] + shade, 16, 235).astype(np.uint8)
    canvas.luma[row, column] = level
    canvas.luma[row, column + 1] = level
    canvas.blue[row // 2, column // 2] = colour[1]
    canvas.red[row // 2, column // 2] = colour[2]


def shadows(canvas: Canvas, world: World) -> None:
    """Mark the shadows of trees, buildings and cars, away from the sun."""
    style = world.style
    length = min(1 / math.tan(max(style.sun_elevation_rad, 0.12)), 5.0)
    away = -np.array([math.cos(style.sun_azimuth_rad), math.sin(style.sun_azimuth_rad)])
    for tree in world.trees:
        rng = np.random.default_rng([world.seed, tree.seed, 6])
        foot = np.array([tree.x_m, tree.y_m])
        _tree_shadow(canvas, foot, tree.radius_m, tree.height_m, away * length, rng)
    for box in world.boxes:
        s, c = math.sin(box.yaw_rad), math.cos(box.yaw_rad)
        half = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * [box.length_m / 2, box.width_m / 2]
        base = half @ np.array([[c, s], [-s, c]]) + [box.x_m, box.y_m]
        both = np.concatenate([base, base + away * length * box.height_m]).astype(np.float32)
        hull = np.asarray(cv2.convexHull(both), np.float64)[:, 0]
        canvas.shadow_fill(hull, 1.0)


def _tree_shadow(
    canvas: Canvas,
    foot: Points,
    radius: float,
    height: float,
    reach: Points,
    rng: np.random.Generator,
) -> None:
    """Mark a crown as blobs along the sun's direction, and the trunk as a line."""
    crown = max(height - radius, 0.5 * height)
    side = np.array([-reach[1], reach[0]]) / max(float(np.hypot(*reach)), 1e-6)
    trunk = np.stack([foot + side * 0.12, foot - side * 0.12])
    canvas.shadow_fill(np.concatenate([trunk, trunk[::-1] + reach * crown]), 0.8)
    low, high = max(0.35 * height, height - 2 * radius), height
    for level in np.linspace(low, high, 4):
        scale = math.sin(math.pi * (0.2 + 0.65 * (level - low) / max(high - low, 0.1)))
        x, y = foot + reach * level
        canvas.shadow_fill(blob(float(x), float(y), radius * scale, rng, 0.3), 0.9)


def shadow_factor(canvas: Canvas, style: Style) -> np.ndarray:
    """Return (H, W) uint8 light left in the shadows, 255 for full, edges soft."""
    strength = style.shadow * (0.3 if style.time_of_day == "overcast" else 1.0)
    soft = 0.9 if style.time_of_day == "overcast" else 0.18
    blurred = cv2.GaussianBlur(canvas.shadow, (0, 0), max(0.6, soft / canvas.shade_step))
    left = 255 - blurred.astype(np.float32) * strength * 0.85
    height, width = canvas.size
    return np.asarray(
        cv2.resize(left.astype(np.uint8), (width, height), interpolation=cv2.INTER_LINEAR), np.uint8
    )
