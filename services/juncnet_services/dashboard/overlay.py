"""The road that a follower saw, as lines on the camera's picture: pure geometry."""

import math
from collections.abc import Sequence

from juncnet.camera import CameraGeometry
from juncnet.messages import RoadSeen

Point = tuple[float, float]
NEAREST_M = 0.5
"""Nearer ground is below the picture, and its projection is useless."""
REACH_M = 25.0
STEPS = 12


def road_lines(road: RoadSeen, camera: CameraGeometry) -> dict[str, list[Point]]:
    """Return `left`, `centre` and `right` of the road as picture points, near to far.

    Points are (column, row) in fractions of width and height, (0, 0) top left; they may lie outside
    the picture. A follower that told no centre line is drawn by offset, heading and curvature.
    """
    centre = list(road.centre) if len(road.centre) > 1 else _arc(road)
    half_m = road.width_m / 2
    return {
        "left": _project(_beside(centre, half_m), camera),
        "centre": _project(centre, camera),
        "right": _project(_beside(centre, -half_m), camera),
    }


def _arc(road: RoadSeen) -> list[Point]:
    """Return points (x forward, y left, metres) of the road's centre line over `REACH_M`."""
    distances = [NEAREST_M + (REACH_M - NEAREST_M) * i / STEPS for i in range(STEPS + 1)]
    slope = math.tan(max(-1.2, min(1.2, road.heading_rad)))
    return [(x, road.offset_m + slope * x + road.curvature_1pm * x * x / 2) for x in distances]


def _beside(line: Sequence[Point], left_m: float) -> list[Point]:
    """Return the line moved `left_m` to its left."""
    moved: list[Point] = []
    for i, (x, y) in enumerate(line):
        (x0, y0), (x1, y1) = line[max(i - 1, 0)], line[min(i + 1, len(line) - 1)]
        length = math.hypot(x1 - x0, y1 - y0) or 1.0
        moved.append((x - (y1 - y0) / length * left_m, y + (x1 - x0) / length * left_m))
    return moved


def _project(line: Sequence[Point], camera: CameraGeometry) -> list[Point]:
    points = [camera.project(x, y) for x, y in line if x >= NEAREST_M]
    return [(round(p[0], 4), round(p[1], 4)) for p in points if p is not None]
