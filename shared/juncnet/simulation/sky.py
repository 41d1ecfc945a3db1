"""The sky as a panorama: a gradient with clouds, hills at its foot, turned by yaw."""

import math
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.simulation.materials import Bytes, periodic_noise
from juncnet.simulation.palettes import Light, Palette, lit, yuv_planes

_TOP_RAD = math.radians(50.0)
_BOTTOM_RAD = math.radians(-4.0)
_WIDTH = 2048


class Sky:
    """A panorama of the whole turn in Y and UV, sampled for a camera's rows above the horizon."""

    def __init__(self, light: Light, palette: Palette, haze: float, seed: int) -> None:
        rng = np.random.default_rng([seed, 7])
        self.step_rad = 2 * math.pi / _WIDTH
        rows = math.ceil((_TOP_RAD - _BOTTOM_RAD) / self.step_rad)
        places = np.arange(rows, dtype=np.float64) + 0.5
        elevation = np.asarray(_TOP_RAD - places * self.step_rad, np.float64)
        up = np.clip(elevation / math.radians(40), 0, 1)[:, None, None] ** 0.6
        horizon, zenith, cloud = (
            np.array(c, np.float32) for c in (light.horizon, light.zenith, light.cloud)
        )
        turn = np.ones((1, _WIDTH, 1), np.float32)
        picture = np.asarray((horizon + (zenith - horizon) * up) * turn, np.float32)
        cover = _clouds(rows, elevation, light.clouds, rng)[..., None]
        picture += (cloud - picture) * cover
        _hills(picture, elevation, np.array(lit(palette.leaf, light)), horizon, haze, rng)
        # A second turn's beginning, so that any heading is one straight piece.
        y, u, v = yuv_planes(np.concatenate([picture, picture[:, : _WIDTH // 2]], axis=1))
        self.luma: Bytes = np.clip(y, 16, 240).astype(np.uint8)
        self.chroma: Bytes = np.clip(np.stack([u, v], -1), 0, 255).astype(np.uint8)
        self.horizon = tuple(int(p) for p in yuv_planes(horizon))

    def affine(
        self, yaw_rad: float, roll_rad: float, focal_px: float, horizon: tuple[float, float]
    ) -> NDArray[np.float64]:
        """Return the 2x3 matrix from picture pixels to panorama pixels.

        `horizon` is the pixel of the picture where the horizon crosses straight ahead.
        """
        # One panorama pixel an angle: exact at the centre, a little stretched at the sides.
        scale = 1 / (focal_px * self.step_rad)
        s, c = math.sin(roll_rad) * scale, math.cos(roll_rad) * scale
        ahead = (-yaw_rad % (2 * math.pi)) / self.step_rad
        if ahead < _WIDTH / 4:
            ahead += _WIDTH
        level = _TOP_RAD / self.step_rad
        column, row = horizon
        return np.array(
            [
                [c, -s, ahead - c * column + s * row],
                [s, c, level - s * column - c * row],
            ]
        )


@lru_cache(maxsize=4)
def sky_over(light: Light, palette: Palette, haze: float, seed: int) -> Sky:
    """Return the sky of a world; renderers of the same world share it."""
    return Sky(light, palette, haze, seed)


def _clouds(
    rows: int, elevation: NDArray[np.float64], share: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    noise = np.zeros((_WIDTH, _WIDTH), np.float32)
    for cells, weight in ((10, 1.0), (24, 0.6), (60, 0.35), (150, 0.2)):
        noise += weight * periodic_noise(_WIDTH, cells, rng)
    # Clouds lie flatter towards the horizon: sample the noise by 1 / elevation.
    height = np.clip(elevation, math.radians(1.5), None)
    line = (140.0 / np.tan(height + 0.08)).astype(np.intp) % _WIDTH
    flat = noise[line]
    cover = np.clip((flat + (share - 0.5) * 2.6) * 0.7, 0, 1)
    fade = np.clip(elevation / math.radians(6), 0, 1)[:, None]
    return (cover * fade * 0.85).astype(np.float32).reshape(rows, _WIDTH)


def _hills(
    picture: NDArray[np.float32],
    elevation: NDArray[np.float64],
    green: NDArray[np.float64],
    horizon: NDArray[np.float32],
    haze: float,
    rng: np.random.Generator,
) -> None:
    """Draw two lines of far woods on the horizon, lost in haze."""
    for far, height in ((0.82, 0.03), (0.6, 0.016)):
        line = np.zeros(_WIDTH, np.float32)
        for cells, weight in ((9, 1.0), (33, 0.45), (120, 0.25), (400, 0.16)):
            line += weight * periodic_noise(_WIDTH, cells, rng)[0]
        top = height * (1 + 0.4 * line)
        lost = min(1.0, far + 0.3 * haze)
        colour = green * (1 - lost) + horizon * lost
        cover = np.clip((top[None, :] - elevation[:, None]) / 0.0015, 0, 1)[..., None]
        picture += (colour - picture) * cover.astype(np.float32)


def rotated(panorama: Bytes, affine: NDArray[np.float64], size: tuple[int, int]) -> Bytes:
    """Return (rows, columns) = `size` pixels of the panorama."""
    return np.asarray(
        cv2.warpAffine(
            panorama,
            affine,
            (size[1], size[0]),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REPLICATE,
        ),
        np.uint8,
    )
