"""The ground of a world as seen from above, painted once and shared by renderers of any size."""

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.simulation import litter, paint
from juncnet.simulation.canvas import Canvas, offset_line, resample, strip
from juncnet.simulation.materials import MATERIALS, Bytes, spread, tile
from juncnet.simulation.mouths import arms_at
from juncnet.simulation.palettes import LIGHTS, Light, Palette, lit, palette_named, yuv
from juncnet.simulation.world import World

MARGIN_M = 45.0
"""Ground beyond the outermost road that is painted; farther out it is plain."""
MOST_PIXELS = 48_000_000
"""Largest raster; a larger world gets coarser pixels."""
MASK_STEP_M = 0.1
ROAD, JUNCTION = 1, 2
"""Values of `GroundTexture.surface`; 0 is everything else."""


class GroundTexture:
    """The painted ground: luminance and chroma with half-size levels, and which part is road.

    Level k has pixels of `metres_per_px * 2**k`; `luma[k]` is (H_k, W_k) uint8 and `chroma[k]`
    (H_k/2, W_k/2, 2) uint8, U then V. The centre of pixel (row, column) of a plane with step s
    lies at x = x_min + (column + 0.5) * s, y = y_max - (row + 0.5) * s.
    """

    def __init__(
        self,
        world: World,
        metres_per_px: float = 0.05,
        palette: Palette | None = None,
    ) -> None:
        """Paint the ground of `world`.

        Args:
            world: What to paint.
            metres_per_px: Size of a pixel; coarser paints faster. A large world makes it coarser.
            palette: Colours, instead of those that the world's style names (for variation).
        """
        x_min, y_min, x_max, y_max = world.bounds
        bounds = (x_min - MARGIN_M, y_min - MARGIN_M, x_max + MARGIN_M, y_max + MARGIN_M)
        area = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1])
        self.metres_per_px = max(metres_per_px, (area / MOST_PIXELS) ** 0.5)
        self.palette = palette or palette_named(world.style.palette)
        self.light: Light = LIGHTS[world.style.time_of_day]
        self.x_min, self.y_max = bounds[0], bounds[3]
        canvas = _painted(world, self.palette, self.light, bounds, self.metres_per_px)
        self.beyond: tuple[int, int, int] = _mean_colour(self.palette, self.light)
        """Y, U, V of the plain ground outside the raster."""
        _fade(canvas, self.beyond)
        self.luma: list[Bytes] = _levels(canvas.luma)
        self.chroma: list[Bytes] = _levels(
            np.asarray(cv2.merge([canvas.blue, canvas.red]), np.uint8), len(self.luma)
        )
        self.surface: Bytes = _surface(world, bounds)
        """(H, W) uint8 of MASK_STEP_M pixels: 0, ROAD or JUNCTION."""

    def map_to_plane(self, step: float) -> NDArray[np.float64]:
        """Return the 3x3 matrix from (x, y, 1) to (column, row, 1) of a plane of that step."""
        return np.array(
            [
                [1 / step, 0, -self.x_min / step - 0.5],
                [0, -1 / step, self.y_max / step - 0.5],
                [0, 0, 1],
            ]
        )


def _painted(
    world: World,
    palette: Palette,
    light: Light,
    bounds: tuple[float, float, float, float],
    metres_per_px: float,
) -> Canvas:
    rng = np.random.default_rng([world.seed, 1])
    canvas = Canvas(bounds, metres_per_px, light)
    paint.vegetation(canvas, palette, rng)
    paint.roads(canvas, world, palette, rng)
    litter.patches(canvas, world, palette)
    _texture(canvas, palette.contrast, world.seed)
    litter.leaves(canvas, world, palette, rng)
    litter.shadows(canvas, world)
    factor = litter.shadow_factor(canvas, world.style)
    cv2.multiply(canvas.luma, factor, dst=canvas.luma, scale=1 / 255)
    return canvas


def _texture(canvas: Canvas, contrast: float, seed: int) -> None:
    """Add each material's fine texture and the soft shading to the luminance."""
    height, width = canvas.size
    texture = spread(tile("grass", canvas.metres_per_px, contrast, seed), height, width)
    counts = np.bincount(canvas.material[::4, ::4].ravel(), minlength=8)
    present: list[int] = np.flatnonzero(counts).tolist()
    for index in present:
        if index:
            fine = spread(
                tile(MATERIALS[index], canvas.metres_per_px, contrast, seed), height, width
            )
            cv2.copyTo(fine, cv2.inRange(canvas.material, index, index), texture)
    cv2.addWeighted(canvas.luma, 1.0, texture, 1.0, -128.0, dst=canvas.luma)
    soft = cv2.GaussianBlur(canvas.shade, (0, 0), 0.14 / canvas.shade_step)
    grown = cv2.resize(soft, (width, height), interpolation=cv2.INTER_LINEAR)
    cv2.addWeighted(canvas.luma, 1.0, grown, 1.0, -128.0, dst=canvas.luma)


def _mean_colour(palette: Palette, light: Light) -> tuple[int, int, int]:
    a, b, soil = (np.array(c) for c in (palette.grass, palette.grass_other, palette.soil))
    mean = (a + b) / 2 * (1 - 0.6 * palette.bareness) + soil * 0.6 * palette.bareness
    return yuv(lit((mean[0], mean[1], mean[2]), light))


def _fade(canvas: Canvas, colour: tuple[int, int, int]) -> None:
    """Fade the outermost metres into the plain ground, so that the raster's end is not seen."""
    planes = (canvas.luma, canvas.blue, canvas.red)
    for plane, level in zip(planes, colour, strict=True):
        step = canvas.metres_per_px * canvas.size[0] / plane.shape[0]
        depth = int(20.0 / step)
        ramp = np.linspace(0, 1, depth, dtype=np.float32)
        for view in (plane, plane[::-1], plane.T, plane.T[::-1]):
            edge = view[:depth]
            edge[:] = (level + (edge - np.float32(level)) * ramp[:, None]).astype(np.uint8)


def _levels(plane: Bytes, count: int | None = None) -> list[Bytes]:
    levels = [np.ascontiguousarray(plane)]
    while len(levels) < (count or 7) and min(levels[-1].shape[:2]) >= 32:
        last = levels[-1]
        size = (last.shape[1] // 2, last.shape[0] // 2)
        # Cut to even sizes: the half must cover exactly two pixels each way.
        even = last[: 2 * size[1], : 2 * size[0]]
        levels.append(np.asarray(cv2.resize(even, size, interpolation=cv2.INTER_AREA), np.uint8))
    return levels


def _surface(world: World, bounds: tuple[float, float, float, float]) -> Bytes:
    plain = Canvas(bounds, MASK_STEP_M, Light((1, 1, 1), (0, 0, 0), (0, 0, 0), 0, (0, 0, 0), 0))
    mask = np.zeros(plain.size, np.uint8)

    def fill(points: NDArray[np.float64], value: int) -> None:
        cv2.fillPoly(mask, [plain.pixels(points, MASK_STEP_M)], value, 8, 4)

    for _, road in sorted(world.roads.items()):
        centre, half = resample(road.centre, 0.5), road.width_m / 2
        for polygon in strip(offset_line(centre, half), offset_line(centre, -half)):
            fill(polygon, ROAD)
    for node in world.nodes:
        arms = arms_at(world, node)
        if len(arms) < 2:
            continue
        value = JUNCTION if len(arms) > 2 else ROAD
        for area in paint.junction_areas(arms):
            fill(area, value)
    return mask
