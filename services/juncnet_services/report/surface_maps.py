"""The maps of the road's surface on which turns were begun: the junction as navigation saw it."""

import math
from typing import Any

import numpy as np
from matplotlib.colors import ListedColormap

from juncnet.messages import RoadSurface
from juncnet_services.junction_navigation import turning
from juncnet_services.junction_navigation.arms import RINGS, arms
from juncnet_services.report.flight_data import Marked
from juncnet_services.report.flight_map import INK, MARK, PATH, turn_words

GROUND = ListedColormap(["#e9ebee", "#a8c69f", "#6d7278"])
"""Not seen, no road, road: the order of `RoadSurface`'s classes."""
ARM_M = RINGS[0][1]
"""How far from the robot arms are looked for."""


def draw_surface(axes: Any, marked: Marked, surface: RoadSurface) -> None:
    """Draw the map at an event, the robot looking up: arms in blue, the one of the turn in red.

    Dashed: the turn's angle; where the map does not show its arm yet, the robot looks there first.
    """
    rows, columns, cell_m = len(surface.rows), len(surface.rows[0]), surface.cell_m
    x = surface.x_m + cell_m * np.arange(rows, dtype=np.float64)[:, None]
    y = surface.y_m - cell_m * np.arange(columns, dtype=np.float64)[None]
    extent = (
        -surface.y_m - cell_m / 2,
        -surface.y_m + (columns - 0.5) * cell_m,
        surface.x_m - cell_m / 2,
        surface.x_m + (rows - 0.5) * cell_m,
    )
    classes = surface.classes(x, y)
    axes.imshow(classes, GROUND, vmin=0, vmax=2, origin="lower", extent=extent)
    found, taken_rad = arms(surface), None
    turn = marked.event.turn
    if turn is not None:
        nearest = found.towards(turning.sector(turn))
        taken_rad = None if nearest is None else nearest[0]
        _arrow(axes, turning.angle_rad(turn), MARK, "-", ":")
    for arm in found.arms:
        _arrow(axes, arm.bearing_rad((arm.left_rad + arm.right_rad) / 2), PATH)
    if taken_rad is not None:
        _arrow(axes, taken_rad, MARK)
    axes.plot(0, 0, marker=(3, 0, 0), markersize=11, color=INK)
    axes.set_axis_off()
    axes.set_title(f"{marked.event.count}: {turn_words(turn)}", fontsize=11)


def _arrow(axes: Any, bearing_rad: float, colour: str, head: str = "-|>", line: str = "-") -> None:
    end = (-ARM_M * math.sin(bearing_rad), ARM_M * math.cos(bearing_rad))
    style = {"arrowstyle": head, "color": colour, "linestyle": line, "linewidth": 2.0}
    style |= {"shrinkA": 9, "shrinkB": 0}
    axes.annotate("", end, (0, 0), arrowprops=style)
