"""Streets at random, as plans: what lies on the ground and what stands beside it.

Simulated worlds are villages seen by a drone that looks down. Photographs of roads are taken from
a car or the pavement, level, in towns and on motorways: rows of house fronts, parked cars, many
lanes. A plan is such a street, with a junction or with something that looks like one.
Frame: metres, x to the right, z forward along the street, heights up.
"""

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Kind = Literal["town", "suburb", "open"]
ROAD, JUNCTION, ARM = 1, 2, 3
"""Classes of the ground; 0 is everything else."""
LENGTH_M, REACH_M = 110.0, 48.0
"""How far a street goes on forward, and its surroundings to either side."""


@dataclass(frozen=True)
class Area:
    """A flat polygon on the ground, painted over those before it."""

    points: Points
    """(N, 2): x, z."""
    grey: float
    surface: int | None = None
    """New class of that ground; None: it stays what it was (paint on a road)."""


@dataclass(frozen=True)
class Front:
    """An upright rectangle: a house front, a wall, a hedge."""

    a: tuple[float, float]
    b: tuple[float, float]
    height_m: float
    texture: int
    gain: float


@dataclass(frozen=True)
class Thing:
    """Something that stands on the ground: see `juncnet.learning.street_view`."""

    kind: Literal["car", "tree", "pole", "lights", "person"]
    x_m: float
    z_m: float
    size_m: float
    grey: float
    along: bool = True
    """Whether a car stands along the street."""


@dataclass
class Street:
    """A plan: everything in it before bending."""

    kind: Kind
    bend: float
    """Curvature, 1/m."""
    half_m: float
    """Half the road's width."""
    mouth_m: float | None
    """z at which the junction begins; None: there is none."""
    cross_m: float
    """Width of the crossing road."""
    ground: float
    """Grey of the plain ground."""
    areas: list[Area] = field(default_factory=list[Area])
    fronts: list[Front] = field(default_factory=list[Front])
    things: list[Thing] = field(default_factory=list[Thing])
    shadows: list[Area] = field(default_factory=list[Area])

    def bent(self, points: Points) -> Points:
        """Return points (N, 2) where they lie when the street bends."""
        moved = points.copy()
        moved[:, 0] += 0.5 * self.bend * np.maximum(points[:, 1], 0) ** 2
        return moved


def rectangle(x0: float, z0: float, x1: float, z1: float) -> Points:
    """Return a rectangle with points every few metres, so that it bends well; (N, 2)."""
    n = max(2, math.ceil(abs(z1 - z0) / 3) + 1)
    z = np.linspace(z0, z1, n)
    left, right = np.full(n, x0), np.full(n, x1)
    return np.concatenate([np.stack([left, z], 1), np.stack([right, z], 1)[::-1]])


def draw_street(rng: np.random.Generator) -> Street:
    """Return a street drawn at random; every second one has a junction."""
    kinds: tuple[Kind, ...] = ("town", "suburb", "open")
    kind = kinds[int(rng.choice(3, p=(0.5, 0.22, 0.28)))]
    wide = kind == "open" and rng.random() < 0.6
    half = float(rng.uniform(6, 14) if wide else rng.uniform(2.6, 6.5))
    mouth = float(rng.uniform(6, 40)) if rng.random() < 0.5 else None
    bend = 0.0 if rng.random() < 0.55 else float(rng.normal(0, 0.006))
    street = Street(kind, bend, half, mouth, float(rng.uniform(5, 15)), float(rng.uniform(60, 165)))
    road, pavement = float(rng.uniform(55, 150)), float(rng.uniform(90, 185))
    walk = 0.0 if kind == "open" else float(rng.uniform(1.2, 4.5))
    arms = _arms(rng) if mouth is not None else ()
    _pave(street, rng, road, pavement, walk, arms)
    _mark(street, rng, wide, arms)
    _mislead(street, rng, road, pavement, walk)
    _build(street, rng, walk, arms)
    _furnish(street, rng, walk, arms)
    _shade(street, rng)
    return street


def _arms(rng: np.random.Generator) -> tuple[str, ...]:
    shapes = (
        ("left", "right", "ahead"),
        ("left", "ahead"),
        ("right", "ahead"),
        ("left", "right"),
    )
    return shapes[int(rng.choice(4, p=(0.4, 0.22, 0.22, 0.16)))]


def _pave(
    s: Street,
    rng: np.random.Generator,
    road: float,
    pavement: float,
    walk: float,
    arms: tuple[str, ...],
) -> None:
    """Lay pavements, the road, and the crossing road with rounded corners."""
    end = LENGTH_M if s.mouth_m is None or "ahead" in arms else s.mouth_m + s.cross_m
    if walk:
        s.areas.append(
            Area(rectangle(-s.half_m - walk, -4, s.half_m + walk, end + walk), pavement, 0)
        )
    sides = [side for side, name in ((-1, "left"), (1, "right")) if name in arms]
    if s.mouth_m is not None:
        z0, z1 = s.mouth_m, s.mouth_m + s.cross_m
        for side in sides:
            if walk:
                strip = rectangle(side * s.half_m, z0 - walk, side * REACH_M, z1 + walk)
                s.areas.append(Area(strip, pavement, 0))
    s.areas.append(Area(rectangle(-s.half_m, -4, s.half_m, end), road, ROAD))
    if s.mouth_m is None:
        return
    z0, z1 = s.mouth_m, s.mouth_m + s.cross_m
    other = road if rng.random() < 0.75 else float(rng.uniform(55, 150))
    radius = float(rng.uniform(0.5, 5))
    slant = float(rng.normal(0, 0.12))
    for side in sides:
        near, far = side * s.half_m, side * REACH_M
        drift = slant * (far - near)
        arm = np.array([[near, z0], [far, z0 + drift], [far, z1 + drift], [near, z1]])
        s.areas.append(Area(arm, other, ARM))
        for z, away in ((z0, -1), (z1, 1)):
            if away == 1 and "ahead" not in arms:
                continue
            corner = [[near, z + away * radius], [near, z], [near + side * radius, z]]
            s.areas.append(Area(np.array(corner), other, ARM))
    s.areas.append(Area(rectangle(-s.half_m, z0, s.half_m, z1), other, JUNCTION))


def _lines(s: Street, arms: tuple[str, ...]) -> list[tuple[float, float]]:
    """Return the stretches (from, to) of the street on which lines are painted."""
    if s.mouth_m is None:
        return [(-4.0, LENGTH_M)]
    before = (-4.0, s.mouth_m - 0.5)
    return [before, (s.mouth_m + s.cross_m + 0.5, LENGTH_M)] if "ahead" in arms else [before]


def _mark(s: Street, rng: np.random.Generator, wide: bool, arms: tuple[str, ...]) -> None:
    paint = float(rng.uniform(170, 245))
    broad = float(rng.uniform(0.1, 0.2))

    def line(x: float, z0: float, z1: float, dashed: bool) -> None:
        if not dashed:
            s.areas.append(Area(rectangle(x - broad / 2, z0, x + broad / 2, z1), paint))
            return
        step, length = period, period * filled
        for z in np.arange(z0 + offset, z1 - length, step):
            s.areas.append(Area(rectangle(x - broad / 2, z, x + broad / 2, z + length), paint))

    period, filled = float(rng.uniform(4, 12)), float(rng.uniform(0.25, 0.6))
    offset = float(rng.uniform(0, period))
    lanes = max(2, round(2 * s.half_m / 3.5)) if wide else 2
    plain = rng.random() < 0.3 and not wide
    edges, solid = rng.random() < (0.85 if s.kind == "open" else 0.25), rng.random() < 0.25
    for z0, z1 in _lines(s, arms):
        if not plain:
            for k in range(1, lanes):
                x = -s.half_m + 2 * s.half_m * k / lanes
                line(x, z0, z1, dashed=not (solid and k == lanes // 2))
        if edges:
            line(-s.half_m + 0.4, z0, z1, False)
            line(s.half_m - 0.4, z0, z1, False)
    if s.mouth_m is not None:
        if rng.random() < 0.45:
            _zebra(s, rng, s.mouth_m - float(rng.uniform(2.5, 4)), paint)
        if rng.random() < 0.4:
            z = s.mouth_m - 0.6
            s.areas.append(Area(rectangle(-s.half_m, z, 0 if plain else s.half_m, z + 0.4), paint))
        if rng.random() < 0.25 and "ahead" in arms:
            _zebra(s, rng, s.mouth_m + s.cross_m + 1, paint)


def _zebra(s: Street, rng: np.random.Generator, z: float, paint: float) -> None:
    deep, step = float(rng.uniform(2, 3.5)), float(rng.uniform(0.8, 1.3))
    for x in np.arange(-s.half_m + 0.2, s.half_m - 0.4, step):
        s.areas.append(Area(rectangle(x, z, x + step / 2, z + deep), paint))


def _mislead(
    s: Street, rng: np.random.Generator, road: float, pavement: float, walk: float
) -> None:
    """Add what is taken for a junction: crossings, patches, driveways, squares."""
    paint = float(rng.uniform(170, 240))
    if s.kind != "open" and s.mouth_m is None and rng.random() < 0.25:
        _zebra(s, rng, float(rng.uniform(4, 40)), paint)
    for _ in range(int(rng.integers(0, 5))):
        x, z = rng.uniform(-s.half_m, s.half_m), rng.uniform(0, 40)
        w, d = rng.uniform(0.4, 3), rng.uniform(0.5, 8)
        x1 = min(x + w, s.half_m)
        s.areas.append(Area(rectangle(x, z, x1, z + d), road * float(rng.uniform(0.75, 1.2))))
    if rng.random() < 0.4:
        for _ in range(int(rng.integers(1, 4))):
            side, z = float(rng.choice((-1, 1))), float(rng.uniform(3, 50))
            deep = float(rng.uniform(3, 14)) if rng.random() < 0.3 else 3.0
            x0, x1 = side * (s.half_m + 0.05), side * (s.half_m + walk + rng.uniform(3, 12))
            if s.mouth_m is None or z + deep < s.mouth_m - 2:
                grey = road if rng.random() < 0.3 else pavement * float(rng.uniform(0.7, 1.1))
                s.areas.append(Area(rectangle(x0, z, x1, z + min(deep, 14)), grey, 0))


def _build(s: Street, rng: np.random.Generator, walk: float, arms: tuple[str, ...]) -> None:
    """Line the street with house fronts, walls and hedges; side roads are left open."""
    if s.kind == "open":
        if rng.random() < 0.4:
            for side in (-1, 1):
                x = side * (s.half_m + float(rng.uniform(0.5, 4)))
                _row(s, rng, side, x, (0.5, 1.1), 0.02, 40.0, arms)
        return
    town = s.kind == "town"
    tall = (6, 22) if town else (3, 8)
    base = float(rng.uniform(*tall))
    for side in (-1, 1):
        back = 0.1 if town else float(rng.uniform(2, 8))
        x = side * (s.half_m + walk + back)
        if town and rng.random() < 0.1:
            continue
        gap = float(rng.uniform(0, 0.08) if town else rng.uniform(0.2, 0.6))
        _row(s, rng, side, x, (base * 0.7, base * 1.35), gap, 14.0, arms)
        if not town and rng.random() < 0.6:
            _row(s, rng, side, side * (s.half_m + walk + 0.1), (0.5, 2), 0.3, 16.0, arms)
    if s.mouth_m is not None and "ahead" not in arms and town:
        z = s.mouth_m + s.cross_m + walk
        for x in np.arange(-REACH_M, REACH_M, 11.0):
            front = Front((x, z), (x + 11.0, z), base * float(rng.uniform(0.7, 1.3)), *_look(rng))
            s.fronts.append(front)


def _look(rng: np.random.Generator) -> tuple[int, float]:
    return int(rng.integers(1 << 20)), float(rng.uniform(0.5, 1.3))


def _row(
    s: Street,
    rng: np.random.Generator,
    side: int,
    x: float,
    heights: tuple[float, float],
    gap: float,
    longest: float,
    arms: tuple[str, ...],
) -> None:
    """Put a row of fronts along the street at `x`, and around the corners of side roads."""
    name = "left" if side < 0 else "right"
    cut: tuple[float, float] | None = None
    if s.mouth_m is not None and name in arms:
        margin = abs(x) - s.half_m
        cut = (s.mouth_m - margin, s.mouth_m + s.cross_m + margin)
    end = LENGTH_M if s.mouth_m is None or "ahead" in arms else s.mouth_m
    z = -3.0
    while z < end:
        z1 = z + float(rng.uniform(0.4, 1.0)) * longest
        low, high = z, min(z1, end)
        z = z1 + (float(rng.uniform(1, 8)) if rng.random() < gap else 0.0)
        if cut is not None and high > cut[0] and low < cut[1]:
            low, high = (low, cut[0]) if low < cut[0] else (cut[1], high)
        if high - low < 1:
            continue
        s.fronts.append(Front((x, low), (x, high), float(rng.uniform(*heights)), *_look(rng)))
    if cut is not None:
        for corner in cut:
            for k in range(3):
                x0, x1 = x + side * 10.0 * k, x + side * 10.0 * (k + 1)
                height = float(rng.uniform(*heights))
                s.fronts.append(Front((x0, corner), (x1, corner), height, *_look(rng)))


def _furnish(s: Street, rng: np.random.Generator, walk: float, arms: tuple[str, ...]) -> None:
    """Add cars, parked and driving, trees, poles, people, traffic lights."""
    parked = 0.0 if s.kind == "open" else float(rng.choice((0.0, 0.3, 0.8)))
    for side in (-1, 1):
        for z in np.arange(float(rng.uniform(0, 6)), 70, 5.6):
            near = s.mouth_m is not None and s.mouth_m - 5 < z < s.mouth_m + s.cross_m + 5
            if not near and rng.random() < parked:
                grey = float(rng.uniform(20, 220))
                s.things.append(Thing("car", side * (s.half_m - 1.0), z, 4.2, grey))
    for _ in range(int(rng.integers(0, 5))):
        x = float(rng.uniform(-s.half_m + 1.2, s.half_m - 1.2))
        z, grey = float(rng.uniform(7, 70)), float(rng.uniform(20, 220))
        s.things.append(Thing("car", x, z, float(rng.choice((4.2, 4.2, 4.6, 9.0))), grey))
    if s.mouth_m is not None and rng.random() < 0.4:
        x, z = float(rng.uniform(-25, 25)), s.mouth_m + s.cross_m * float(rng.uniform(0.2, 0.8))
        if "ahead" in arms or abs(x) > s.half_m:
            s.things.append(Thing("car", x, z, 4.3, float(rng.uniform(20, 220)), False))
    trees = float(rng.choice((0.0, 0.1, 0.4))) if s.kind == "town" else float(rng.uniform(0, 0.6))
    for z in np.arange(2.0, 90.0, 5.0):
        for side in (-1, 1):
            crossing = s.mouth_m is not None and s.mouth_m - 2 < z < s.mouth_m + s.cross_m + 2
            aside = side * (s.half_m + (0.8 if walk else float(rng.uniform(2, 25))))
            if rng.random() < trees and not crossing:
                size = float(rng.uniform(3, 9))
                s.things.append(Thing("tree", aside, z, size, float(rng.uniform(25, 110))))
            if rng.random() < 0.08:
                s.things.append(Thing("pole", aside, z, float(rng.uniform(3, 9)), 60.0))
            if s.kind == "town" and rng.random() < 0.12:
                s.things.append(Thing("person", aside, z, 1.7, float(rng.uniform(15, 160))))
    if s.mouth_m is not None and rng.random() < 0.35:
        for x, z in ((s.half_m + 0.7, s.mouth_m - 1), (-s.half_m - 0.7, s.mouth_m + s.cross_m + 1)):
            s.things.append(Thing("lights", x, z, 3.2, 30.0))


def _shade(s: Street, rng: np.random.Generator) -> None:
    """Add shadows: of a row of houses, and some across the road."""
    dark = float(rng.uniform(0.35, 0.8))
    if s.kind != "open" and rng.random() < 0.35:
        side = float(rng.choice((-1, 1)))
        reach = float(rng.uniform(-s.half_m, s.half_m))
        s.shadows.append(Area(rectangle(side * REACH_M, -4, side * reach, LENGTH_M), dark))
    if rng.random() < 0.3:
        for _ in range(int(rng.integers(1, 5))):
            z, deep, slant = rng.uniform(1, 40), rng.uniform(0.5, 6), rng.normal(0, 4)
            band = [[-REACH_M, z - slant], [REACH_M, z + slant]]
            back = [[REACH_M, z + slant + deep], [-REACH_M, z - slant + deep]]
            s.shadows.append(Area(np.array(band + back), dark))
