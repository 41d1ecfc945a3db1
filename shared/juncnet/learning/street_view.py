"""Pictures of street plans, as a level camera at a person's or a car's height takes them.

The ground is painted once from above and warped into each picture; fronts and things stand on it,
drawn from far to near. What they hide is taken off the mask, so that the label says what can be
seen.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.learning.street_plan import ARM, JUNCTION, LENGTH_M, REACH_M, Street, Thing

Bytes = NDArray[np.uint8]
STEP_M = 0.125
"""Size of the ground's pixels."""
BEHIND_M = 4.0
NEAR_M = 0.4
"""What is nearer than this to the picture's plane is cut off."""
FRONT_PX = 48


@dataclass(frozen=True)
class Eye:
    """A camera in a street: where it stands, how it looks."""

    x_m: float
    z_m: float
    height_m: float
    yaw_rad: float
    pitch_rad: float
    """Downwards."""
    roll_rad: float
    fov_rad: float
    width: int
    height: int

    def matrix(self) -> NDArray[np.float64]:
        """Return the 3x4 matrix from (x, up, z, 1) to picture coordinates times depth."""
        cy, sy = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        cp, sp = math.cos(self.pitch_rad), math.sin(self.pitch_rad)
        cr, sr = math.cos(self.roll_rad), math.sin(self.roll_rad)
        turn = np.array([[cy, 0, -sy], [0, -1, 0], [sy, 0, cy]])  # right, down, forward
        nod = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
        roll = np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]])
        focal = self.width / 2 / math.tan(self.fov_rad / 2)
        lens = np.array([[focal, 0, self.width / 2], [0, focal, self.height / 2], [0, 0, 1]])
        rotation = roll @ nod @ turn
        centre = np.array([self.x_m, self.height_m, self.z_m])
        return lens @ np.hstack([rotation, (-rotation @ centre)[:, None]])


class StreetView:
    """Draws one street from any number of eyes."""

    def __init__(self, street: Street, rng: np.random.Generator) -> None:
        """Paint the ground of `street`; `rng` draws textures and sky."""
        self.street = street
        self._ground, self._surface = _painted(street, rng)
        quarter = (self._ground.shape[1] // 4, self._ground.shape[0] // 4)
        coarse = cv2.resize(self._ground, quarter, interpolation=cv2.INTER_AREA)
        self._coarse = np.asarray(coarse, np.uint8)
        self._sky, self._cloud = float(rng.uniform(120, 250)), float(rng.uniform(0, 30))
        self._hills = rng.uniform(0, 0.12, 9) * float(rng.random() < 0.5)
        self._hill_grey = float(rng.uniform(60, 150))
        self._sun_side = float(rng.choice((-1, 1)))
        self._seed = int(rng.integers(1 << 30))

    def picture(self, eye: Eye) -> tuple[Bytes, Bytes]:
        """Return the picture and the classes of the ground that is seen, both (H, W) uint8."""
        matrix = eye.matrix()
        size = (eye.width, eye.height)
        plane = matrix[:, [0, 2, 3]]
        picture = self._backdrop(eye)
        below = _below_horizon(eye)
        for raster, step in ((self._ground, STEP_M), (self._coarse, 4 * STEP_M)):
            warped = _warp(raster, plane, step, size, cv2.INTER_LINEAR, round(self.street.ground))
            rows = below if raster is self._ground else below & _far_rows(eye)
            picture[rows] = warped[rows]
        mask = _warp(self._surface, plane, STEP_M, size, cv2.INTER_NEAREST, 0)
        mask[~below] = 0
        self._stand(eye, matrix, picture, mask)
        return picture, mask

    def _backdrop(self, eye: Eye) -> Bytes:
        rng = np.random.default_rng(self._seed)
        ramp = np.linspace(-1, 1, eye.height)[:, None] * rng.uniform(0, 25)
        cloud = cv2.resize(rng.normal(0, self._cloud, (5, 7)), (eye.width, eye.height))
        picture = np.clip(self._sky + ramp + cloud, 0, 255).astype(np.uint8)
        focal = eye.width / 2 / math.tan(eye.fov_rad / 2)
        horizon = eye.height / 2 - focal * math.tan(eye.pitch_rad)
        columns = np.linspace(-0.1 * eye.width, 1.1 * eye.width, len(self._hills))
        top = np.stack([columns, horizon - self._hills * focal], axis=1)
        corners = [[1.1 * eye.width, eye.height], [-0.1 * eye.width, eye.height]]
        cv2.fillPoly(picture, [np.vstack([top, corners]).astype(np.int32)], self._hill_grey)
        return picture

    def _stand(self, eye: Eye, matrix: NDArray[np.float64], picture: Bytes, mask: Bytes) -> None:
        """Draw what stands on the ground, far things first."""
        street = self.street
        jobs: list[tuple[float, int]] = []
        ends = np.array([[f.a, f.b] for f in street.fronts]).reshape(-1, 2)
        ends = street.bent(ends).reshape(-1, 2, 2)
        spots = street.bent(np.array([[t.x_m, t.z_m] for t in street.things]).reshape(-1, 2))
        here = np.array([eye.x_m, eye.z_m])
        jobs += [(float(np.hypot(*(e.mean(axis=0) - here))), i) for i, e in enumerate(ends)]
        jobs += [(float(np.hypot(*(p - here))), -1 - i) for i, p in enumerate(spots)]
        for _, index in sorted(jobs, reverse=True):
            if index >= 0:
                front = street.fronts[index]
                across = abs(front.a[1] - front.b[1]) < 0.1
                light = 0.75 if across else 1.0 + 0.2 * self._sun_side * np.sign(front.a[0])
                texture = _front_texture(front.texture % 64, street.kind == "town")
                gain = front.gain * light
                _draw_front(matrix, ends[index], front.height_m, texture, gain, picture, mask)
            else:
                thing = street.things[-1 - index]
                _draw_thing(thing, spots[-1 - index], matrix, picture, mask)


def _painted(street: Street, rng: np.random.Generator) -> tuple[Bytes, Bytes]:
    """Return the ground's grey and its classes; row 0 is the farthest."""
    shape = (round((LENGTH_M + BEHIND_M) / STEP_M), round(2 * REACH_M / STEP_M))
    ground = np.full(shape, round(street.ground), np.uint8)
    surface = np.zeros(shape, np.uint8)
    for area in street.areas:
        pixels = _pixels(street.bent(area.points))
        cv2.fillPoly(ground, [pixels], round(min(area.grey, 255.0)), cv2.LINE_8, 4)
        if area.surface is not None:
            cv2.fillPoly(surface, [pixels], area.surface, cv2.LINE_8, 4)
    coarse = rng.normal(0, rng.uniform(1, 9), (shape[0] // 12, shape[1] // 12))
    fine = rng.normal(0, rng.uniform(1, 8), (128, 128))
    rough = cv2.resize(coarse, shape[::-1], interpolation=cv2.INTER_LINEAR)
    rough += np.tile(fine, (shape[0] // 128 + 1, shape[1] // 128 + 1))[: shape[0], : shape[1]]
    off = np.where(surface == 0, rng.uniform(1, 3), 1.0)
    lit = ground + rough * off
    for shadow in street.shadows:
        dark = np.zeros(shape, np.uint8)
        cv2.fillPoly(dark, [_pixels(street.bent(shadow.points))], 1, cv2.LINE_8, 4)
        lit[dark == 1] *= shadow.grey
    return np.clip(lit, 0, 255).astype(np.uint8), surface


def _pixels(points: NDArray[np.float64]) -> NDArray[np.int32]:
    """Return ground points as pixels of the raster with 4 fractional bits."""
    columns = (points[:, 0] + REACH_M) / STEP_M - 0.5
    rows = (LENGTH_M - points[:, 1]) / STEP_M - 0.5
    return np.round(np.stack([columns, rows], 1) * 16).astype(np.int32)


def _warp(
    raster: Bytes,
    plane: NDArray[np.float64],
    step: float,
    size: tuple[int, int],
    flags: int,
    beyond: int,
) -> Bytes:
    to_ground = np.array(
        [[step, 0, 0.5 * step - REACH_M], [0, -step, LENGTH_M - 0.5 * step], [0, 0, 1]]
    )
    warped = cv2.warpPerspective(raster, plane @ to_ground, size, flags=flags, borderValue=beyond)
    return np.asarray(warped, np.uint8)


def _rows_of_horizon(eye: Eye) -> NDArray[np.float64]:
    """Return the horizon's row at each column (1, W)."""
    focal = eye.width / 2 / math.tan(eye.fov_rad / 2)
    columns = np.arange(eye.width)[None] - eye.width / 2
    level = eye.height / 2 - focal * math.tan(eye.pitch_rad) / math.cos(eye.roll_rad)
    return np.asarray(level + columns * math.tan(eye.roll_rad), np.float64)


def _below_horizon(eye: Eye) -> NDArray[np.bool_]:
    return np.asarray(np.arange(eye.height)[:, None] > _rows_of_horizon(eye) + 0.5)


def _far_rows(eye: Eye) -> NDArray[np.bool_]:
    """Return which pixels show ground so far off that the fine raster would flicker."""
    focal = eye.width / 2 / math.tan(eye.fov_rad / 2)
    far = eye.height_m * focal / 18.0
    return np.asarray(np.arange(eye.height)[:, None] < _rows_of_horizon(eye) + far)


_TEXTURES: dict[tuple[int, bool], Bytes] = {}


def _front_texture(number: int, town: bool) -> Bytes:
    """Return one of some house fronts, (FRONT_PX, FRONT_PX): walls, windows, a ground floor."""
    if (number, town) in _TEXTURES:
        return _TEXTURES[number, town]
    rng = np.random.default_rng([number, int(town), 5])
    wall = float(rng.uniform(70, 190))
    front = np.full((FRONT_PX, FRONT_PX), wall) + rng.normal(0, 6, (FRONT_PX, FRONT_PX))
    rows, columns = int(rng.integers(2, 7)), int(rng.integers(2, 7))
    glass = float(rng.uniform(20, 110)) if rng.random() < 0.8 else wall + 40
    high, wide = FRONT_PX / rows, FRONT_PX / columns
    if rng.random() < 0.85:
        for r in range(rows):
            for c in range(columns):
                y0, x0 = round(r * high + 0.2 * high), round(c * wide + 0.25 * wide)
                y1, x1 = round(y0 + 0.55 * high), round(x0 + 0.5 * wide)
                front[y0:y1, x0:x1] = glass + rng.normal(0, 15)
    if rng.random() < 0.6:  # a shop
        top = round(FRONT_PX * (1 - 0.9 / rows))
        front[top:] = rng.uniform(20, 120)
        front[top : top + 3] = rng.uniform(60, 230)
    front[:2] = wall * rng.uniform(0.5, 1.2)
    _TEXTURES[number, town] = np.clip(front, 0, 255).astype(np.uint8)
    return _TEXTURES[number, town]


def _draw_front(
    matrix: NDArray[np.float64],
    ends: NDArray[np.float64],
    height_m: float,
    texture: Bytes,
    gain: float,
    picture: Bytes,
    mask: Bytes,
) -> None:
    depth = ends @ matrix[2, [0, 2]] + matrix[2, 3]
    if depth.max() < NEAR_M:
        return
    low, high = 0.0, 1.0
    if depth.min() < NEAR_M:
        cut = float((NEAR_M - depth[0]) / (depth[1] - depth[0]))
        low, high = (cut, 1.0) if depth[0] < NEAR_M else (0.0, cut)
    a, b = ends[0] + low * (ends[1] - ends[0]), ends[0] + high * (ends[1] - ends[0])
    solid = np.array(
        [[a[0], height_m, a[1]], [b[0], height_m, b[1]], [b[0], 0, b[1]], [a[0], 0, a[1]]]
    )
    corners = _projected(matrix, solid)
    if not _touches(corners, picture):
        return
    edge = FRONT_PX - 1
    source = np.array([[low, 0], [high, 0], [high, 1], [low, 1]], np.float32) * edge
    transform = cv2.getPerspectiveTransform(source, corners.astype(np.float32))
    left, top = np.maximum(np.floor(corners.min(axis=0)), 0).astype(int)
    right, bottom = np.ceil(corners.max(axis=0)).astype(int) + 1
    part, hidden = picture[top:bottom, left:right], mask[top:bottom, left:right]
    if part.size == 0:
        return
    shift = np.array([[1, 0, -left], [0, 1, -top], [0, 0, 1]], np.float64)
    lit = np.clip(texture * gain, 0, 255).astype(np.uint8)
    size = (part.shape[1], part.shape[0])
    drawn = cv2.warpPerspective(lit, shift @ transform, size, borderMode=cv2.BORDER_REPLICATE)
    where = np.zeros(part.shape, np.uint8)
    cv2.fillConvexPoly(where, np.round(corners - [left, top]).astype(np.int32), 1)
    cv2.copyTo(drawn, where, part)
    hidden[where == 1] = 0


def _projected(matrix: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return picture coordinates (N, 2), bounded, of points (N, 3) in front of the camera."""
    seen = points @ matrix[:, :3].T + matrix[:, 3]
    return np.clip(seen[:, :2] / np.maximum(seen[:, 2:], 1e-3), -4000, 4000)


def _touches(corners: NDArray[np.float64], picture: Bytes) -> bool:
    low, high = corners.min(axis=0), corners.max(axis=0)
    return bool(
        high[0] > 0 and high[1] > 0 and low[0] < picture.shape[1] and low[1] < picture.shape[0]
    )


def _draw_thing(
    thing: Thing,
    spot: NDArray[np.float64],
    matrix: NDArray[np.float64],
    picture: Bytes,
    mask: Bytes,
) -> None:
    depth = float(spot @ matrix[2, [0, 2]] + matrix[2, 3])
    if depth < (3.5 if thing.kind == "car" else 1.5):
        return
    x, z = spot
    scale = float(np.hypot(*matrix[:2, 1])) / depth  # pixels a metre, upright
    foot, head = _projected(matrix, np.array([[x, 0, z], [x, thing.size_m, z]]))
    if thing.kind == "car":
        _draw_car(thing, spot, matrix, picture, mask)
        return
    if thing.kind == "tree":
        trunk = max(1, round(0.25 * scale))
        centre = foot + 0.65 * (head - foot)
        for plane, grey in ((picture, thing.grey * 0.7), (mask, 0)):
            _line(plane, foot, centre, grey, trunk)
        rng = np.random.default_rng(round(thing.size_m * 1e6))
        for _ in range(9):
            offset = rng.normal(0, 0.16, 2) * thing.size_m * scale
            radius = max(1, round(thing.size_m * scale * float(rng.uniform(0.1, 0.22))))
            at = np.clip(centre + offset, -3000, 3000).astype(int).tolist()
            cv2.circle(picture, at, radius, thing.grey * float(rng.uniform(0.7, 1.3)), -1)
            cv2.circle(mask, at, radius, 0, -1)
        return
    thick = {"pole": 0.15, "lights": 0.15, "person": 0.5}[thing.kind]
    for plane, grey in ((picture, thing.grey), (mask, 0)):
        _line(plane, foot, head, grey, max(1, round(thick * scale)))
    if thing.kind == "lights":
        _line(picture, head, head + 0.3 * (foot - head), 15, max(2, round(0.4 * scale)))


def _line(
    plane: Bytes, a: NDArray[np.float64], b: NDArray[np.float64], grey: float, thick: int
) -> None:
    cv2.line(plane, a.astype(int).tolist(), b.astype(int).tolist(), grey, min(thick, 60))


def _draw_car(
    car: Thing,
    spot: NDArray[np.float64],
    matrix: NDArray[np.float64],
    picture: Bytes,
    mask: Bytes,
) -> None:
    """Draw a shadow, a body, and a cabin with dark windows."""
    lorry = car.size_m > 6
    height = 3.2 if lorry else 1.45
    parts = (
        ((0.0, 0.12), 1.05, 20.0),
        ((0.2, height * (0.95 if lorry else 0.58)), 1.0, car.grey),
        ((height * 0.58, height * 0.9), 0.6, 35.0 if not lorry else car.grey),
        ((height * 0.9, height), 0.52, car.grey * 0.95),
    )
    for (low, high), share, grey in parts:
        length, width = car.size_m * share / 2, (1.8 if not lorry else 2.4) * max(share, 0.85) / 2
        dx, dz = (width, length) if car.along else (length, width)
        corners = np.array(
            [
                [spot[0] + sx * dx, up, spot[1] + sz * dz]
                for sx in (-1, 1)
                for sz in (-1, 1)
                for up in (low, high)
            ]
        )
        hull = cv2.convexHull(_projected(matrix, corners).astype(np.int32))
        cv2.fillConvexPoly(picture, hull, min(grey, 255.0))
        cv2.fillConvexPoly(mask, hull, 0)


def visible_share(mask: Bytes) -> tuple[float, float]:
    """Return the shares of the picture that show the junction's surface, and its side roads."""
    return float((mask == JUNCTION).mean()), float((mask == ARM).mean())
