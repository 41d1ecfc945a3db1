"""What stands and lies beside the roads of a random town: paths, houses, cars, trees, patches."""

import math
from dataclasses import dataclass

import numpy as np

from juncnet.simulation.roads import Points, RoadNetwork, resample
from juncnet.simulation.world import Box, Patch, SidePath, Surface, Tree

_SEEDS: int = 2**31
CAR_CLEARANCE_M = 2.0
"""Parked cars leave this much free on both sides of a centre line."""
CAR_NODE_M = 16.0
"""Parked cars keep this far from the ends of roads."""
_CAR_COLOURS = ((40, 40, 45), (225, 225, 225), (150, 150, 155), (35, 30, 150), (130, 70, 25))
_WALL_COLOURS = ((150, 180, 205), (120, 135, 190), (185, 190, 195), (90, 110, 150), (205, 215, 220))


@dataclass(frozen=True)
class Density:
    """How much of everything a town has, on its whole area."""

    paths: int = 8
    houses: int = 26
    cars: int = 12
    trees: int = 130
    patches: int = 30
    mud: float = 0.35
    """Share of the patches that are mud; the others are puddles and repairs."""


@dataclass(frozen=True)
class Roadside:
    """Everything of a world but its roads."""

    paths: tuple[SidePath, ...]
    boxes: tuple[Box, ...]
    trees: tuple[Tree, ...]
    patches: tuple[Patch, ...]


def furnish(rng: np.random.Generator, network: RoadNetwork, density: Density) -> Roadside:
    """Return what stands around the roads of `network`; nothing of it in the way of a robot."""
    paths = _paths(rng, network, density.paths)
    houses = _houses(rng, network, density.houses, paths)
    cars = _cars(rng, network, density.cars, paths)
    trees = _trees(rng, network, density.trees, paths, houses)
    return Roadside(paths, houses + cars, trees, _patches(rng, network, density))


def box_corners(box: Box) -> Points:
    """Return the corners of a box's ground plan, (4, 2) metres, counter-clockwise."""
    c, s = math.cos(box.yaw_rad), math.sin(box.yaw_rad)
    along, across = np.array([c, s]) * box.length_m / 2, np.array([-s, c]) * box.width_m / 2
    centre = np.array([box.x_m, box.y_m])
    corners = [centre + along + across, centre - along + across, centre - along - across]
    return np.array([*corners, centre + along - across])


def _beside(
    rng: np.random.Generator, network: RoadNetwork, margin_m: float
) -> tuple[float, Points, float, int]:
    """Return a place `margin_m` from a road's ends: half width, point, heading, side (+-1)."""
    ids = sorted(r for r, length in network.lengths.items() if length > 2 * margin_m + 1.0)
    road = network.world.roads[ids[int(rng.integers(len(ids)))]]
    share = rng.uniform(margin_m, network.lengths[road.id] - margin_m) / network.lengths[road.id]
    index = int(share * (len(road.centre) - 2))
    step = road.centre[index + 1] - road.centre[index]
    side = 1 if rng.random() < 0.5 else -1
    return road.width_m / 2, road.centre[index], math.atan2(step[1], step[0]), side


def _left(heading: float) -> Points:
    return np.array([-math.sin(heading), math.cos(heading)])


def _metres(point: Points) -> tuple[float, float]:
    return float(point[0]), float(point[1])


def _paths(rng: np.random.Generator, network: RoadNetwork, count: int) -> tuple[SidePath, ...]:
    made: list[SidePath] = []
    surfaces: tuple[Surface, ...] = ("dirt", "gravel", "concrete")
    for _ in range(3 * count):
        if len(made) == count:
            break
        half, point, heading, side = _beside(rng, network, 17.0)
        leaving = heading + side * (math.pi / 2 + rng.uniform(-0.5, 0.5))
        along = np.array([math.cos(leaving), math.sin(leaving)])
        begin = point + side * (half - 0.4) * _left(heading)
        length, sway = rng.uniform(7.0, 16.0), rng.uniform(-1.5, 1.5)
        t = np.linspace(0, 1, 40)[:, None]
        centre = resample(begin + t * length * along + np.sin(t * math.pi) * sway * _left(leaving))
        away = network.nearest(centre[len(centre) // 3 :])
        apart = min((float(np.hypot(*(p.centre[0] - begin))) for p in made), default=math.inf)
        if float(np.min(away.edge_m)) < 1.0 or apart < 10.0:
            continue
        width = round(float(rng.uniform(1.1, 2.1)), 2)
        made.append(SidePath(centre, width, surfaces[int(rng.integers(3))]))
    return tuple(made)


def _free_of_paths(points: Points, paths: tuple[SidePath, ...], clearance_m: float) -> bool:
    for path in paths:
        apart = points[:, None, :] - path.centre[None, ::3, :]
        if float(np.min(np.hypot(apart[..., 0], apart[..., 1]))) < clearance_m:
            return False
    return True


def _houses(
    rng: np.random.Generator, network: RoadNetwork, count: int, paths: tuple[SidePath, ...]
) -> tuple[Box, ...]:
    made: list[Box] = []
    for _ in range(3 * count):
        if len(made) == count:
            break
        half, point, heading, side = _beside(rng, network, 4.0)
        length, width = float(rng.uniform(7.0, 15.0)), float(rng.uniform(6.0, 10.0))
        away = half + rng.uniform(3.5, 9.0) + width / 2
        x, y = _metres(point + side * away * _left(heading))
        yaw = heading + (math.pi if side < 0 else 0.0)
        height = float(rng.uniform(3.0, 8.5))
        colour = _WALL_COLOURS[int(rng.integers(len(_WALL_COLOURS)))]
        box = Box("building", x, y, yaw, length, width, height, colour, int(rng.integers(_SEEDS)))
        rim = resample(np.concatenate([box_corners(box), box_corners(box)[:1]]), 2.0)
        reach = math.hypot(length, width) / 2
        crowded = any(
            math.hypot(b.x_m - x, b.y_m - y) < reach + math.hypot(b.length_m, b.width_m) / 2
            for b in made
        )
        if crowded or not _free_of_paths(rim, paths, 2.0):
            continue
        if float(np.min(network.nearest(rim).edge_m)) >= 3.0:
            made.append(box)
    return tuple(made)


def _cars(
    rng: np.random.Generator, network: RoadNetwork, count: int, paths: tuple[SidePath, ...]
) -> tuple[Box, ...]:
    made: list[Box] = []
    for _ in range(4 * count):
        if len(made) == count:
            break
        half, point, heading, side = _beside(rng, network, CAR_NODE_M)
        length, width = float(rng.uniform(3.6, 4.8)), float(rng.uniform(1.6, 1.9))
        inner = half + rng.uniform(0.3, 1.0)
        if half >= 3.0:
            # On wide roads a car may stand with its inner wheels on the road.
            inner = max(half - rng.uniform(0.0, 0.7), CAR_CLEARANCE_M + 0.2)
        x, y = _metres(point + side * (inner + width / 2) * _left(heading))
        yaw = heading + (math.pi if rng.random() < 0.5 else 0.0)
        height = float(rng.uniform(1.4, 1.7))
        colour = _CAR_COLOURS[int(rng.integers(len(_CAR_COLOURS)))]
        box = Box("car", x, y, yaw, length, width, height, colour, int(rng.integers(_SEEDS)))
        corners = box_corners(box)
        crowded = any(math.hypot(b.x_m - x, b.y_m - y) < 6.0 for b in made)
        if crowded or not _free_of_paths(corners, paths, 1.8):
            continue
        if float(np.min(np.abs(network.nearest(corners).offset_m))) >= CAR_CLEARANCE_M:
            made.append(box)
    return tuple(made)


def _trees(
    rng: np.random.Generator,
    network: RoadNetwork,
    count: int,
    paths: tuple[SidePath, ...],
    houses: tuple[Box, ...],
) -> tuple[Tree, ...]:
    x_min, y_min, x_max, y_max = network.world.bounds
    places = rng.uniform((x_min - 12, y_min - 12), (x_max + 12, y_max + 12), (2 * count, 2))
    radii = rng.uniform(0.6, 2.8, 2 * count)
    free = network.nearest(places).edge_m > 0.9 + 0.8 * radii
    made: list[Tree] = []
    for index in np.flatnonzero(free):
        x, y = _metres(places[index])
        radius = float(radii[index])
        inside = any(math.hypot(h.x_m - x, h.y_m - y) < radius + 0.6 * h.length_m for h in houses)
        if inside or not _free_of_paths(places[None, index], paths, 1.3 + 0.5 * radius):
            continue
        height = float(radius * rng.uniform(1.6, 3.2))
        made.append(Tree(x, y, radius, height, int(rng.integers(_SEEDS))))
    return tuple(made[:count])


def _patches(rng: np.random.Generator, network: RoadNetwork, density: Density) -> tuple[Patch, ...]:
    made: list[Patch] = []
    for _ in range(density.patches):
        _, point, heading, side = _beside(rng, network, 3.0)
        x, y = _metres(point + side * rng.uniform(0.0, 4.5) * _left(heading))
        dry = rng.random() >= density.mud
        kind = ("puddle" if rng.random() < 0.5 else "repair") if dry else "mud"
        made.append(Patch(kind, x, y, float(rng.uniform(0.4, 1.8)), int(rng.integers(_SEEDS))))
    return tuple(made)
