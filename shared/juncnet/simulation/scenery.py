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
_SMALL_PX = 320
"""Sprites up to this size are kept after scaling and reused."""
_KEPT_BYTES = 24_000_000
_PLAIN_PX = 300.0
"""Faces that cover fewer pixels are drawn without texture."""
_PLAIN_CHROMA_PX = 6000.0
"""Faces that cover fewer pixels have one colour, only their brightness is textured."""
_SIZE = 512
_Scaled = tuple[Bytes, Bytes, Bytes, Bytes, int]


class Scenery:
    """The trees, buildings and cars of a world, ready to draw."""

    def __init__(self, world: World, palette: Palette, light: Light, haze: tuple[int, ...]) -> None:
        self._haze = haze
        self._rate = -math.log(max(1 - world.style.haze, 1e-3)) / 200.0
        kinds = draw_sprites(palette, light, world.seed)
        self._sprites = [_choose(tree, kinds, palette.conifers) for tree in world.trees]
        self._tints = [0.86 + 0.28 * (tree.seed * 7919 % 97) / 96 for tree in world.trees]
        self._feet = np.array([(t.x_m, t.y_m, 0.0, 1.0) for t in world.trees], np.float64).reshape(
            -1, 4
        )
        self._heights = np.array([t.height_m for t in world.trees], np.float64)
        self._solids = [solid(box, world.style, light, world.seed) for box in world.boxes]
        places = [(t.x_m, t.y_m, t.radius_m) for t in world.trees]
        places += [(s.x_m, s.y_m, s.radius_m) for s in self._solids]
        self._places = np.array(places, np.float64).reshape(-1, 3)
        self._scaled: OrderedDict[tuple[int, ...], _Scaled] = OrderedDict()
        self._bytes = 0

    def draw(self, view: View, luma: Bytes, chroma: Bytes) -> None:
        """Draw everything seen from `view` into luminance (H, W) and chroma (H/2, W/2, 2)."""
        feet = self._feet @ view.projection.T
        tops = feet + self._heights[:, None] * view.projection[:, 2]
        count = len(feet)
        for index, distance in self._visible(view):
            kept = math.exp(-self._rate * distance)
            if index < count:
                self._draw_tree(index, view, kept, (feet[index], tops[index]), luma, chroma)
            else:
                self._draw_solid(self._solids[index - count], view, kept, luma, chroma)

    def _visible(self, view: View) -> list[tuple[int, float]]:
        """Return (index, distance) of what may be seen, farthest first."""
        offset = self._places[:, :2] - view.position[:2]
        radius = self._places[:, 2]
        s, c = math.sin(view.yaw_rad), math.cos(view.yaw_rad)
        ahead = offset[:, 0] * c + offset[:, 1] * s
        aside = np.abs(-offset[:, 0] * s + offset[:, 1] * c)
        # Half the view's width, a little more for the tilted axis.
        spread = 0.55 * view.width / view.focal_px
        distance = np.hypot(ahead, aside)
        seen = (ahead > -radius) & (aside < ahead * spread + 2 * radius + 1) & (distance < _FAR_M)
        chosen = np.flatnonzero(seen)
        order = chosen[np.argsort(-distance[chosen], kind="stable")]
        return [(int(i), float(distance[i])) for i in order]

    def _draw_tree(
        self,
        index: int,
        view: View,
        kept: float,
        ends: tuple[NDArray[np.float64], NDArray[np.float64]],
        luma: Bytes,
        chroma: Bytes,
    ) -> None:
        """Draw a tree between its foot and top in homogeneous pixels, `ends`."""
        x0, y0, depth0 = ends[0].tolist()
        x1, y1, depth1 = ends[1].tolist()
        radius = float(self._places[index, 2])
        if min(depth0, depth1) < max(_NEAR_M, 0.6 * radius):
            return
        x0, y0, x1, y1 = x0 / depth0, y0 / depth0, x1 / depth1, y1 / depth1
        wide = 4 * radius * view.focal_px / (depth0 + depth1)
        high = math.hypot(x0 - x1, y0 - y1)
        if min(x0, x1) - wide > view.width or max(x0, x1) + wide < 0 or y0 < 0:
            return
        sprite, gain, lift = self._sprites[index], kept * self._tints[index], 1 - kept
        lift *= self._haze[0]
        if max(wide, high) <= _SMALL_PX:
            _paste(
                self._small(sprite, (wide, high), (x1 - x0) / high, gain, lift),
                (x0, y0),
                luma,
                chroma,
            )
            return
        c, s = math.cos(view.roll_px_rad), math.sin(view.roll_px_rad)
        frame = np.array([[c * wide, x0 - x1, x0], [-s * wide, y0 - y1, y0]])
        _stamp(sprite, frame, gain, lift, luma, chroma)

    def _small(
        self, sprite: Sprite, size: tuple[float, float], lean: float, gain: float, lift: float
    ) -> _Scaled:
        """Return a sprite of about that size in pixels, kept for the next picture.

        `lean` is how far its top is to the right of its foot, as a part of its height.
        """
        wide, high = (max(2, round(_quantised(v))) for v in size)
        tilt = round(lean * 24)
        key = (id(sprite), wide, high, tilt, round(gain * 24), round(lift / 6))
        found = self._scaled.get(key)
        if found is None:
            shear = tilt / 24 * high
            left = 2 * math.ceil((wide / 2 + max(0.0, -shear)) / 2)
            width = left + 2 * math.ceil((wide / 2 + max(0.0, shear)) / 2)
            height = 2 * math.ceil(high / 2)
            frame = np.array([[wide, -shear, left - 0.5], [0, high, height - 0.5]])
            luma, chroma, mask, small = _drawn(sprite, frame, (0, 0), (width, height))
            bright = cv2.convertScaleAbs(luma, alpha=round(gain * 24) / 24, beta=lift)
            found = (np.asarray(bright, np.uint8), chroma, mask, small, left)
            self._scaled[key] = found
            self._bytes += 5 * width * height // 2
            while self._bytes > _KEPT_BYTES:
                old = self._scaled.popitem(last=False)[1]
                self._bytes -= 5 * old[0].size // 2
        return found

    def _draw_solid(self, body: Solid, view: View, kept: float, luma: Bytes, chroma: Bytes) -> None:
        half = view.half()
        seen: list[tuple[float, Face, NDArray[np.float64]]] = []
        x, y, z = view.position.tolist()
        for face in body.faces:
            nx, ny, nz, offset = face.plane
            if nx * x + ny * y + nz * z <= offset:
                continue
            matrix = view.projection @ face.to_world
            corners = _clipped(face.corners, matrix)
            if corners is not None:
                u, v = face.middle
                depth = float(matrix[2, 0] * u + matrix[2, 1] * v + matrix[2, 2])
                seen.append((depth, face, corners))
        seen.sort(key=lambda item: -item[0])
        lift = (1 - kept) * self._haze[0]
        for _, face, corners in seen:
            if _area(corners) < _PLAIN_PX:
                _flat_face(face, corners, kept, lift, luma, chroma)
                continue
            matrix = view.projection @ face.to_world
            _cover(face.luma, matrix, corners, luma, kept, lift)
            if _area(corners) < _PLAIN_CHROMA_PX:
                _flat_chroma(face, corners, kept, chroma)
                continue
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
    return np.asarray(cv2.inRange(mask, 111, 255), np.uint8)


def _paste(scaled: _Scaled, foot: tuple[float, float], luma: Bytes, chroma: Bytes) -> None:
    """Copy a scaled sprite with its foot at a pixel, cut at the picture's edges."""
    bright, colour, mask, small, middle = scaled
    left, top = round(foot[0] + 0.5) - middle, round(foot[1] + 0.5) - bright.shape[0]
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
    corners = frame @ np.array([[-0.5, 0.5, 0.5, -0.5], [-1, -1, 0, 0], [1, 1, 1, 1]])
    x0, y0 = (max(0, 2 * math.floor(v / 2)) for v in corners.min(axis=1).tolist())
    x1 = min(luma.shape[1], 2 * math.ceil(corners[0].max() / 2))
    y1 = min(luma.shape[0], 2 * math.ceil(corners[1].max() / 2))
    if x1 <= x0 or y1 <= y0:
        return
    size = (x1 - x0, y1 - y0)
    bright, colour, mask, small = _drawn(sprite, frame, (x0, y0), size)
    bright = cv2.convertScaleAbs(bright, alpha=gain, beta=lift)
    cv2.copyTo(bright, mask, luma[y0:y1, x0:x1])
    cv2.copyTo(colour, small, chroma[y0 // 2 : y1 // 2, x0 // 2 : x1 // 2])


def _drawn(
    sprite: Sprite, frame: NDArray[np.float64], origin: tuple[int, int], size: tuple[int, int]
) -> tuple[Bytes, Bytes, Bytes, Bytes]:
    """Return luminance, chroma, and both masks of the part of a picture that a sprite covers.

    `origin` and `size` are even. Where the sprite is enlarged, it is drawn small and grown.
    """
    wide, high = math.hypot(*frame[:, 0].tolist()), math.hypot(*frame[:, 1].tolist())
    level = min(max(int(math.log2(512 / max(wide, high)) + 0.3), 0), len(sprite.luma) - 1)
    side = sprite.luma[level].shape[0]
    # Sprite pixel -> unit square with the foot at its origin -> picture pixel, then inverted.
    unit = np.array([[1 / side, 0, 0.5 / side - 0.5], [0, 1 / side, 0.5 / side - 1], [0, 0, 1]])
    forward = np.concatenate([frame @ unit, [[0, 0, 1]]])
    shift = np.array([[1.0, 0, origin[0]], [0, 1, origin[1]], [0, 0, 1]])
    inverse = np.linalg.inv(forward) @ shift
    halved = inverse @ np.array([[2.0, 0, 0.5], [0, 2, 0.5], [0, 0, 1]])
    half = (size[0] // 2, size[1] // 2)
    colour = _affine(sprite.chroma[level], halved, half)
    small = _affine(sprite.mask[level], halved, half)
    if max(wide, high) > 1.3 * _SIZE:
        bright = cv2.resize(_affine(sprite.luma[level], halved, half), size)
        mask = np.asarray(cv2.resize(small, size), np.uint8)
    else:
        bright = _affine(sprite.luma[level], inverse, size)
        mask = _affine(sprite.mask[level], inverse, size)
    return np.asarray(bright, np.uint8), colour, _hard(mask), _hard(small)


def _affine(plane: Bytes, inverse: NDArray[np.float64], size: tuple[int, int]) -> Bytes:
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    warped = cv2.warpAffine(plane, inverse[:2], size, flags=flags, borderMode=cv2.BORDER_CONSTANT)
    return np.asarray(warped, np.uint8)


def _clipped(
    corners: NDArray[np.float64], matrix: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Return the polygon's pixels (N, 2), cut where it comes too near the camera; None if gone."""
    points = corners @ matrix[:, :2].T + matrix[:, 2]
    depths: list[float] = points[:, 2].tolist()
    if min(depths) <= _NEAR_M:
        if max(depths) <= _NEAR_M:
            return None
        kept: list[NDArray[np.float64]] = []
        for i, here in enumerate(points):
            before = points[i - 1]
            if (here[2] > _NEAR_M) != (before[2] > _NEAR_M):
                t = (_NEAR_M - before[2]) / (here[2] - before[2])
                kept.append(before + t * (here - before))
            if here[2] > _NEAR_M:
                kept.append(here)
        points = np.array(kept)
    return points[:, :2] / points[:, 2:]


def _area(corners: NDArray[np.float64]) -> float:
    """Return the area of a polygon in pixels, positive when clockwise as seen."""
    points: list[list[float]] = corners.tolist()
    total, (x0, y0) = 0.0, points[-1]
    for x, y in points:
        total += x0 * y - x * y0
        x0, y0 = x, y
    return 0.5 * total


def _flat_face(
    face: Face,
    corners: NDArray[np.float64],
    gain: float,
    lift: float,
    luma: Bytes,
    chroma: Bytes,
) -> None:
    """Draw a face too small for its texture in its mean colour."""
    fixed = np.round(corners * 16).astype(np.int32)
    cv2.fillPoly(luma, [fixed], face.mean[0] * gain + lift, 8, 4)
    _flat_chroma(face, corners, gain, chroma)


def _flat_chroma(face: Face, corners: NDArray[np.float64], gain: float, chroma: Bytes) -> None:
    _, u, v = face.mean
    fixed = np.round(corners * 8 - 4).astype(np.int32)
    colour = (128 + (u - 128) * gain, 128 + (v - 128) * gain)
    cv2.fillPoly(chroma, [fixed], colour, 8, 4)


def _quantised(size: float) -> float:
    """Return a size rounded to steps of 1.4 per cent, so that scaled sprites are found again."""
    return math.exp(round(math.log(max(size, 1.0)) * 70) / 70)


def _cover(
    levels: tuple[Bytes, ...],
    matrix: NDArray[np.float64],
    corners: NDArray[np.float64],
    plane: Bytes,
    gain: float,
    lift: float,
) -> None:
    """Draw a texture into the polygon of a plane; `matrix` maps (u, v, 1) to its pixels."""
    (low_x, low_y), (high_x, high_y) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    x0, y0 = max(0, math.floor(low_x)), max(0, math.floor(low_y))
    x1 = min(plane.shape[1], math.ceil(high_x) + 1)
    y1 = min(plane.shape[0], math.ceil(high_y) + 1)
    if x1 <= x0 or y1 <= y0:
        return
    shrink = levels[0].shape[0] * levels[0].shape[1] / max(_area(corners), 1.0)
    texture = levels[min(int(0.5 * math.log2(max(shrink, 1))), len(levels) - 1)]
    h, w = texture.shape[:2]
    to_texture = np.array([[w, 0, -0.5], [0, h, -0.5], [0, 0, 1]])
    shift = np.array([[1.0, 0, x0], [0, 1, y0], [0, 0, 1]])
    k = 2 if _area(corners) > 6 * h * w else 1
    size = (x1 - x0, y1 - y0)
    small = np.array([[k, 0, k / 2 - 0.5], [0, k, k / 2 - 0.5], [0, 0, 1.0]])
    part = cv2.warpPerspective(
        texture,
        to_texture @ np.linalg.inv(matrix) @ shift @ small,
        (-(-size[0] // k), -(-size[1] // k)),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REPLICATE,
    )
    if k > 1:
        part = cv2.resize(part, (part.shape[1] * k, part.shape[0] * k))[: size[1], : size[0]]
    if gain < 0.97:
        part = cv2.convertScaleAbs(part, alpha=gain, beta=lift)
    mask = np.zeros((y1 - y0, x1 - x0), np.uint8)
    fixed = np.round(np.clip(corners - [x0, y0], -30000, 30000) * 16).astype(np.int32)
    cv2.fillPoly(mask, [fixed], 255, 8, 4)
    cv2.copyTo(part, mask, plane[y0:y1, x0:x1])
