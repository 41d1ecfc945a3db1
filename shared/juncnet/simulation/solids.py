"""Buildings and parked cars as textured faces in space."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.simulation.materials import Bytes
from juncnet.simulation.palettes import Colour, Light, lit, yuv_planes
from juncnet.simulation.world import Box, Style

_PX_PER_M = 24


@dataclass(frozen=True)
class Face:
    """A flat polygon with a texture.

    `corners` is (N, 2) in units of the texture's width and height, (0, 0) top left, clockwise as
    seen from outside; `to_world` the (4, 3) matrix from (u, v, 1) to homogeneous world metres.
    `luma` and `chroma` are half-size levels of the texture.
    """

    corners: NDArray[np.float64]
    to_world: NDArray[np.float64]
    luma: tuple[Bytes, ...]
    chroma: tuple[Bytes, ...]
    mean: tuple[float, float, float]
    """Y, U, V of the whole texture."""
    plane: tuple[float, float, float, float]
    """Normal, outward, and its product with a point of the face: more is in front of it."""
    middle: tuple[float, float]
    """Mean of the corners."""


@dataclass(frozen=True)
class Solid:
    """A building or car: faces, and where its middle is."""

    x_m: float
    y_m: float
    radius_m: float
    faces: tuple[Face, ...]


def solid(box: Box, style: Style, light: Light, seed: int) -> Solid:
    """Return the faces of a box, shaded by the sun, with windows and a roof by its seed."""
    rng = np.random.default_rng([seed, box.seed, 12])
    build = _building if box.kind == "building" else _car
    faces = build(box, style, light, rng)
    return Solid(box.x_m, box.y_m, math.hypot(box.length_m, box.width_m) / 2, tuple(faces))


class _Shape:
    """Places faces of one box: corners in its own frame (along, left, up), metres."""

    def __init__(self, box: Box, style: Style, light: Light) -> None:
        self.box, self.light = box, light
        s, c = math.sin(box.yaw_rad), math.cos(box.yaw_rad)
        self.turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        e, a = style.sun_elevation_rad, style.sun_azimuth_rad
        self.sun = np.array([math.cos(e) * math.cos(a), math.cos(e) * math.sin(a), math.sin(e)])

    def face(self, corners: NDArray[np.float64], texture: NDArray[np.float32]) -> Face:
        """Return the face of three or four corners: top left, top right, bottom right, bottom left.

        Three corners: the top, bottom right, bottom left.
        """
        world = corners @ self.turn.T + [self.box.x_m, self.box.y_m, 0]
        *_, right, left = world
        normal = np.cross(right - left, world[0] - left)
        normal /= max(float(np.linalg.norm(normal)), 1e-9)
        # Lit by the sun from `shading` to 1; the sky lights what faces up.
        sunny = max(0.0, float(normal @ self.sun))
        shade = 1 - self.light.shading * (1 - sunny) + 0.08 * float(normal[2])
        colours = np.clip(texture * np.array(lit((shade, shade, shade), self.light)), 4, 252)
        y, u, v = yuv_planes(colours)
        luma = np.clip(y, 16, 240).astype(np.uint8)
        chroma = np.clip(np.stack([u, v], -1), 0, 255).astype(np.uint8)
        flat, to_world = _flat(world)
        mean = (float(luma.mean()), float(chroma[..., 0].mean()), float(chroma[..., 1].mean()))
        nx, ny, nz = (float(n) for n in normal)
        plane = (nx, ny, nz, float(normal @ world[0]))
        middle = (float(flat[:, 0].mean()), float(flat[:, 1].mean()))
        return Face(flat, to_world, _levels(luma), _levels(chroma), mean, plane, middle)

    def sides(
        self,
        low: tuple[float, float, float],
        high: tuple[float, float, float],
        shift: float = 0.0,
    ) -> list[NDArray[np.float64]]:
        """Return front, left, back, right of a box that narrows upwards.

        `low` and `high` are (half length, half width, height above the ground) of the lower and
        the upper end; `shift` moves both along.
        """
        ends: list[NDArray[np.float64]] = []
        for length, width, z in (low, high):
            ends.append(
                np.array(
                    [
                        [length + shift, width, z],
                        [-length + shift, width, z],
                        [-length + shift, -width, z],
                        [length + shift, -width, z],
                    ]
                )
            )
        bottom, top = ends
        order = ((0, 3), (1, 0), (2, 1), (3, 2))
        return [np.stack([top[i], top[j], bottom[j], bottom[i]])[[1, 0, 3, 2]] for i, j in order]


def _flat(world: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the corners in the texture, and the matrix from the texture to the world."""
    if len(world) == 3:
        top, right, left = world
        matrix = np.stack([right - left, left - top, top], 1)
        # The top of a gable is the middle of the texture's upper edge.
        matrix[:, 1] = (left + right) / 2 - top
        matrix[:, 2] = top - 0.5 * matrix[:, 0]
        corners = np.array([[0.5, 0], [1, 1], [0, 1]])
        return corners, np.concatenate([matrix, [[0, 0, 1]]])
    origin, across, down = world[0], world[1] - world[0], world[3] - world[0]
    basis = np.stack([across, down], 1)
    third = np.asarray(np.linalg.pinv(basis) @ (world[2] - origin), np.float64)
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    seen = np.array([[0, 0], [1, 0], third, [0, 1]], np.float32)
    warp = np.asarray(cv2.getPerspectiveTransform(square, seen), np.float64)
    affine = np.concatenate([np.stack([across, down, origin], 1), [[0, 0, 1]]])
    return square.astype(np.float64), affine @ warp


def _levels(plane: Bytes) -> tuple[Bytes, ...]:
    levels = [plane]
    while len(levels) < 5 and min(levels[-1].shape[:2]) >= 8:
        h, w = levels[-1].shape[:2]
        half = cv2.resize(levels[-1], (w // 2, h // 2), interpolation=cv2.INTER_AREA)
        levels.append(np.asarray(half, np.uint8))
    return tuple(levels)


def _blank(
    width_m: float, height_m: float, colour: Colour, rng: np.random.Generator, grain: float = 0.03
) -> NDArray[np.float32]:
    size = (max(8, int(height_m * _PX_PER_M)), max(8, int(width_m * _PX_PER_M)))
    texture = np.empty((*size, 3), np.float32)
    texture[:] = colour
    texture *= 1 + grain * rng.standard_normal(size, dtype=np.float32)[..., None]
    return texture


def _rect(
    texture: NDArray[np.float32], x: float, y: float, w: float, h: float, colour: Colour
) -> None:
    p = _PX_PER_M
    corner, other = (int(x * p), int(y * p)), (int((x + w) * p), int((y + h) * p))
    cv2.rectangle(texture, corner, other, colour, -1)


def _wall(
    width_m: float, height_m: float, colour: Colour, door: bool, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Return a plastered or bricked wall with a base, rows of windows and perhaps a door."""
    texture = _blank(width_m, height_m, colour, rng)
    floors = max(1, round(height_m / 2.9))
    storey = height_m / floors
    columns = max(1, int(width_m / rng.uniform(2.2, 3.2)))
    gap = width_m / columns
    dark, frame = (62.0, 54.0, 48.0), (222.0, 226.0, 226.0)
    for floor in range(floors):
        for column in range(columns):
            x, y = (column + 0.5) * gap - 0.55, floor * storey + 0.65
            if door and floor == floors - 1 and column == columns // 2:
                _rect(texture, x, y - 0.1, 1.05, storey, (48, 62, 96))
                continue
            glass = float(rng.uniform(0.7, 1.9))
            _rect(texture, x - 0.08, y - 0.08, 1.26, 1.46, frame)
            _rect(texture, x, y, 1.1, 1.3, (dark[0] * glass, dark[1] * glass, dark[2] * glass))
            _rect(texture, x + 0.52, y, 0.06, 1.3, frame)
            _rect(texture, x - 0.12, y + 1.36, 1.34, 0.08, (150, 156, 160))
    base = (0.55 * colour[0] + 20, 0.55 * colour[1] + 20, 0.55 * colour[2] + 20)
    _rect(texture, 0, height_m - 0.45, width_m, 0.5, base)
    return texture


def _tiles(
    width_m: float, height_m: float, colour: Colour, rng: np.random.Generator
) -> NDArray[np.float32]:
    texture = _blank(width_m, height_m, colour, rng, 0.07)
    rows = np.arange(texture.shape[0], dtype=np.float32)
    texture *= (0.86 + 0.22 * (np.mod(rows, 8) / 8.0))[:, None, None]
    return texture


def _building(box: Box, style: Style, light: Light, rng: np.random.Generator) -> list[Face]:
    shape = _Shape(box, style, light)
    flat = rng.random() < 0.25
    half_l, half_w = box.length_m / 2, box.width_m / 2
    eaves = box.height_m if flat else max(2.4, box.height_m - 0.35 * box.width_m)
    colour = (float(box.colour[0]), float(box.colour[1]), float(box.colour[2]))
    faces: list[Face] = []
    for i, side in enumerate(shape.sides((half_l, half_w, 0), (half_l, half_w, eaves))):
        width = box.width_m if i % 2 == 0 else box.length_m
        faces.append(shape.face(side, _wall(width, eaves, colour, i == 1, rng)))
    roofs: tuple[Colour, ...] = ((58, 72, 142), (70, 84, 120), (76, 74, 72), (60, 62, 88))
    roof = roofs[int(rng.integers(len(roofs)))]
    if flat:
        top = [[half_l, half_w], [half_l, -half_w], [-half_l, -half_w], [-half_l, half_w]]
        corners = np.array([[x, y, eaves] for x, y in top])
        return [*faces, shape.face(corners, _blank(4, 4, (120, 122, 124), rng))]
    ridge, over = max(box.height_m, eaves + 0.8), 0.35
    slope = math.hypot(half_w, ridge - eaves)
    drop = over * (ridge - eaves) / half_w
    for s in (1, -1):
        x = s * (half_l + over)
        y, z = s * (half_w + over), eaves - drop
        corners = np.array([[-x, 0, ridge], [x, 0, ridge], [x, y, z], [-x, y, z]])[[1, 0, 3, 2]]
        faces.append(shape.face(corners, _tiles(box.length_m, slope, roof, rng)))
        gable = np.array([[s * half_l, 0, ridge], [s * half_l, s * half_w, eaves]])
        gable = np.concatenate([gable, [[s * half_l, -s * half_w, eaves]]])
        faces.append(shape.face(gable, _blank(box.width_m, ridge - eaves, colour, rng)))
    return faces


def _car(box: Box, style: Style, light: Light, rng: np.random.Generator) -> list[Face]:
    """Return a body with wheels and a cabin that narrows upwards."""
    shape = _Shape(box, style, light)
    half_l, half_w, high = box.length_m / 2, box.width_m / 2, box.height_m
    belt = 0.6 * high
    colour = (float(box.colour[0]), float(box.colour[1]), float(box.colour[2]))
    faces: list[Face] = []
    for i, side in enumerate(shape.sides((half_l, half_w, 0.04), (half_l * 0.98, half_w, belt))):
        width = box.width_m if i % 2 == 0 else box.length_m
        faces.append(shape.face(side, _bodywork(width, belt, colour, i, rng)))
    deck = [[half_l, half_w], [half_l, -half_w], [-half_l, -half_w], [-half_l, half_w]]
    corners = np.array([[x * 0.98, y, belt] for x, y in deck])
    faces.append(shape.face(corners, _blank(2, 4, colour, rng, 0.01)))
    low, top = (0.66 * half_l, 0.94 * half_w, belt), (0.42 * half_l, 0.76 * half_w, high)
    for i, side in enumerate(shape.sides(low, top, -0.12 * half_l)):
        faces.append(shape.face(side, _glass(colour, i, rng)))
    corners = np.array([[x * 0.42 - 0.12 * half_l, y * 0.76, high] for x, y in deck])
    return [*faces, shape.face(corners, _blank(2, 2, colour, rng, 0.01))]


def _bodywork(
    width_m: float, height_m: float, colour: Colour, side: int, rng: np.random.Generator
) -> NDArray[np.float32]:
    texture = _blank(width_m, height_m, colour, rng, 0.01)
    p, tyre = _PX_PER_M, (30.0, 30.0, 30.0)
    rows = np.linspace(1.1, 0.8, texture.shape[0], dtype=np.float32)
    texture *= rows[:, None, None]
    _rect(texture, 0, height_m - 0.16, width_m, 0.2, tyre)
    if side % 2:
        for x in (0.19, 0.8):
            place = (int(x * width_m * p), int((height_m - 0.3) * p))
            cv2.circle(texture, place, int(0.36 * p), tyre, -1)
            cv2.circle(texture, place, int(0.2 * p), (150, 150, 150), -1)
        _rect(texture, 0.5 * width_m, 0.02, 0.02, height_m - 0.2, (40, 40, 40))
        return texture
    lamp = (225.0, 235.0, 238.0) if side == 0 else (40.0, 40.0, 190.0)
    for x in (0.08, width_m - 0.45):
        _rect(texture, x, 0.22 * height_m, 0.36, 0.16, lamp)
    _rect(texture, width_m / 2 - 0.26, 0.5 * height_m, 0.52, 0.13, (225, 228, 228))
    return texture


def _glass(colour: Colour, side: int, rng: np.random.Generator) -> NDArray[np.float32]:
    width, height = (1.5, 0.55) if side % 2 == 0 else (2.6, 0.55)
    texture = _blank(width, height, colour, rng, 0.01)
    _rect(texture, 0.1, 0.06, width - 0.2, height - 0.08, (84, 72, 62))
    if side % 2:
        _rect(texture, width / 2 - 0.04, 0, 0.08, height, colour)
    return texture
