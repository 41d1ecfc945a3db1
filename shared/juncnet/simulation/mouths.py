"""Where roads run into each other: the painted shape of junctions and bends."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from juncnet.simulation.canvas import Points, normals, resample
from juncnet.simulation.world import Road, World

REACH_M = 16.0
"""Longest part of a road that belongs to a junction."""
RANK = {"dirt": 0, "gravel": 1, "cobble": 2, "concrete": 3, "asphalt": 4}
"""Which surface lies over which where roads meet."""


@dataclass(frozen=True)
class Arm:
    """One road as it leaves a node."""

    road: Road
    outward: Points
    """(N, 2) its centre line from the node, 0.25 m apart, at most REACH_M long."""
    mouth_m: float
    """How far from the node, along the road, it is free of the other roads."""

    @property
    def bearing_rad(self) -> float:
        """Direction in which it leaves."""
        i = min(len(self.outward) - 1, max(1, round(self.mouth_m / 0.25)))
        dx, dy = self.outward[i] - self.outward[0]
        return math.atan2(dy, dx)

    def edge(self, side: float, along_m: float) -> NDArray[np.float64]:
        """Return the point of its left (side 1) or right (-1) edge at a distance from the node."""
        i = int(min(len(self.outward) - 1, max(0, round(along_m / 0.25))))
        normal = normals(self.outward)[i]
        return self.outward[i] + side * normal * self.road.width_m / 2


def arms_at(world: World, node: int) -> list[Arm]:
    """Return the arms of a node, counter-clockwise by bearing."""
    lines: list[tuple[Road, Points]] = []
    for road in world.roads_at(node):
        for end in (road.a, road.b):
            if end == node:
                line = road.centre if end == road.a else road.centre[::-1]
                lines.append((road, _head(resample(line, 0.25))))
                if road.a != road.b:
                    break
    arms = [Arm(road, line, _mouth(i, lines)) for i, (road, line) in enumerate(lines)]
    return sorted(arms, key=lambda arm: arm.bearing_rad)


def _head(line: Points) -> Points:
    return line[: round(REACH_M / 0.25) + 1]


def _mouth(index: int, lines: list[tuple[Road, Points]]) -> float:
    road, line = lines[index]
    normal = normals(line) * road.width_m / 2
    inside = np.zeros(len(line), bool)
    for k, (other, other_line) in enumerate(lines):
        if k == index:
            continue
        for probe in (line, line + normal, line - normal):
            gap = np.hypot(*(probe[:, None] - other_line[None]).transpose(2, 0, 1)).min(axis=1)
            inside |= gap < other.width_m / 2
    last = np.flatnonzero(inside)
    return float(last[-1]) * 0.25 + 0.25 if len(last) else 0.0


def corner(first: Arm, second: Arm, radius_m: float, widen_m: float) -> Points | None:
    """Return the area between two neighbouring arms, rounded; None where there is no corner.

    `first` comes before `second` counter-clockwise. `radius_m` is how far along the arms the
    rounding reaches, `widen_m` moves the edges outward (for kerbs and pavements).
    """
    gap = (second.bearing_rad - first.bearing_rad) % (2 * math.pi)
    if gap > 2.9 or gap < 0.2:
        return None
    start = first.edge(1.0, first.mouth_m + radius_m)
    end = second.edge(-1.0, second.mouth_m + radius_m)
    middle = 0.5 * (first.edge(1.0, first.mouth_m) + second.edge(-1.0, second.mouth_m))
    t = np.linspace(0, 1, 12)[:, None]
    curve = (1 - t) ** 2 * start + 2 * t * (1 - t) * middle + t**2 * end
    if widen_m:
        centre = first.outward[0]
        away = (start + end) / 2 - centre
        curve = curve + away / max(float(np.hypot(*away)), 1e-6) * widen_m
    inner = [second.outward[_index(second, radius_m)], first.outward[0]]
    inner.append(first.outward[_index(first, radius_m)])
    return np.concatenate([curve, np.array(inner)])


def _index(arm: Arm, radius_m: float) -> int:
    return int(min(len(arm.outward) - 1, round((arm.mouth_m + radius_m) / 0.25)))
