"""A map of flat colours that a world's ground is painted on, in metres."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.simulation.materials import MATERIALS, Bytes, Material
from juncnet.simulation.palettes import Colour, Light, lit, yuv

Points = NDArray[np.float64]
_SHIFT = 4
_SHADE_M = 0.12


class Canvas:
    """Planes of the ground seen from above, north up.

    `luma` (H, W), `blue` and `red` (H/2, W/2) chroma, `material` (H, W) index of MATERIALS, and
    `shade`, a coarser plane with 128 for no change, blurred and added to the luminance at the end.
    H and W are even. The centre of pixel (row r, column c) lies at
    x = x_min + (c + 0.5) * metres_per_px, y = y_max - (r + 0.5) * metres_per_px.
    """

    def __init__(
        self, bounds: tuple[float, float, float, float], metres_per_px: float, light: Light
    ) -> None:
        x_min, y_min, x_max, y_max = bounds
        self.metres_per_px = metres_per_px
        self.x_min, self.y_max = x_min, y_max
        width = 2 * math.ceil((x_max - x_min) / metres_per_px / 2)
        height = 2 * math.ceil((y_max - y_min) / metres_per_px / 2)
        self.size = (height, width)
        self.light = light
        self.luma: Bytes = np.full((height, width), 100, np.uint8)
        self.blue: Bytes = np.full((height // 2, width // 2), 128, np.uint8)
        self.red: Bytes = np.full((height // 2, width // 2), 128, np.uint8)
        self.material: Bytes = np.zeros((height, width), np.uint8)
        self.shade_step = max(_SHADE_M, metres_per_px)
        coarse = (
            math.ceil(height * metres_per_px / self.shade_step),
            math.ceil(width * metres_per_px / self.shade_step),
        )
        self.shade: Bytes = np.full(coarse, 128, np.uint8)
        self.shadow: Bytes = np.zeros(coarse, np.uint8)

    def pixels(self, points: Points, step: float) -> NDArray[np.int32]:
        """Return (N, 2) fixed-point columns and rows of ground points on a plane of that step."""
        column = (points[:, 0] - self.x_min) / step - 0.5
        row = (self.y_max - points[:, 1]) / step - 0.5
        return np.round(np.stack([column, row], 1) * (1 << _SHIFT)).astype(np.int32)

    def fill(
        self, points: Points, colour: Colour, material: Material | None, factor: float = 1.0
    ) -> None:
        """Fill the polygon (N, 2) with a colour under the light, and its material unless None."""
        y, u, v = yuv(lit(colour, self.light, factor))
        fine = self.pixels(points, self.metres_per_px)
        coarse = self.pixels(points, 2 * self.metres_per_px)
        cv2.fillPoly(self.luma, [fine], y, cv2.LINE_AA, _SHIFT)
        cv2.fillPoly(self.blue, [coarse], u, cv2.LINE_AA, _SHIFT)
        cv2.fillPoly(self.red, [coarse], v, cv2.LINE_AA, _SHIFT)
        if material is not None:
            cv2.fillPoly(self.material, [fine], MATERIALS.index(material), cv2.LINE_8, _SHIFT)

    def line(self, points: Points, level: int) -> None:
        """Draw a line one pixel wide into the luminance only: a crack, a joint."""
        fine = self.pixels(points, self.metres_per_px)
        cv2.polylines(self.luma, [fine], False, level, 1, cv2.LINE_AA, _SHIFT)

    def shade_fill(self, points: Points, change: float) -> None:
        """Brighten (positive) or darken a polygon softly by `change` grey levels."""
        level = int(min(max(128 + change, 0), 255))
        cv2.fillPoly(self.shade, [self.pixels(points, self.shade_step)], level, 8, _SHIFT)

    def shadow_fill(self, points: Points, depth: float) -> None:
        """Mark a polygon as in shadow, 0..1 deep."""
        pixels = self.pixels(points, self.shade_step)
        cv2.fillPoly(self.shadow, [pixels], int(255 * depth), cv2.LINE_AA, _SHIFT)


def offset_line(centre: Points, offset: float | NDArray[np.float64]) -> Points:
    """Return the line (N, 2) moved to its left by `offset` metres, one value or one a point."""
    normal = normals(centre)
    return centre + normal * np.broadcast_to(np.asarray(offset, float), (len(centre),))[:, None]


def normals(centre: Points) -> Points:
    """Return (N, 2) unit vectors to the left of a line of at least two points."""
    along = np.gradient(centre, axis=0)
    along /= np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
    return np.stack([-along[:, 1], along[:, 0]], 1)


def resample(centre: Points, step: float) -> Points:
    """Return points of a line, `step` metres apart or a little less, both ends kept."""
    length = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(centre, axis=0).T))])
    count = max(2, math.ceil(length[-1] / step) + 1)
    at: NDArray[np.float64] = np.linspace(0, float(length[-1]), count)
    return np.stack([np.interp(at, length, centre[:, i]) for i in (0, 1)], 1)


def strip(left: Points, right: Points, piece: int = 8) -> list[Points]:
    """Return polygons that cover the area between two lines of equal length, `piece` points each.

    Short pieces, so that a bend never makes a polygon that crosses itself.
    """
    return [
        np.concatenate([left[i : i + piece + 1], right[i : i + piece + 1][::-1]])
        for i in range(0, len(left) - 1, piece)
    ]


def blob(
    x: float, y: float, radius: float, rng: np.random.Generator, rough: float = 0.25
) -> Points:
    """Return an irregular closed outline about a point, (N, 2)."""
    angle = np.linspace(0, 2 * math.pi, 20, endpoint=False)
    waves = sum(
        rng.uniform(-1, 1) / k * np.sin(k * angle + rng.uniform(0, 6.28)) for k in (1, 2, 3, 5)
    )
    r = radius * (1 + rough * waves)
    return np.stack([x + r * np.cos(angle), y + r * np.sin(angle)], 1)


def disc(x: float, y: float, radius: float) -> Points:
    """Return a circle's outline, (24, 2)."""
    angle = np.linspace(0, 2 * math.pi, 24, endpoint=False)
    return np.stack([x + radius * np.cos(angle), y + radius * np.sin(angle)], 1)
