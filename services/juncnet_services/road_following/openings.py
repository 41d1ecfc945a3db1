"""Mouths of other roads: where the mask shows road well beyond an edge of the road followed."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from juncnet.messages import RoadOpening
from juncnet_services.road_following.centre_line import CentreLine
from juncnet_services.road_following.ground_view import GroundView

Flags = NDArray[np.bool_]
BEYOND_M = 1.2
"""Road that goes on this far beyond an edge is another road's, not the edge's noise."""
OTHER_EDGE = 0.75
"""How far towards the other edge the road must reach beside an opening, in half-widths."""
SHORTEST_M = 1.2
"""An opening is at least this long, and so is the piece of edge that ends it."""

END_M = 2.0
"""No road for this long: it ends."""


def openings(
    view: GroundView, above: NDArray[np.float32], line: CentreLine
) -> tuple[RoadOpening, ...]:
    """Return the nearest opening of either side of the road along `line`.

    `above` is the mask over the ground of `view`.
    """
    found: list[RoadOpening] = []
    for side, sign in (("left", 1.0), ("right", -1.0)):
        opened, visible = _beyond(view, above, line, sign)
        opening = _nearest(view.x_m, opened, visible, "left" if side == "left" else "right")
        if opening is not None:
            found.append(opening)
    return tuple(found)


def road_end_m(view: GroundView, above: NDArray[np.float32], half_m: float) -> float | None:
    """Return where straight ahead the road ends, `half_m` left and right, None: no end is seen.

    The robot must be on the road, and what follows its end be long enough to be no gap.
    """
    strip = np.broadcast_to(np.abs(view.y_m) <= half_m, above.shape)
    visible = ~np.any(strip & ~view.visible, axis=1)
    on_road = ~np.any(strip & (above <= 0.5), axis=1)
    rows = np.flatnonzero(visible)
    least = max(1, round(END_M / float(view.x_m[1] - view.x_m[0])))
    if rows.size == 0 or not on_road[rows[0]]:
        return None
    after = rows[~on_road[rows]]
    if after.size < least or after[-1] - after[0] != after.size - 1 or after[-1] != rows[-1]:
        return None
    return float(view.x_m[after[0]])


def _beyond(
    view: GroundView, above: NDArray[np.float32], line: CentreLine, sign: float
) -> tuple[Flags, Flags]:
    """Return for each row whether the road goes on beyond the edge of a side, and is seen there."""
    half_m = line.half_width_m
    stretch = np.hypot(1.0, np.clip(line.slope(view.x_m), -1.5, 1.5))
    middle = line.y(view.x_m)
    # From well towards the other edge: where the line itself is off, neither side says anything.
    inner = middle - sign * OTHER_EDGE * half_m * stretch
    outer = middle + sign * (half_m + BEYOND_M) * stretch
    low, high = np.minimum(inner, outer), np.maximum(inner, outer)
    across = view.y_m[None, :]
    strip = (across >= low[:, None]) & (across <= high[:, None])
    outside = strip & (sign * (across - middle[:, None]) > 0)
    visible = (np.abs(outer) <= view.y_m[0]) & ~np.any(outside & ~view.visible, axis=1)
    road = (above > 0.5) | ~strip | ~view.visible
    return np.all(road, axis=1) & visible, visible


def _nearest(
    x_m: NDArray[np.float64], opened: Flags, visible: Flags, side: Literal["left", "right"]
) -> RoadOpening | None:
    """Return the first opening along the rows (near to far) that is long enough."""
    step_m = float(x_m[1] - x_m[0])
    least = max(1, round(SHORTEST_M / step_m))
    rows = np.flatnonzero(visible)
    begin: int | None = None
    last, closed = 0, 0
    for row in rows.tolist():
        if opened[row]:
            begin = row if begin is None else begin
            last, closed = row, 0
        elif begin is not None:
            closed += 1
            if last - begin + 1 < least:
                begin, closed = None, 0
            elif closed >= least:
                break
    if begin is None or last - begin + 1 < least:
        return None
    far_m = float(x_m[last] + step_m / 2) if closed >= least else None
    near_m = float(x_m[begin] - step_m / 2) if begin > rows[0] else None
    return RoadOpening(side=side, near_m=near_m, far_m=far_m)
