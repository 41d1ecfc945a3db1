"""What stands on the ground, drawn from back to front."""

import math
from collections import OrderedDict

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.simulation.materials import Bytes
from juncnet.simulation.palettes import Light, Palette
from juncnet.simulation.solids import Face, Solid, solid
from juncnet.simulation.sprites import Shape, Sprite, draw_sprites
from juncnet.simulation.view import View
from juncnet.simulation.world import Tree, World

_FAR_M = 140.0
_NEAR_M = 0.4
_SMALL_PX = 72
"""Sprites up to this size are kept after scaling and reused."""
_KEPT = 2000
_Scaled = tuple[Bytes, Bytes, Bytes, Bytes]


class Scenery:
    """The trees, buildings and cars of a world, ready to draw."""

    def __init__(self, world: World, palette: Palette, light: Light, haze: tuple[int, ...]) -> None:
        self._haze = haze
        self._rate = -math.log(max(1 - world.style.haze, 1e-3)) / 200.0
        kinds = draw_sprites(palette, light, world.seed)
        self._trees = world.trees
        self._sprites = [_choose(tree, kinds, palette.conifers) for tree in world.trees]
        self._tints = [0.86 + 0.28 * (tree.seed * 7919 % 97) / 96 for tree in world.trees]
        self._solids = [solid(box, world.style, light, world.seed) for box in world.boxes]
        places = [(t.x_m, t.y_m, t.radius_m) for t in world.trees]
        places += [(s.x_m, s.y_m, s.radius_m) for s in self._solids]
        self._places = np.array(places, np.float64).reshape(-1, 3)
        self._scaled: OrderedDict[tuple[int, ...], _Scaled] = OrderedDict()

    def draw(self, view: View, luma: Bytes, chroma: Bytes) -> None:
        """Draw everything seen from `view` into luminance (H, W) and chroma (H/2, W/2, 2)."""
        for index, distance in self._visible(view):
            kept = math.exp(-self._rate * distance)
            if index < len(self._trees):
                self._draw_tree(index, view, kept, luma, chroma)
            else:
                self._draw_solid(self._solids[index - len(self._trees)], view, kept, luma, chroma)

    def _visible(self, view: View) -> list[tuple[int, float]]:
        """Return (index, distance) of what may be seen, farthest first."""
        if not len(self._places):
            return []
        offset = self._places[:, :2] - view.position[:2]
        radius = self._places[:, 2]
        s, c = math.sin(view.yaw_rad), math.cos(view.yaw_rad)
        ahead = offset[:, 0] * c + offset[:, 1] * s
        aside = np.abs(-offset[:, 0] * s + offset[:, 1] * c)
        # Half the view's width, a little more for the tilted axis.
        spread = 0.62 * view.width / view.focal_px
        distance = np.hypot(ahead, aside)
        seen = (ahead > -radius) & (aside < ahead * spread + 2 * radius + 2) & (distance < _FAR_M)
        chosen = np.flatnonzero(seen)
        order = chosen[np.argsort(-distance[chosen], kind="stable")]
        return [(int(i), float(distance[i])) for i in order]

    def _draw_tree(self, index: int, view: View, kept: float, luma: Bytes, chroma: Bytes) -> None:
        tree, sprite = self._trees[index], self._sprites[index]
        foot = view.projection @ np.array([tree.x_m, tree.y_m, 0.0, 1.0])
        top = view.projection @ np.array([tree.x_m, tree.y_m, tree.height_m, 1.0])
        if min(foot[2], top[2]) < max(_NEAR_M, 0.6 * tree.radius_m):
            return
        foot, top = foot / foot[2], top / top[2]
        depth = float(view.projection[2] @ [tree.x_m, tree.y_m, 0.5 * tree.height_m, 1.0])
        wide = 2 * tree.radius_m * view.focal_px / depth
        high = math.hypot(*(foot - top)[:2])
        gain = kept * self._tints[index]
        lift = (1 - kept) * self._haze[0]
        if max(wide, high) <= _SMALL_PX:
            scaled = self._small(index, sprite, (round(wide), round(high)), gain, lift)
            _paste(scaled, (foot[0], foot[1]), luma, chroma)
            return
        across = np.array([math.cos(view.roll_px_rad), -math.sin(view.roll_px_rad)]) * wide
        _stamp(sprite, np.stack([across, (foot - top)[:2], foot[:2]], 1), gain, lift, luma, chroma)

    def _small(
        self, index: int, sprite: Sprite, size: tuple[int, int], gain: float, lift: float
    ) -> _Scaled:
        wide, high = max(2, size[0]), max(2, size[1])
        key = (id(sprite), wide, high, round(gain * 24), round(lift / 6))
        found = self._scaled.get(key)
        if found is None:
            level = int(np.clip(math.log2(512 / max(wide, high)), 0, len(sprite.luma) - 1))
            area = cv2.INTER_AREA
            part = cv2.resize(sprite.luma[level], (wide, high), interpolation=area)
            bright = cv2.convertScaleAbs(part, alpha=round(gain * 24) / 24, beta=lift)
            half = (-(-wide // 2), -(-high // 2))
            colour = cv2.resize(sprite.chroma[level], half, interpolation=area)
            mask = cv2.resize(sprite.mask[level], (wide, high), interpolation=area)
            small = cv2.resize(sprite.mask[level], half, interpolation=area)
            found = (bright, colour, _hard(mask), _hard(small))
            self._scaled[key] = found
            if len(self._scaled) > _KEPT:
                self._scaled.popitem(last=False)
        return found

    def _draw_solid(self, body: Solid, view: View, kept: float, luma: Bytes, chroma: Bytes) -> None:
        half = view.half()
        seen: list[tuple[float, Face, NDArray[np.float64]]] = []
        for face in body.faces:
            matrix = view.projection @ face.to_world
            corners = _clipped(face.corners, matrix)
            if corners is None or _area(corners) <= 0.5:
                continue
            depth = float(np.mean(face.corners @ matrix[2, :2] + matrix[2, 2]))
            seen.append((depth, face, corners))
        seen.sort(key=lambda item: -item[0])
        for _, face, corners in seen:
            lift = (1 - kept) * self._haze[0]
            matrix = view.projection @ face.to_world
            _cover(face.luma, matrix, corners, luma, kept, lift)
            matrix = half.projection @ face.to_world
            _cover(face.chroma, matrix, corners / 2 - 0.25, chroma, kept, 128 * (1 - kept))


def _choose(tree: Tree, kinds: dict[Shape, list[Sprite]], conifers: float) -> Sprite:
    shape: Shape = "broad"
    if tree.height_m < 2.4 * tree.radius_m and tree.height_m < 3.0:
        shape = "bush"
    elif (tree.seed * 2654435761 >> 7) % 1000 < 1000 * conifers:
        shape = "conifer"
    return kinds[shape][tree.seed % len(kinds[shape])]


def _hard(mask: Bytes) -> Bytes:
    return np.asarray(cv2.compare(mask, 110, cv2.CMP_GT), np.uint8)


def _paste(scaled: _Scaled, foot: tuple[float, float], luma: Bytes, chroma: Bytes) -> None:
    """Copy a scaled sprite with its foot at a pixel, cut at the picture's edges."""
    bright, colour, mask, small = scaled
    high, wide = bright.shape
    left, top = round(foot[0] - wide / 2 + 0.5), round(foot[1] - high + 0.5)
    for plane, part, cover, x, y in (
        (luma, bright, mask, left, top),
        (chroma, colour, small, left // 2, top // 2),
    ):
        x0, y0 = max(0, x), max(0, y)
        x1, y1 = min(plane.shape[1], x + part.shape[1]), min(plane.shape[0], y + part.shape[0])
        if x1 > x0 and y1 > y0:
            cut = (slice(y0 - y, y1 - y), slice(x0 - x, x1 - x))
            cv2.copyTo(part[cut], cover[cut], plane[y0:y1, x0:x1])


def _stamp(
    sprite: Sprite,
    frame: NDArray[np.float64],
    gain: float,
    lift: float,
    luma: Bytes,
    chroma: Bytes,
) -> None:
    """Draw a sprite large: `frame` (2, 3) has its width, its height downwards, and its foot."""
    wide, high = math.hypot(*frame[:, 0]), math.hypot(*frame[:, 1])
    level = int(np.clip(math.log2(512 / max(wide, high)) + 0.3, 0, len(sprite.luma) - 1))
    corners = frame @ np.array([[-0.5, 0.5, 0.5, -0.5], [-1, -1, 0, 0], [1, 1, 1, 1]])
    x0, y0 = (max(0, 2 * math.floor(v / 2)) for v in corners.min(axis=1))
    x1 = min(luma.shape[1], 2 * math.ceil(corners[0].max() / 2))
    y1 = min(luma.shape[0], 2 * math.ceil(corners[1].max() / 2))
    if x1 <= x0 or y1 <= y0:
        return
    side = sprite.luma[level].shape[0]
    # Sprite pixel -> unit square with the foot at its origin -> picture pixel, then inverted.
    unit = np.array([[1 / side, 0, 0.5 / side - 0.5], [0, 1 / side, 0.5 / side - 1], [0, 0, 1]])
    forward = np.concatenate([frame @ unit, [[0, 0, 1]]])
    inverse = np.linalg.inv(forward) @ np.array([[1.0, 0, x0], [0, 1, y0], [0, 0, 1]])
    size = (x1 - x0, y1 - y0)
    mask = _hard(_affine(sprite.mask[level], inverse, size))
    bright = cv2.convertScaleAbs(_affine(sprite.luma[level], inverse, size), alpha=gain, beta=lift)
    cv2.copyTo(bright, mask, luma[y0:y1, x0:x1])
    halved = inverse @ np.array([[2.0, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])
    size = (size[0] // 2, size[1] // 2)
    colour = _affine(sprite.chroma[level], halved, size)
    part = chroma[y0 // 2 : y1 // 2, x0 // 2 : x1 // 2]
    cv2.copyTo(colour, np.ascontiguousarray(mask[::2, ::2]), part)


def _affine(plane: Bytes, inverse: NDArray[np.float64], size: tuple[int, int]) -> Bytes:
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    warped = cv2.warpAffine(plane, inverse[:2], size, flags=flags, borderMode=cv2.BORDER_CONSTANT)
    return np.asarray(warped, np.uint8)


def _clipped(
    corners: NDArray[np.float64], matrix: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Return the polygon's pixels (N, 2), cut where it comes too near the camera; None if gone."""
    points = np.concatenate([corners, np.ones((len(corners), 1))], 1) @ matrix.T
    kept: list[NDArray[np.float64]] = []
    for i, here in enumerate(points):
        before = points[i - 1]
        if (here[2] > _NEAR_M) != (before[2] > _NEAR_M):
            t = (_NEAR_M - before[2]) / (here[2] - before[2])
            kept.append(before + t * (here - before))
        if here[2] > _NEAR_M:
            kept.append(here)
    if len(kept) < 3:
        return None
    seen = np.array(kept)
    return seen[:, :2] / seen[:, 2:]


def _area(corners: NDArray[np.float64]) -> float:
    """Return the area of a polygon in pixels, positive when clockwise as seen."""
    x, y = corners.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _cover(
    levels: tuple[Bytes, ...],
    matrix: NDArray[np.float64],
    corners: NDArray[np.float64],
    plane: Bytes,
    gain: float,
    lift: float,
) -> None:
    """Draw a texture into the polygon of a plane; `matrix` maps (u, v, 1) to its pixels."""
    low, high = np.floor(corners.min(axis=0)), np.ceil(corners.max(axis=0)) + 1
    x0, y0 = (max(0, int(v)) for v in low)
    x1, y1 = min(plane.shape[1], int(high[0])), min(plane.shape[0], int(high[1]))
    if x1 <= x0 or y1 <= y0:
        return
    shrink = levels[0].shape[0] * levels[0].shape[1] / max(_area(corners), 1.0)
    texture = levels[int(np.clip(0.5 * math.log2(max(shrink, 1)), 0, len(levels) - 1))]
    h, w = texture.shape[:2]
    to_texture = np.array([[w, 0, -0.5], [0, h, -0.5], [0, 0, 1]])
    shift = np.array([[1.0, 0, x0], [0, 1, y0], [0, 0, 1]])
    part = cv2.warpPerspective(
        texture,
        to_texture @ np.linalg.inv(matrix) @ shift,
        (x1 - x0, y1 - y0),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    if gain < 0.97:
        part = cv2.convertScaleAbs(part, alpha=gain, beta=lift)
    mask = np.zeros((y1 - y0, x1 - x0), np.uint8)
    fixed = np.round(np.clip(corners - [x0, y0], -30000, 30000) * 16).astype(np.int32)
    cv2.fillPoly(mask, [fixed], 255, 8, 4)
    cv2.copyTo(part, mask, plane[y0:y1, x0:x1])
