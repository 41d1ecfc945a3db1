"""From a road mask to the ground: the mask seen from above, and the road's edges in it.

Robot frame: x forward, y left, metres, the camera above the origin. Arrays over the ground are
(X, Y): rows near to far, columns from left (positive y) to right.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from juncnet.camera import CameraGeometry

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.intp]
HORIZON_MARGIN = 0.05
"""Rows closer than this (fraction of the picture) to the horizon are too coarse to use."""


@dataclass(frozen=True)
class RoadEdges:
    """Where the road ends left and right of a line, for each row; NaN: no road there."""

    x_m: Array
    left_m: Array
    right_m: Array
    left_open: Flags
    """Whether the left edge is the picture's: there the road may go on."""
    right_open: Flags
    on_road: Flags
    """Whether the line itself lies on the road, where the camera sees it."""
    visible: Flags
    """Whether the camera sees the line there."""


class GroundView:
    """The ground before one camera, `rows` rows from the nearest visible to `far_m` ahead."""

    def __init__(
        self,
        camera: CameraGeometry,
        mask_shape: tuple[int, int],
        far_m: float,
        half_width_m: float = 12.0,
        rows: int = 40,
        step_m: float = 0.12,
    ) -> None:
        """`mask_shape` is (h, w) of the masks.

        Raises:
            ValueError: the camera does not see enough ground before `far_m`.
        """
        near = camera.ground(0.5, 0.985)
        far = camera.ground(0.5, min(max(camera.horizon_row + HORIZON_MARGIN, 0.0), 0.9))
        if near is None or far is None or min(far[0], far_m) < near[0] + 1.0:
            raise ValueError("the camera sees no ground near the robot: check pitch and height")
        self.near_m, self.far_m = near[0], min(far[0], far_m)
        self.x_m: Array = np.linspace(self.near_m, self.far_m, rows)
        self.y_m: Array = np.arange(half_width_m, -half_width_m - 1e-9, -step_m)
        self._step_m = step_m
        column, row = camera.project_all(self.x_m[:, None], self.y_m[None, :])
        height, width = mask_shape
        map_x = (column * width - 0.5).astype(np.float32)
        map_y = np.broadcast_to(row * height - 0.5, column.shape).astype(np.float32)
        self._maps = cv2.convertMaps(map_x, map_y, cv2.CV_16SC2)
        self.visible: Flags = (column >= 0.0) & (column <= 1.0)

    def from_above(self, probability: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the mask over the ground, float32 (X, Y); the border is repeated outside."""
        above = cv2.remap(
            probability, *self._maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(above, dtype=np.float32)

    def edges(self, above: NDArray[np.float32], line_m: Array, reach_m: float) -> RoadEdges:
        """Return the first edges left and right of a line y = `line_m` (X,), in a mask from above.

        Where the line itself is off the road, the nearest road within `reach_m` beside it is
        taken.
        """
        rows, columns = above.shape
        index: Indices = np.arange(rows, dtype=np.intp)
        start = (self.y_m[0] - line_m) / self._step_m
        visible = (start >= 0) & (start <= columns - 1)
        column = np.clip(np.rint(start), 0, columns - 1).astype(np.intp)
        visible &= self.visible[index, column]
        road = (above > 0.5) & self.visible
        on_road = road[index, column]
        across: Indices = np.arange(columns, dtype=np.intp)
        away: Indices = np.abs(across[None] - column[:, None]) + columns * ~road
        nearest: Indices = np.argmin(away, axis=1)
        usable: Flags = away[index, nearest] * self._step_m <= reach_m
        column = np.where(usable, nearest, column)
        mirrored = columns - 1 - column
        left, left_open = self._edge(above[:, ::-1], self.visible[:, ::-1], mirrored)
        right, right_open = self._edge(above, self.visible, column)
        left_m = self.y_m[0] - self._step_m * (columns - 1 - left)
        right_m = self.y_m[0] - self._step_m * right
        return RoadEdges(
            self.x_m,
            np.where(usable, left_m, np.nan),
            np.where(usable, right_m, np.nan),
            left_open,
            right_open,
            on_road & visible,
            visible,
        )

    def _edge(
        self, above: NDArray[np.float32], visible: Flags, start: Indices
    ) -> tuple[Array, Flags]:
        """Return the column (fraction) of the first edge at or after `start` per row.

        Where there is none inside the picture: its last visible column, and True beside it.
        """
        rows, columns = above.shape
        index: Indices = np.arange(rows, dtype=np.intp)
        across: Indices = np.arange(columns, dtype=np.intp)
        outside: Flags = (above <= 0.5) & (across[None] > start[:, None])
        found: Indices = np.argmax(outside, axis=1)
        inner: Indices = np.maximum(found - 1, 0)
        high, low = above[index, inner], above[index, found]
        fraction = np.clip((high - 0.5) / np.maximum(high - low, 1e-6), 0.0, 1.0)
        seen: Flags = outside[index, found] & visible[index, found]
        last = columns - 1 - visible[:, ::-1].argmax(axis=1)
        return np.where(seen, inner + fraction, np.maximum(last, start)), ~seen
