"""A simulated world from straight above, as an aerial photograph shows it."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.simulation.ground import GroundTexture
from juncnet.simulation.palettes import Colour, lit
from juncnet.simulation.solids import Face, solid
from juncnet.simulation.world import Tree, World

Picture = NDArray[np.uint8]
CLUMPS = 26
"""Of leaves in a tree's crown."""
_SHIFT = 4


@dataclass(frozen=True)
class Aerial:
    """A photograph, (H, W, 3) red first, and the ground that it covers, metres."""

    picture: Picture
    extent: tuple[float, float, float, float]
    """x_min, x_max, y_min, y_max."""
    beyond: tuple[float, float, float]
    """Red, green, blue, 0..1, of the ground around it."""


def aerial(world: World, metres_per_px: float = 0.15) -> Aerial:
    """Return the world from above: its ground, buildings, cars and trees, under its light."""
    ground = GroundTexture(world, metres_per_px)
    luma = ground.luma[0]
    height, width = luma.shape
    chroma = cv2.resize(ground.chroma[0], (width, height), interpolation=cv2.INTER_LINEAR)
    picture = _rgb(np.dstack([luma, chroma.astype(np.uint8)]))
    step = ground.metres_per_px

    def pixels(points: NDArray[np.float64]) -> NDArray[np.int32]:
        column = (points[:, 0] - ground.x_min) / step - 0.5
        row = (ground.y_max - points[:, 1]) / step - 0.5
        return np.rint(np.stack([column, row], 1) * (1 << _SHIFT)).astype(np.int32)

    for box in world.boxes:
        faces = solid(box, world.style, ground.light, world.seed).faces
        for outline, colour in _seen(faces):
            cv2.fillPoly(picture, [pixels(outline)], colour, cv2.LINE_AA, _SHIFT)
    leaves = (lit(ground.palette.leaf, ground.light), lit(ground.palette.leaf_other, ground.light))
    for tree in sorted(world.trees, key=lambda tree: tree.height_m):
        for centre, radius_m, colour in _crown(tree, leaves, ground.light.shading):
            (place,) = pixels(np.array([centre]))
            radius = round(radius_m / step * (1 << _SHIFT))
            cv2.circle(picture, place.tolist(), radius, colour, -1, cv2.LINE_AA, _SHIFT)
    ground_colour = _rgb(np.array([[ground.beyond]], np.uint8))[0, 0] / 255
    return Aerial(
        picture,
        (ground.x_min, ground.x_min + width * step, ground.y_max - height * step, ground.y_max),
        (float(ground_colour[0]), float(ground_colour[1]), float(ground_colour[2])),
    )


def _rgb(yuv: NDArray[np.uint8]) -> Picture:
    """Return (H, W, 3) Y, U, V in studio range as red, green, blue."""
    y, u, v = (yuv[..., i].astype(np.float32) - offset for i, offset in enumerate((16, 128, 128)))
    y *= 1.164
    rgb = np.stack([y + 1.596 * v, y - 0.392 * u - 0.813 * v, y + 2.017 * u], -1)
    return np.ascontiguousarray(np.clip(rgb, 0, 255).astype(np.uint8))


def _seen(faces: tuple[Face, ...]) -> list[tuple[NDArray[np.float64], tuple[int, int, int]]]:
    """Return the outline (N, 2) and colour of every face that looks up, the lowest first."""
    found: list[tuple[float, NDArray[np.float64], tuple[int, int, int]]] = []
    for face in faces:
        if face.plane[2] < 0.05:
            continue
        corners = np.column_stack([face.corners, np.ones(len(face.corners))]) @ face.to_world.T
        corners = corners[:, :3] / corners[:, 3:]
        red, green, blue = _rgb(np.array([[face.mean]], np.uint8))[0, 0].tolist()
        found.append((float(corners[:, 2].mean()), corners[:, :2], (red, green, blue)))
    return [(outline, colour) for _, outline, colour in sorted(found, key=lambda item: item[0])]


def _crown(
    tree: Tree, leaves: tuple[Colour, Colour], shading: float
) -> list[tuple[tuple[float, float], float, tuple[int, int, int]]]:
    """Return the clumps of a crown: centre, radius [m] and colour, the outermost first."""
    rng = np.random.default_rng([tree.seed, 13])
    mix = rng.uniform()
    clumps: list[tuple[tuple[float, float], float, tuple[int, int, int]]] = []
    for out in np.sqrt(np.linspace(0.75, 0.0, CLUMPS)):
        angle = rng.uniform(0, 2 * math.pi)
        x, y = out * math.cos(angle), out * math.sin(angle)
        bright = 0.9 + 0.35 * shading * (y - x) + 0.25 * (0.5 - out) + rng.normal(0, 0.06)
        blue, green, red = (
            int(np.clip((a + (b - a) * mix) * bright, 0, 255)) for a, b in zip(*leaves, strict=True)
        )
        centre = (tree.x_m + tree.radius_m * x, tree.y_m + tree.radius_m * y)
        clumps.append((centre, 0.34 * tree.radius_m, (red, green, blue)))
    return clumps
