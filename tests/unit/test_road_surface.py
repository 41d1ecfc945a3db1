"""The surface remembered from masks of a drawn world, against that world."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from juncnet.camera import CameraGeometry
from juncnet_services.road_following.surface import KEPT_M, OFF_ROAD, ROAD, UNSEEN, SurfaceMemory

CAMERA = CameraGeometry(height_m=2.2, pitch_rad=0.3)
Road = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.bool_]]


def mask(road: Road, x_m: float, y_m: float, yaw_rad: float) -> NDArray[np.float32]:
    """What a perfect mask network says at a pose of the world, 96 x 160."""
    picture = np.zeros((96, 160), np.float32)
    for row in range(96):
        for column in range(160):
            ground = CAMERA.ground((column + 0.5) / 160, (row + 0.5) / 96)
            if ground is not None:
                c, s = math.cos(yaw_rad), math.sin(yaw_rad)
                x = np.array([x_m + c * ground[0] - s * ground[1]])
                y = np.array([y_m + s * ground[0] + c * ground[1]])
                picture[row, column] = road(x, y)[0]
    return picture


def test_the_ground_beside_and_behind_is_known_from_the_pictures_before() -> None:
    def road(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.bool_]:
        return (abs(y) <= 2) | (abs(x - 4) <= 2)

    memory, x_m, y_m, yaw, step_m, step_rad = SurfaceMemory(CAMERA), -6.0, 0.0, 0.0, 0.5, 0.0
    memory.see(mask(road, x_m, y_m, yaw))
    for number in range(20):
        step_rad = 0.06 if number > 10 else 0.0
        memory.move(step_m, step_rad)
        x_m += step_m * math.cos(yaw + step_rad / 2)
        y_m += step_m * math.sin(yaw + step_rad / 2)
        yaw += step_rad
        memory.see(mask(road, x_m, y_m, yaw))
    seen = memory.around()
    assert (len(seen.rows), len(seen.rows[0])) == (65, 81)
    cells = np.array([list(row) for row in seen.rows])
    x, y = np.meshgrid(
        seen.x_m + 0.25 * np.arange(65), seen.y_m - 0.25 * np.arange(81), indexing="ij"
    )
    c, s = math.cos(yaw), math.sin(yaw)
    truth = road(x_m + c * x - s * y, y_m + s * x + c * y)
    known = cells != " "
    assert np.mean((cells == "#")[known] == truth[known]) > 0.95
    beside = (x < 2) & (abs(y) < 3)
    assert np.mean(known[beside]) > 0.9, "the camera itself sees nothing nearer than 2.4 m"


def test_a_first_picture_shows_nothing_beside_the_robot() -> None:
    memory = SurfaceMemory(CAMERA)
    memory.see(np.ones((48, 80), np.float32))
    near = memory.marks(np.array([0.5, 0.0, -1.0, 4.0]), np.array([0.0, 2.0, 0.0, 0.0]))
    assert (near[:3] == UNSEEN).all()
    assert near[3] == ROAD


def test_the_newest_picture_wins_and_a_standing_robot_keeps_one() -> None:
    memory = SurfaceMemory(CAMERA)
    for value in (1.0, 1.0, 0.0):
        memory.see(np.full((48, 80), value, np.float32))
    assert memory.marks(np.array([4.0]), np.array([0.0]))[0] == OFF_ROAD
    for _ in range(100):
        memory.move(0.01, 0.0)
        memory.see(np.zeros((48, 80), np.float32))
    behind = memory.marks(np.array([-8.0]), np.array([0.0]))
    assert behind[0] == UNSEEN


def test_what_was_seen_is_kept_on_the_spot_and_forgotten_on_the_way() -> None:
    memory = SurfaceMemory(CAMERA)
    memory.see(np.ones((48, 80), np.float32))
    for _ in range(40):
        memory.move(0.0, 0.1)
    x_m, y_m = 6 * math.cos(-4.0), 6 * math.sin(-4.0)
    assert memory.marks(np.array([x_m]), np.array([y_m]))[0] == ROAD
    memory.move(0.0, -4.0)
    for driven_m, expected in ((KEPT_M - 0.5, ROAD), (1.0, UNSEEN)):
        memory.move(driven_m, 0.0)
        behind_m = 6 - driven_m if expected == ROAD else 5.5 - KEPT_M
        assert memory.marks(np.array([behind_m]), np.array([0.0]))[0] == expected
