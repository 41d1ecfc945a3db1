"""Pictures of a simulated world from a camera above its ground, straight into I420.

The ground is a raster in YUV that is warped in bands of rows, each from the level of detail that
fits; objects stand on it as sprites and shaded boxes, drawn from back to front.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.camera import CameraGeometry
from juncnet.simulation.ground import MASK_STEP_M, GroundTexture
from juncnet.simulation.materials import Bytes, detail_tile
from juncnet.simulation.scenery import Scenery
from juncnet.simulation.sky import rotated, sky_over
from juncnet.simulation.view import View, view_from
from juncnet.simulation.world import World

_WARP = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
_DETAIL_STEP_M = 0.01
_DETAIL_PX = 1024
_DETAIL_STEPS = 14
_HAZE_SCALE_M = 200.0
_HAZE_END_M = 500.0
_NOISE_SPARE = 1 << 16


class Renderer:
    """Renders pictures of one size and camera of one world. Not to be shared between threads."""

    def __init__(
        self,
        world: World,
        width: int,
        height: int,
        camera: CameraGeometry,
        noise: float = 2.0,
        seed: int = 0,
        ground: GroundTexture | None = None,
    ) -> None:
        """Prepare everything that does not depend on the pose.

        Args:
            world: What to show.
            width: Even number of pixels.
            height: Even number of pixels.
            camera: Its height, pitch and field of view; pixels are square, whatever its aspect.
            noise: Standard deviation of the sensor's noise, grey levels.
            seed: Of the noise.
            ground: The world's ground, when it was painted before; else it is painted now.

        Raises:
            ValueError: an odd size, or the style names no palette.
        """
        if width % 2 or height % 2 or min(width, height) < 16:
            raise ValueError(f"Renderer: {width}x{height} must be even and at least 16")
        self.world, self.camera, self.width, self.height = world, camera, width, height
        self.ground = ground or GroundTexture(world)
        light, palette = self.ground.light, self.ground.palette
        self._sky = sky_over(light, palette, world.style.haze, world.seed)
        self._scenery = Scenery(world, palette, light, self._sky.horizon)
        self._detail = _detail()
        self._noise = _NoiseTable(width * height, noise, seed)
        self._luma: Bytes = np.empty((height, width), np.uint8)
        self._chroma: Bytes = np.empty((height // 2, width // 2, 2), np.uint8)

    def render_i420(
        self,
        x_m: float,
        y_m: float,
        yaw_rad: float,
        z_offset_m: float = 0.0,
        roll_rad: float = 0.0,
        pitch_rad: float = 0.0,
        out: NDArray[np.uint8] | None = None,
    ) -> NDArray[np.uint8]:
        """Return the picture from a pose, flat uint8 I420 of width * height * 3 / 2 bytes.

        Args:
            x_m: Position of the camera in the world.
            y_m: Position of the camera in the world.
            yaw_rad: Heading, counter-clockwise from x.
            z_offset_m: Added to the camera's height.
            roll_rad: Roll of the body, positive with its right side down.
            pitch_rad: Pitch of the body, positive with its nose down.
            out: Where to write, flat uint8 of that size; a new array when None.

        Raises:
            ValueError: `out` is of another size, shape or type.
        """
        pixels = self.width * self.height
        if out is None:
            out = np.empty(pixels * 3 // 2, np.uint8)
        if out.shape != (pixels * 3 // 2,) or out.dtype != np.uint8:
            raise ValueError(f"render_i420: out must be flat uint8 of {pixels * 3 // 2} bytes")
        pose, size = (x_m, y_m, yaw_rad), (self.width, self.height)
        view = view_from(self.camera, size, pose, z_offset_m, roll_rad, pitch_rad)
        luma = out[:pixels].reshape(self.height, self.width)
        self._draw_ground(view, luma)
        self._draw_sky(view, luma)
        self._scenery.draw(view, luma, self._chroma)
        self._noise.add(luma, pose)
        quarter = pixels // 4
        shape = (self.height // 2, self.width // 2)
        u = out[pixels : pixels + quarter].reshape(shape)
        v = out[pixels + quarter :].reshape(shape)
        cv2.mixChannels([self._chroma], [u, v], [0, 0, 1, 1])
        return out

    def road_mask(
        self,
        x_m: float,
        y_m: float,
        yaw_rad: float,
        width: int,
        height: int,
        z_offset_m: float = 0.0,
        roll_rad: float = 0.0,
        pitch_rad: float = 0.0,
        classes: bool = False,
    ) -> NDArray[np.uint8]:
        """Return which pixels of a picture of that size show a road's surface, (height, width).

        Values are 0 and 255, or with `classes` 0, 1 (road) and 2 (junction). What stands in the
        way does not hide the road; side paths are not roads.
        """
        pose = (x_m, y_m, yaw_rad)
        view = view_from(self.camera, (width, height), pose, z_offset_m, roll_rad, pitch_rad)
        to_plane = self.ground.map_to_plane(MASK_STEP_M) @ np.linalg.inv(view.ground)
        flags = cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP
        mask = cv2.warpPerspective(self.ground.surface, to_plane, (width, height), flags=flags)
        left, right = view.horizon_rows()
        sky = np.array([[-1, -2], [width, -2], [width, round(right)], [-1, round(left)]], np.int32)
        cv2.fillConvexPoly(mask, sky, 0)
        if not classes:
            mask = cv2.inRange(mask, 1, 255)
        return np.asarray(mask, np.uint8)

    def _draw_ground(self, view: View, luma: Bytes) -> None:
        self._warp_bands(view, luma, self.ground.luma, self.ground.metres_per_px, True)
        self._warp_bands(
            view.half(), self._chroma, self.ground.chroma, 2 * self.ground.metres_per_px, False
        )

    def _warp_bands(
        self, view: View, target: Bytes, levels: list[Bytes], step: float, detailed: bool
    ) -> None:
        """Warp the ground into the rows of `target` below the horizon, band by band."""
        to_ground = np.asarray(np.linalg.inv(view.ground), np.float64)
        beyond = self.ground.beyond[:1] if target.ndim == 2 else self.ground.beyond[1:]
        height_m = float(view.position[2])
        for band in bands(view, height_m, step, len(levels)):
            scale = step * 2**band.level
            matrix = self.ground.map_to_plane(scale) @ to_ground
            _warp(levels[band.level], matrix, band, target, beyond)
        if detailed:
            self._detail.add(view, to_ground, target)

    def _draw_sky(self, view: View, luma: Bytes) -> None:
        light = self._sky.horizon
        for plane, seen, panorama, level in (
            (luma, view, self._sky.luma, light[:1]),
            (self._chroma, view.half(), self._sky.chroma, light[1:]),
        ):
            _haze(plane, seen, float(view.position[2]), self.world.style.haze, level)
            left, right = seen.horizon_rows()
            rows = min(seen.height, math.ceil(max(left, right)) + 1)
            if rows <= 0:
                continue
            affine = self._sky.affine(seen.yaw_rad, seen.roll_px_rad, seen.focal_px, seen.horizon)
            sky = rotated(panorama, affine, (rows, seen.width))
            whole = math.floor(min(left, right))
            if whole > 0:
                plane[:whole] = sky[:whole]
            whole = max(whole, 0)
            if rows > whole:
                mask = np.zeros((rows - whole, seen.width), np.uint8)
                corners = [[-1, -9 * seen.height], [seen.width, -9 * seen.height]]
                corners += [[seen.width, right - whole], [-1, left - whole]]
                fixed = np.round(np.array(corners) * 16).astype(np.int32)
                cv2.fillPoly(mask, [fixed], 255, 8, 4)
                cv2.copyTo(sky[whole:], mask, plane[whole:rows])


@dataclass(frozen=True)
class Band:
    """Rows `top` to `bottom` (excluded) of a picture, and the level of detail that they need.

    `coarse` is 2 or 4 where the raster's pixels are so much larger than the picture's that nothing
    is lost by drawing the band that much smaller and enlarging it.
    """

    top: int
    bottom: int
    level: int
    coarse: int


def bands(view: View, height_m: float, step: float, levels: int) -> list[Band]:
    """Return the bands that cover the ground in a picture.

    The level's pixels are about as large on the ground as those of the picture: the geometric mean
    of their width and depth.
    """
    left, right = view.horizon_rows()
    first = max(0, math.floor(min(left, right)))
    rows = np.arange(first, view.height)
    if not len(rows):
        return []
    below = np.maximum((rows - view.horizon[1]) / view.focal_px, 0.5 / view.focal_px)
    distance = height_m / below
    across = distance / view.focal_px
    along = distance * distance / (height_m * view.focal_px)
    size = np.log2(np.sqrt(across * np.minimum(along, 6 * across)) / step)
    level = np.clip(np.round(size + 0.1), -2, levels - 1).astype(int)
    cuts = [0, *(np.flatnonzero(np.diff(level)) + 1).tolist(), len(rows)]
    found: list[Band] = []
    for start, stop in pairwise(cuts):
        fine = int(level[start])
        found.append(Band(first + start, first + stop, max(fine, 0), 1 << max(-fine, 0)))
    return found


def _warp(
    plane: Bytes,
    matrix: NDArray[np.float64],
    band: Band,
    target: Bytes,
    beyond: tuple[int, ...],
) -> None:
    """Warp a plane into the rows of a band; `matrix` maps the target's pixels to the plane's."""
    part, k = target[band.top : band.bottom], band.coarse
    shift = np.array([[k, 0, k / 2 - 0.5], [0, k, band.top + k / 2 - 0.5], [0, 0, 1.0]])
    size = (-(-part.shape[1] // k), -(-part.shape[0] // k))
    warped = cv2.warpPerspective(
        plane,
        matrix @ shift,
        size,
        dst=part if k == 1 else None,
        flags=_WARP,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=beyond,
    )
    if k > 1:
        whole = (size[0] * k, size[1] * k)
        fits = whole == (part.shape[1], part.shape[0])
        grown = cv2.resize(warped, whole, dst=part if fits else None)
        if not fits:
            part[:] = grown[: part.shape[0], : part.shape[1]]


def _haze(plane: Bytes, view: View, height_m: float, haze: float, level: tuple[int, ...]) -> None:
    """Fade the far ground into the horizon's colour."""
    if haze <= 0:
        return
    left, right = view.horizon_rows()
    rate = -math.log(max(1 - haze, 1e-3)) / _HAZE_SCALE_M
    first = max(0, math.floor(min(left, right)))
    # Nearer than where two per cent are lost nothing is seen of it.
    last = view.horizon[1] + height_m * view.focal_px * rate / 0.02 + abs(left - right) / 2
    last = min(view.height, math.ceil(last))
    if last <= first:
        return
    rows = np.arange(first, last)[:, None]
    columns = np.linspace(0, view.width - 1, 65 if left != right else 2)[None]
    tilt = math.tan(view.roll_px_rad) * (columns - view.horizon[0])
    below = np.maximum((rows - view.horizon[1] + tilt) / view.focal_px, height_m / _HAZE_END_M)
    kept = np.exp(-rate * height_m / below).astype(np.float32)
    wide = cv2.resize((kept * 255).astype(np.uint8), (view.width, last - first))
    part = plane[first:last]
    if part.ndim == 3:
        wide = cv2.merge([wide, wide])
    far = cv2.bitwise_not(wide)
    colour = np.empty_like(part)
    colour[...] = level if part.ndim == 3 else level[0]
    faded = cv2.multiply(part, wide, scale=1 / 255)
    cv2.add(faded, cv2.multiply(colour, far, scale=1 / 255), dst=part)


class _Detail:
    """Grain of the ground close to the camera, finer than the ground's raster."""

    def __init__(self) -> None:
        tile = detail_tile(_DETAIL_STEP_M * _DETAIL_PX, _DETAIL_PX, 3)
        self._tile: Bytes = np.ascontiguousarray(np.tile(tile, (4, 4)))
        self._period_m = _DETAIL_STEP_M * _DETAIL_PX

    def add(self, view: View, to_ground: NDArray[np.float64], target: Bytes) -> None:
        """Add the grain to the rows that show ground near enough for it."""
        x, y = float(view.position[0]), float(view.position[1])
        # Whole periods are taken off, so that the tile's repetitions cover what is near.
        x0 = self._period_m * (math.floor(x / self._period_m) - 1.5)
        y1 = self._period_m * (math.floor(y / self._period_m) + 2.5)
        first, full = self._rows(view)
        if first >= view.height:
            return
        step = _DETAIL_STEP_M
        to_plane = np.array([[1 / step, 0, -x0 / step], [0, -1 / step, y1 / step], [0, 0, 1]])
        part = target[first:]
        grain = np.empty_like(part)
        down = np.array([[1.0, 0, 0], [0, 1, first], [0, 0, 1]])
        _warp(self._tile, to_plane @ to_ground @ down, Band(0, len(part), 0, 2), grain, (128,))
        # It appears little by little: a sudden edge would be seen.
        cuts = np.linspace(0, max(full - first, 0), _DETAIL_STEPS + 1).round().astype(int).tolist()
        for index, (top, bottom) in enumerate(pairwise([*cuts, len(part)])):
            rows, weight = part[top:bottom], (index + 1) / (_DETAIL_STEPS + 1)
            if len(rows):
                offset = -128.0 * weight
                cv2.addWeighted(rows, 1.0, grain[top:bottom], weight, offset, dst=rows)

    def _rows(self, view: View) -> tuple[int, int]:
        """Return the rows from which the grain is seen at all, and in full."""
        lowest = max(view.horizon_rows())
        # From h / f / below**1.5, the size of a pixel on the ground.
        rows = [
            lowest + view.focal_px * (float(view.position[2]) / view.focal_px / size) ** (2 / 3)
            for size in (1.6 * _DETAIL_STEP_M, 0.6 * _DETAIL_STEP_M)
        ]
        first, full = (min(view.height, max(0, math.ceil(row))) for row in rows)
        return first, full


@lru_cache(maxsize=1)
def _detail() -> _Detail:
    return _Detail()


class _NoiseTable:
    """Noise of the sensor from a fixed table, shifted by the pose: same pose, same noise."""

    def __init__(self, pixels: int, deviation: float, seed: int) -> None:
        self._deviation = deviation
        if deviation > 0:
            rng = np.random.default_rng([seed, 9])
            draws = rng.standard_normal(pixels + _NOISE_SPARE, dtype=np.float32)
            self._table: Bytes = np.clip(128 + deviation * draws, 0, 255).astype(np.uint8)

    def add(self, luma: Bytes, pose: tuple[float, float, float]) -> None:
        """Add noise to the luminance in place."""
        if self._deviation <= 0:
            return
        offset = hash(tuple(round(p * 1e6) for p in pose)) % _NOISE_SPARE
        table = self._table[offset : offset + luma.size].reshape(luma.shape)
        cv2.addWeighted(luma, 1.0, table, 1.0, -128.0, dst=luma)
