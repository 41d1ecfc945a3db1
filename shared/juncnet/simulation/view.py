"""Where a camera on a moving body sees things: pinhole projection with roll and pitch."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from juncnet.camera import CameraGeometry

Matrix = NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """A camera at one moment.

    `projection` is the (3, 4) matrix from (x, y, z, 1) metres in the world to homogeneous pixels
    (column, row, depth); pixel (0, 0) is the centre of the top left one. Depth is in metres.
    """

    projection: Matrix
    position: Matrix
    """(3,) metres."""
    yaw_rad: float
    roll_px_rad: float
    """Angle of the horizon in the picture, positive when its right end is higher."""
    horizon: tuple[float, float]
    """Pixel of the horizon straight ahead."""
    focal_px: float
    width: int
    height: int

    @property
    def ground(self) -> Matrix:
        """The 3x3 homography from ground (x, y, 1) to homogeneous pixels."""
        return self.projection[:, [0, 1, 3]]

    def horizon_rows(self) -> tuple[float, float]:
        """Return the row of the horizon at the left and the right edge."""
        slope = math.tan(self.roll_px_rad)
        column, row = self.horizon
        return (row + slope * column, row - slope * (self.width - 1 - column))

    def half(self) -> "View":
        """Return the view for a plane of half the size, as chroma is."""
        # Pixel centres: c' = (c + 0.5) / 2 - 0.5.
        shrink = np.array([[0.5, 0, -0.25], [0, 0.5, -0.25], [0, 0, 1]])
        column, row = self.horizon
        return View(
            shrink @ self.projection,
            self.position,
            self.yaw_rad,
            self.roll_px_rad,
            (column / 2 - 0.25, row / 2 - 0.25),
            self.focal_px / 2,
            self.width // 2,
            self.height // 2,
        )


def view_from(
    camera: CameraGeometry,
    size: tuple[int, int],
    pose: tuple[float, float, float],
    z_offset_m: float = 0.0,
    roll_rad: float = 0.0,
    pitch_rad: float = 0.0,
) -> View:
    """Return the view of a camera mounted on a body at `pose`.

    Args:
        camera: Geometry; its aspect is replaced by that of `size` (pixels are square).
        size: (width, height) pixels.
        pose: (x, y, yaw) of the body in the world: metres and radians.
        z_offset_m: Added to the camera's height.
        roll_rad: Roll of the body, positive with its right side down.
        pitch_rad: Pitch of the body, positive with its nose down, as the camera's.
    """
    width, height = size
    x, y, yaw = pose
    down = camera.pitch_rad + pitch_rad
    focal = camera.focal * width
    s, c = math.sin(down), math.cos(down)
    # Rows: right, down and forward of the camera in the level body frame (forward, left, up).
    axes = np.array([[0, -1, 0], [-s, 0, -c], [c, 0, -s]])
    sr, cr = math.sin(roll_rad), math.cos(roll_rad)
    axes = axes @ np.array([[1, 0, 0], [0, cr, sr], [0, -sr, cr]])
    sy, cy = math.sin(yaw), math.cos(yaw)
    axes = axes @ np.array([[cy, sy, 0], [-sy, cy, 0], [0, 0, 1]])
    inner = np.array([[focal, 0, width / 2 - 0.5], [0, focal, height / 2 - 0.5], [0, 0, 1]])
    position = np.array([x, y, max(camera.height_m + z_offset_m, 0.05)])
    projection = inner @ np.concatenate([axes, -(axes @ position)[:, None]], axis=1)
    ahead = projection[:, :3] @ np.array([cy, sy, 0])
    aside = projection[:, :3] @ np.array([cy + 0.1 * sy, sy - 0.1 * cy, 0])
    ahead, aside = ahead / ahead[2], aside / aside[2]
    tilt = math.atan2(ahead[1] - aside[1], aside[0] - ahead[0])
    horizon = (float(ahead[0]), float(ahead[1]))
    return View(projection, position, yaw, tilt, horizon, focal, width, height)
