"""The road's surface around the robot, as the last pictures' masks showed it.

A camera does not see the ground beside and right before the robot, where a car-like vehicle turns;
pictures from a few metres ago do. The newest mask that shows a point says what is there.
Robot frame: x forward, y left, metres.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from juncnet.camera import CameraGeometry
from juncnet.messages import RoadSurface

Array = NDArray[np.float64]
KEPT = 24
"""Masks that are kept,"""
APART_M, APART_RAD = 0.4, 0.12
"""each from at least so far on, or turned by so much."""
BORDER = 0.02
"""Part of the picture along its border that is not believed."""
FARTHEST_HEIGHTS = 5.0
"""Farther off, in camera heights, a mask is too coarse."""
CELL_M, REAR_M, LEFT_M, ROWS, COLUMNS = 0.25, -4.0, 10.0, 65, 81
"""The map: size of a cell, middle of the first one, number of cells ahead and across."""
ROAD, OFF_ROAD, UNSEEN = (ord(mark) for mark in "#. ")


@dataclass
class _View:
    """A mask, and where the robot was and looked to when it was taken."""

    x_m: float
    y_m: float
    yaw_rad: float
    mask: NDArray[np.float32]


class SurfaceMemory:
    """Remembers masks (float32, (h, w)) while the robot goes on."""

    def __init__(self, camera: CameraGeometry) -> None:
        self._camera = camera
        self._x_m = self._y_m = self._yaw_rad = 0.0
        self._views: deque[_View] = deque(maxlen=KEPT)
        row, column = np.divmod(np.arange(ROWS * COLUMNS, dtype=np.float64), COLUMNS)
        self._cells = REAR_M + CELL_M * row, LEFT_M - CELL_M * column

    def move(self, ahead_m: float, turned_rad: float) -> None:
        """Take what the robot drove, along an arc, since the last mask."""
        middle = self._yaw_rad + turned_rad / 2
        self._x_m += ahead_m * math.cos(middle)
        self._y_m += ahead_m * math.sin(middle)
        self._yaw_rad += turned_rad

    def see(self, mask: NDArray[np.float32]) -> None:
        """Take the mask of the newest picture. It replaces the one before unless that is far."""
        if len(self._views) > 1:
            before = self._views[-2]
            apart_m = math.hypot(self._x_m - before.x_m, self._y_m - before.y_m)
            turned = abs(self._yaw_rad - before.yaw_rad)
            if apart_m < APART_M and turned < APART_RAD:
                self._views.pop()
        self._views.append(_View(self._x_m, self._y_m, self._yaw_rad, mask))

    def probability(self, x_m: Array, y_m: Array) -> Array:
        """Return the probability of road at points of the robot frame; NaN: not seen yet."""
        found = np.full(x_m.shape, np.nan)
        c, s = math.cos(self._yaw_rad), math.sin(self._yaw_rad)
        east, north = self._x_m + c * x_m - s * y_m, self._y_m + s * x_m + c * y_m
        for view in reversed(self._views):
            unknown = np.flatnonzero(np.isnan(found))
            if unknown.size == 0:
                break
            dx, dy = east[unknown] - view.x_m, north[unknown] - view.y_m
            c, s = math.cos(view.yaw_rad), math.sin(view.yaw_rad)
            found[unknown] = self._look(view.mask, c * dx + s * dy, c * dy - s * dx)
        return found

    def around(self) -> RoadSurface:
        """Return the surface around the robot, as the message has it."""
        seen = self.probability(*self._cells)
        marks = np.where(np.isnan(seen), UNSEEN, np.where(seen < 0.5, OFF_ROAD, ROAD))
        rows = marks.astype(np.uint8).reshape(ROWS, COLUMNS)
        text = tuple(bytes(row).decode() for row in rows)
        return RoadSurface(x_m=REAR_M, y_m=LEFT_M, cell_m=CELL_M, rows=text)

    def _look(self, mask: NDArray[np.float32], x_m: Array, y_m: Array) -> Array:
        """Return the probability in one mask at points of its robot frame; NaN: not in it."""
        camera, (height, width) = self._camera, mask.shape
        column, row = camera.project_all(x_m, y_m)
        inside = (np.minimum(column, row) >= BORDER) & (np.maximum(column, row) <= 1 - BORDER)
        inside &= (x_m > 0) & (x_m <= FARTHEST_HEIGHTS * camera.height_m)
        i = np.clip((row * height).astype(np.intp), 0, height - 1)
        j = np.clip((column * width).astype(np.intp), 0, width - 1)
        return np.where(inside, mask[i, j], np.nan)
