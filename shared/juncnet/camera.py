"""Geometry of a forward camera over flat ground, and what counts as a junction in its picture.

This is the one place for the definition of *junction*: simulation, training, navigation and the
model cards all ask `JunctionBand`. A frame is *junction* when the mouth of the nearest junction
(the nearest point of the robot's road where its surface begins) lies between `d_near` and
`d_far` ahead and enough of it is visible. The two distances scale with the height of the camera,
because a picture from twice the height of a world twice the size is the same picture: only
distances in units of the height can be seen.
"""

import math

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

Array = NDArray[np.float64]
LEAST_DEPTH_M = 1e-6
NEAR_ROW = 0.88
"""Row of the picture (0 top, 1 bottom) at which a mouth is as near as can still be seen."""
FAR_HEIGHTS = 5.0
"""Farthest mouth that counts, in camera heights: a depression of 11.3 degrees."""
TRANSITION = 0.20
"""Half-width of the transition bands around d_near and d_far, as a fraction of each distance."""


class CameraGeometry(BaseModel):
    """A pinhole camera over flat ground, level in roll, looking forward and `pitch_rad` down."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    height_m: float = Field(default=3.0, gt=0.1, le=120.0)
    pitch_rad: float = Field(
        default=math.radians(20.0), ge=math.radians(-30.0), le=math.radians(60.0)
    )
    """Downward tilt of the optical axis below the horizon."""
    horizontal_fov_rad: float = Field(default=math.radians(80.0), gt=0.2, lt=2.8)
    aspect: float = Field(default=16.0 / 9.0, gt=0.2, lt=5.0)
    """Width divided by height of the picture."""

    @property
    def focal(self) -> float:
        """Focal length in units of the picture's width."""
        return 0.5 / math.tan(self.horizontal_fov_rad / 2)

    def ray(self, column: float, row: float) -> tuple[float, float, float]:
        """Return the direction (x forward, y left, z up; not normalised) of a picture point.

        `column` and `row` are fractions of the width and height, (0, 0) is the top left corner.
        """
        right = (column - 0.5) / self.focal
        down = (row - 0.5) / self.aspect / self.focal
        s, c = math.sin(self.pitch_rad), math.cos(self.pitch_rad)
        return (c - down * s, -right, -s - down * c)

    def ground(self, column: float, row: float) -> tuple[float, float] | None:
        """Return the ground point (x forward, y left, metres) at a picture point; None: sky."""
        x, y, z = self.ray(column, row)
        if z >= -1e-9:
            return None
        scale = self.height_m / -z
        return (x * scale, y * scale)

    def project(self, x_m: float, y_m: float) -> tuple[float, float] | None:
        """Return (column, row), fractions, of a ground point; None: it lies behind the camera."""
        s, c = math.sin(self.pitch_rad), math.cos(self.pitch_rad)
        if x_m * c + self.height_m * s <= LEAST_DEPTH_M:
            return None
        column, row = self.project_all(np.array(x_m), np.array(y_m))
        return float(column), float(row)

    def project_all(self, x_m: Array, y_m: Array) -> tuple[Array, Array]:
        """Return (columns, rows) of ground points before the camera; of others they mean nothing.

        Columns have the shape to which `x_m` and `y_m` broadcast, rows that of `x_m`.
        """
        s, c = math.sin(self.pitch_rad), math.cos(self.pitch_rad)
        depth = np.maximum(x_m * c + self.height_m * s, LEAST_DEPTH_M)
        down = (self.height_m * c - x_m * s) / depth
        return 0.5 - y_m / depth * self.focal, 0.5 + down * self.focal * self.aspect

    @property
    def horizon_row(self) -> float:
        """Row (fraction of the height) of the horizon; negative when it is above the picture."""
        return 0.5 - math.tan(self.pitch_rad) * self.focal * self.aspect

    @property
    def band(self) -> "JunctionBand":
        """The distances of this camera between which a mouth makes a frame *junction*."""
        near = self.ground(0.5, NEAR_ROW)
        if near is None:
            raise ValueError(
                "this camera does not see the ground: increase pitch_rad or the field of view"
            )
        return JunctionBand(d_near_m=near[0], d_far_m=max(FAR_HEIGHTS * self.height_m, 2 * near[0]))


class JunctionBand(BaseModel):
    """Between which distances ahead a junction's mouth makes a frame *junction*."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    d_near_m: float = Field(gt=0)
    d_far_m: float = Field(gt=0)

    def contains(self, mouth_m: float) -> bool:
        """Return whether a mouth this far ahead makes the frame *junction*."""
        return self.d_near_m <= mouth_m <= self.d_far_m

    def in_transition(self, mouth_m: float) -> bool:
        """Return whether the label is a matter of taste: the mouth is close to d_near or d_far."""
        return any(abs(mouth_m - d) <= TRANSITION * d for d in (self.d_near_m, self.d_far_m))
