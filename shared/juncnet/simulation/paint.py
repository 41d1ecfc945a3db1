"""Paints roads, markings, kerbs, paths, patches and shadows of a world onto a canvas."""

import math
from dataclasses import replace

import cv2
import numpy as np

from juncnet.simulation.canvas import Canvas, Points, blob, disc, offset_line, resample, strip
from juncnet.simulation.materials import Material, smooth_noise
from juncnet.simulation.mouths import RANK, Arm, arms_at, corner
from juncnet.simulation.palettes import Colour, Palette, lit, yuv, yuv_planes
from juncnet.simulation.world import Road, World

_MATERIAL: dict[str, Material] = {
    "asphalt": "asphalt",
    "concrete": "concrete",
    "cobble": "cobble",
    "gravel": "gravel",
    "dirt": "dirt",
}
_PAVEMENT_M = 1.9
_CORNER_M = 2.5


def vegetation(canvas: Canvas, palette: Palette, rng: np.random.Generator) -> None:
    """Cover everything with the palette's vegetation, varied over metres and tens of metres."""
    height, width = canvas.size
    step = max(1, round(0.4 / canvas.metres_per_px))
    rows, cols = height // step + 2, width // step + 2
    metre = 1 / (step * canvas.metres_per_px)
    mix = 0.5 + 0.22 * smooth_noise(rows, cols, 18 * metre, rng)
    mix += 0.16 * smooth_noise(rows, cols, 5 * metre, rng)
    mix += 0.12 * smooth_noise(rows, cols, 1.2 * metre, rng)
    bare = 0.6 * smooth_noise(rows, cols, 9 * metre, rng)
    bare += 0.4 * smooth_noise(rows, cols, 1.6 * metre, rng)
    bare = np.clip((bare - 1.1 + 2.2 * palette.bareness) * 2, 0, 1) * 0.85
    mix = np.clip(mix, -0.2, 1.2)[..., None]
    a, b, soil = (
        np.array(lit(c, canvas.light), np.float32)
        for c in (palette.grass, palette.grass_other, palette.soil)
    )
    picture = (a + (b - a) * mix) * (1 - bare[..., None]) + soil * bare[..., None]
    picture *= 1 + 0.07 * smooth_noise(rows, cols, 2.5 * metre, rng)[..., None]
    planes = [np.clip(p, 16, 240).astype(np.uint8) for p in yuv_planes(picture)]
    for plane, target in zip(planes, (canvas.luma, canvas.blue, canvas.red), strict=True):
        big = (
            (cols * step, rows * step)
            if target is canvas.luma
            else (
                cols * step // 2,
                rows * step // 2,
            )
        )
        grown = cv2.resize(plane, big, interpolation=cv2.INTER_LINEAR)
        target[:] = grown[: target.shape[0], : target.shape[1]]


def roads(canvas: Canvas, world: World, palette: Palette, rng: np.random.Generator) -> None:
    """Paint side paths, then all roads with their verges, kerbs, wear and markings."""
    for path in world.paths:
        _ribbon(canvas, path.centre, path.width_m, 0.12, palette, path.surface, rng)
        if path.surface == "dirt":
            _wheel_tracks(canvas, path.centre, path.width_m, rng)
    ordered = sorted(world.roads.values(), key=lambda r: (RANK[r.surface], r.id))
    arms = {node: arms_at(world, node) for node in world.nodes}
    _verges(canvas, ordered, arms, palette, rng)
    for road in ordered:
        rough = {"dirt": 0.16, "gravel": 0.12}.get(road.surface, 0.02)
        _ribbon(canvas, road.centre, road.width_m, rough, palette, road.surface, rng)
    for node_arms in arms.values():
        _junction_surface(canvas, node_arms, palette)
    for road in ordered:
        _wear(canvas, _between_mouths(road, arms), palette, rng)
    for road in ordered:
        _markings(canvas, road, arms, palette)
    for node, node_arms in arms.items():
        if world.is_junction(node):
            _mouth_markings(canvas, node_arms, palette)


def _ribbon(
    canvas: Canvas,
    line: Points,
    width_m: float,
    rough_m: float,
    palette: Palette,
    surface: str,
    rng: np.random.Generator,
) -> None:
    centre = resample(line, 0.6)
    left, right = (
        offset_line(centre, side * (width_m / 2 + rough_m * _wander(len(centre), rng)))
        for side in (1, -1)
    )
    colour = palette.surface(surface)  # pyright: ignore[reportArgumentType] (a Surface)
    for polygon in strip(left, right):
        canvas.fill(polygon, colour, _MATERIAL[surface])


def _wander(count: int, rng: np.random.Generator) -> Points:
    raw = rng.standard_normal(count + 8)
    return np.convolve(raw, np.ones(3) / 3, "same")[4 : 4 + count] * 1.2


def _verges(
    canvas: Canvas,
    ordered: list[Road],
    arms: dict[int, list[Arm]],
    palette: Palette,
    rng: np.random.Generator,
) -> None:
    for road in ordered:
        if road.surface in ("dirt", "gravel"):
            centre = resample(road.centre, 0.6)
            for side in (1, -1):
                inner = side * (road.width_m / 2 - 0.1)
                outer = side * (road.width_m / 2 + 0.5 + 0.2 * _wander(len(centre), rng))
                for area in strip(offset_line(centre, outer), offset_line(centre, inner)):
                    canvas.fill(area, palette.grass, "grass", 0.8)
    layers: tuple[tuple[float, Colour, Material], ...] = (
        (_PAVEMENT_M, palette.pavement, "slabs"),
        (0.16, palette.kerb, "plain"),
    )
    for road in ordered:
        if not road.kerb and road.surface in ("asphalt", "concrete", "cobble"):
            centre = resample(road.centre, 0.6)
            edges = [
                offset_line(centre, s * (road.width_m / 2 + 0.3 + 0.15 * _wander(len(centre), rng)))
                for s in (1, -1)
            ]
            for polygon in strip(edges[0], edges[1]):
                canvas.fill(polygon, palette.gravel, "gravel", 0.85)
    for extra, colour, material in layers:
        for road in ordered:
            if road.kerb:
                centre = resample(road.centre, 0.6)
                half = road.width_m / 2 + extra
                for polygon in strip(offset_line(centre, half), offset_line(centre, -half)):
                    canvas.fill(polygon, colour, material)
        for node_arms in arms.values():
            for area in _corners(node_arms, extra, kerbed=True):
                canvas.fill(area, colour, material)


def _corners(arms: list[Arm], widen_m: float, kerbed: bool = False) -> list[Points]:
    if len(arms) < 2:
        return []
    pairs = zip(arms, arms[1:] + arms[:1], strict=True)
    areas = [
        corner(first, second, _CORNER_M, widen_m)
        for first, second in pairs
        if not kerbed or (first.road.kerb and second.road.kerb)
    ]
    return [area for area in areas if area is not None]


def _junction_surface(canvas: Canvas, arms: list[Arm], palette: Palette) -> None:
    if len(arms) < 2:
        return
    best = max(arms, key=lambda arm: (RANK[arm.road.surface], arm.road.width_m))
    colour, material = palette.surface(best.road.surface), _MATERIAL[best.road.surface]
    for area in junction_areas(arms):
        canvas.fill(area, colour, material)


def junction_areas(arms: list[Arm]) -> list[Points]:
    """Return polygons that cover the surface where two or more arms meet."""
    x, y = arms[0].outward[0]
    areas = [*_corners(arms, 0.0), disc(x, y, min(a.road.width_m for a in arms) / 2)]
    if len(arms) > 2:
        for arm in arms:
            head = arm.outward[: max(2, round(arm.mouth_m / 0.25) + 2)]
            half = arm.road.width_m / 2
            areas += strip(offset_line(head, half), offset_line(head, -half))
    return areas


def _wheel_tracks(canvas: Canvas, line: Points, width_m: float, rng: np.random.Generator) -> None:
    centre = resample(line, 0.8)
    for side in (1, -1):
        offset = side * min(0.75, width_m / 4) + 0.12 * _wander(len(centre), rng)
        wide = 0.22 + 0.06 * _wander(len(centre), rng)
        for polygon in strip(
            offset_line(centre, offset + wide), offset_line(centre, offset - wide)
        ):
            canvas.shade_fill(polygon, -20)


def _wear(canvas: Canvas, road: Road, palette: Palette, rng: np.random.Generator) -> None:
    """Paint tyre tracks, cracks, repairs and joints of a road."""
    centre = resample(road.centre, 0.8)
    if road.surface in ("dirt", "gravel"):
        _wheel_tracks(canvas, road.centre, road.width_m, rng)
        _middle_strip(canvas, road, palette, rng)
        return
    for lane in (-0.25, 0.25):
        for track in (-0.75, 0.75):
            middle = lane * road.width_m + track + 0.08 * _wander(len(centre), rng)
            for polygon in strip(
                offset_line(centre, middle + 0.3), offset_line(centre, middle - 0.3)
            ):
                canvas.shade_fill(polygon, -7)
    base = lit(palette.surface(road.surface), canvas.light)
    level = yuv(base)[0]
    dark = int(16 + 0.74 * (level - 16))
    length = 0.8 * len(centre)
    if road.surface == "concrete":
        for i in range(0, len(centre) - 1, 6):
            half = road.width_m / 2 - 0.1
            joint = np.stack([offset_line(centre, half)[i], offset_line(centre, -half)[i]])
            canvas.line(joint, dark)
        canvas.line(centre, dark)
    if road.surface == "asphalt":
        for _ in range(rng.poisson(length * 0.1)):
            canvas.line(_crack(centre, road.width_m, rng), dark)
        for _ in range(rng.poisson(length * 0.02)):
            _repair(canvas, centre, road, palette, rng)


def _between_mouths(road: Road, arms: dict[int, list[Arm]]) -> Road:
    """Return the road without the ends that belong to junctions, where its wear is not seen."""
    start, end = (
        next((arm.mouth_m for arm in arms[node] if arm.road.id == road.id), 0.0)
        if len(arms[node]) > 2
        else 0.0
        for node in (road.a, road.b)
    )
    centre = resample(road.centre, 0.25)
    part = centre[round(start / 0.25) : len(centre) - round(end / 0.25)]
    return replace(road, centre=part) if len(part) >= 24 else road


def _crack(centre: Points, width_m: float, rng: np.random.Generator) -> Points:
    i = int(rng.integers(len(centre)))
    start = centre[i] + rng.uniform(-0.45, 0.45) * width_m * rng.uniform(-1, 1, 2)
    heading = rng.uniform(0, 2 * math.pi) + np.cumsum(rng.normal(0, 0.5, 10))
    steps = 0.25 * np.stack([np.cos(heading), np.sin(heading)], 1)
    points = start + np.cumsum(steps, axis=0)
    near = np.hypot(*(points[:, None] - centre[None]).transpose(2, 0, 1)).min(axis=1)
    return points[: max(2, int((near < width_m / 2 - 0.1).sum()))]


def _repair(
    canvas: Canvas, centre: Points, road: Road, palette: Palette, rng: np.random.Generator
) -> None:
    i = int(rng.integers(0, max(1, len(centre) - 5)))
    part = centre[i : i + int(rng.integers(2, 5))]
    if len(part) < 2:
        return
    middle = rng.uniform(-0.3, 0.3) * road.width_m
    half = min(rng.uniform(0.3, 0.8), road.width_m / 2 - abs(middle) - 0.1)
    shade = float(rng.choice([0.72, 0.8, 1.12]))
    area = np.concatenate(
        [offset_line(part, middle + half), offset_line(part, middle - half)[::-1]]
    )
    canvas.fill(area, palette.surface(road.surface), _MATERIAL[road.surface], shade)


def _middle_strip(canvas: Canvas, road: Road, palette: Palette, rng: np.random.Generator) -> None:
    """Let tufts of grass grow between the wheel tracks and at the edges of an unmade road."""
    centre = resample(road.centre, 0.5)
    share = 0.5 if road.surface == "dirt" else 0.12
    for i in range(4, len(centre) - 4):
        for offset in (0.0, -road.width_m / 2, road.width_m / 2):
            if rng.random() > share:
                continue
            x, y = offset_line(centre[i - 1 : i + 2], offset + rng.normal(0, 0.13))[1]
            tuft = blob(float(x), float(y), float(rng.uniform(0.12, 0.38)), rng, 0.5)
            canvas.fill(tuft, palette.grass, "grass", float(rng.uniform(0.85, 1.15)))


def _markings(canvas: Canvas, road: Road, arms: dict[int, list[Arm]], palette: Palette) -> None:
    if road.marking == "none":
        return
    start, end = (_clear(arms[node], road) for node in (road.a, road.b))
    centre = resample(road.centre, 0.25)
    count = len(centre)
    first, last = round(start / 0.25), count - round(end / 0.25)
    if last - first < 8:
        return
    centre = centre[first:last]
    if road.marking in ("centre_dashed", "full"):
        for i in range(4, len(centre) - 8, 24):
            _stroke(canvas, centre[i : i + 13], 0.0, 0.12, palette)
    if road.marking == "centre_solid":
        _stroke(canvas, centre, 0.0, 0.12, palette)
    if road.marking in ("edges", "full"):
        for side in (-1, 1):
            _stroke(canvas, centre, side * (road.width_m / 2 - 0.25), 0.12, palette)


def _stroke(canvas: Canvas, part: Points, offset: float, width_m: float, palette: Palette) -> None:
    left, right = offset_line(part, offset + width_m / 2), offset_line(part, offset - width_m / 2)
    for polygon in strip(left, right, 16):
        canvas.fill(polygon, palette.paint, None)


def _clear(arms: list[Arm], road: Road) -> float:
    """Return how long the end of a road is without markings: nothing at bends and dead ends."""
    if len(arms) < 3:
        return 0.0
    arm = next(arm for arm in arms if arm.road.id == road.id)
    return arm.mouth_m + (4.4 if _crossing(arm) == "zebra" else 1.7)


def _crossing(arm: Arm) -> str:
    """Return what is painted across a mouth: "zebra", "stop", "yield" or nothing."""
    road = arm.road
    if road.marking == "none" or road.surface not in ("asphalt", "concrete"):
        return ""
    x, y = arm.outward[0].tolist()
    kind = (round(abs(float(x)) * 7 + abs(float(y)) * 3) + road.id * 3) % 4
    kinds = ["zebra" if road.kerb else "stop", "stop", "yield", ""]
    return kinds[kind]


def _mouth_markings(canvas: Canvas, arms: list[Arm], palette: Palette) -> None:
    """Paint zebra crossings, stop lines and give-way lines; at some mouths none."""
    for arm in arms:
        head = arm.outward[round((arm.mouth_m + 1.0) / 0.25) :]
        kind = _crossing(arm)
        if not kind or len(head) < 16:
            continue
        half = arm.road.width_m / 2 - 0.35
        if kind == "zebra":
            count = int((2 * half + 0.45) / 0.9)
            for k in range(count):
                _stroke(canvas, head[1:12], 0.9 * (k - (count - 1) / 2), 0.45, palette)
        elif kind == "stop":
            _stroke(canvas, head[0:3], half / 2, half - 0.1, palette)
        else:
            for k in range(int(half / 0.7)):
                _stroke(canvas, head[0:3], 0.5 + 0.7 * k, 0.4, palette)
