"""The road's surface around the robot, as the last pictures' masks showed it.

A camera does not see the ground beside and right before the robot, where it turns; pictures from a
few metres ago do. The newest mask that shows a place says what is there.
Robot frame: x forward, y left, metres.
"""

import math

import numpy as np
from numpy.typing import NDArray

from juncnet.camera import CameraGeometry
from juncnet.messages import RoadSurface

Array = NDArray[np.float64]
Marks = NDArray[np.uint8]
KEPT_M = 10.0
"""How far the robot goes on until what was seen is forgotten."""
BORDER = 0.02
"""Part of the picture along its border that is not believed."""
FARTHEST_HEIGHTS, FARTHEST_M = 5.0, 15.0
"""Farther off, in camera heights or in metres, a mask is too coarse."""
GRID_M, PLACES = 0.2, 200
"""Places that are remembered: a square that goes along with the robot, whose opposite edges meet.
It is wide enough that no two places known at a time share a cell."""
CELL_M, REAR_M, LEFT_M, ROWS, COLUMNS = 0.25, -4.0, 10.0, 65, 81
"""The map: size of a cell, middle of the first one, number of cells ahead and across."""
ROAD, OFF_ROAD, UNSEEN = (ord(mark) for mark in "#. ")


class SurfaceMemory:
    """Remembers what masks (float32, (h, w)) showed while the robot goes on."""

    def __init__(self, camera: CameraGeometry) -> None:
        self._camera = camera
        self._farthest_m = min(FARTHEST_HEIGHTS * camera.height_m, FARTHEST_M)
        self._x_m = self._y_m = self._yaw_rad = self._driven_m = 0.0
        self._marks = np.full((PLACES, PLACES), UNSEEN, np.uint8)
        self._seen_m = np.full((PLACES, PLACES), -np.inf)
        """How far the robot had driven when a place was seen."""
        reach = np.arange(-round(self._farthest_m / GRID_M), round(self._farthest_m / GRID_M) + 1)
        across, along = np.meshgrid(reach, reach)
        inside = np.hypot(across, along) * GRID_M <= self._farthest_m
        self._disc = along[inside], across[inside]
        row, column = np.divmod(np.arange(ROWS * COLUMNS, dtype=np.float64), COLUMNS)
        self._cells = REAR_M + CELL_M * row, LEFT_M - CELL_M * column

    def move(self, ahead_m: float, turned_rad: float) -> None:
        """Take what the robot drove, along an arc, since the last mask."""
        middle = self._yaw_rad + turned_rad / 2
        self._x_m += ahead_m * math.cos(middle)
        self._y_m += ahead_m * math.sin(middle)
        self._yaw_rad += turned_rad
        self._driven_m += abs(ahead_m)

    def see(self, mask: NDArray[np.float32]) -> None:
        """Take the mask of the newest picture."""
        camera, (height, width) = self._camera, mask.shape
        i, j = (
            self._disc[0] + round(self._x_m / GRID_M),
            self._disc[1] + round(self._y_m / GRID_M),
        )
        dx, dy = i * GRID_M - self._x_m, j * GRID_M - self._y_m
        c, s = math.cos(self._yaw_rad), math.sin(self._yaw_rad)
        ahead = np.flatnonzero(c * dx + s * dy > 0)
        i, j, dx, dy = i[ahead], j[ahead], dx[ahead], dy[ahead]
        column, row = camera.project_all(c * dx + s * dy, c * dy - s * dx)
        inside = np.flatnonzero(
            (np.minimum(column, row) >= BORDER) & (np.maximum(column, row) <= 1 - BORDER)
        )
        road = mask[
            (row[inside] * height).astype(np.intp), (column[inside] * width).astype(np.intp)
        ]
        place = i[inside] % PLACES, j[inside] % PLACES
        self._marks[place] = np.where(road < 0.5, OFF_ROAD, ROAD)
        self._seen_m[place] = self._driven_m

    def marks(self, x_m: Array, y_m: Array) -> Marks:
        """Return ROAD, OFF_ROAD or UNSEEN at points of the robot frame."""
        c, s = math.cos(self._yaw_rad), math.sin(self._yaw_rad)
        i = np.rint((self._x_m + c * x_m - s * y_m) / GRID_M).astype(np.intp) % PLACES
        j = np.rint((self._y_m + s * x_m + c * y_m) / GRID_M).astype(np.intp) % PLACES
        known = self._driven_m - self._seen_m[i, j] <= KEPT_M
        return np.where(known, self._marks[i, j], np.uint8(UNSEEN))

    def around(self) -> RoadSurface:
        """Return the surface around the robot, as the message has it."""
        rows = self.marks(*self._cells).reshape(ROWS, COLUMNS)
        text = tuple(bytes(row).decode() for row in rows)
        return RoadSurface(x_m=REAR_M, y_m=LEFT_M, cell_m=CELL_M, rows=text)
