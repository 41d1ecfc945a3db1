"""Maps of the surface around a robot, drawn by hand."""

import math
from collections.abc import Callable

import numpy as np

from juncnet.messages import RoadSurface

CELL_M, REACH_M = 0.25, 11.0
Mark = Callable[[float, float], str]


def surface(mark: Mark) -> RoadSurface:
    """A map of 22 x 22 m around the robot of what `mark` says at (x, y)."""
    count = round(2 * REACH_M / CELL_M) + 1
    rows = tuple(
        "".join(mark(CELL_M * i - REACH_M, REACH_M - CELL_M * j) for j in range(count))
        for i in range(count)
    )
    return RoadSurface(x_m=-REACH_M, y_m=REACH_M, cell_m=CELL_M, rows=rows)


def roads(*degrees: float, width_m: float = 6.0, centre: tuple[float, float] = (0, 0)) -> Mark:
    """Roads that lead away from `centre` in these directions."""

    def mark(x: float, y: float) -> str:
        for angle in np.radians(degrees):
            dx, dy = x - centre[0], y - centre[1]
            along = dx * math.cos(angle) + dy * math.sin(angle)
            across = dy * math.cos(angle) - dx * math.sin(angle)
            if along >= -width_m / 2 and abs(across) <= width_m / 2:
                return "#"
        return "."

    return mark


def hidden(mark: Mark, from_deg: float, to_deg: float) -> Mark:
    """The same map with nothing seen between two bearings."""

    def seen(x: float, y: float) -> str:
        bearing = math.degrees(math.atan2(y, x))
        return " " if from_deg <= bearing <= to_deg else mark(x, y)

    return seen
