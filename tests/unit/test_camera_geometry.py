"""The camera over flat ground, and the definition of a junction."""

import math

import pytest

from juncnet.camera import CameraGeometry


def test_the_optical_axis_hits_the_ground_at_height_over_tan_pitch() -> None:
    camera = CameraGeometry()
    assert camera.ground(0.5, 0.5) == pytest.approx((3.0 / math.tan(math.radians(20)), 0.0))


@pytest.mark.parametrize("point", [(0.5, 0.9), (0.1, 0.7), (0.8, 0.45)])
def test_project_inverts_ground(point: tuple[float, float]) -> None:
    camera = CameraGeometry(height_m=2.0)
    ground = camera.ground(*point)
    assert ground is not None
    assert camera.project(*ground) == pytest.approx(point)


def test_left_in_the_world_is_left_in_the_picture() -> None:
    camera = CameraGeometry()
    ground = camera.ground(0.25, 0.8)
    assert ground is not None
    assert ground[1] > 0


def test_the_sky_is_no_ground_and_behind_is_not_seen() -> None:
    camera = CameraGeometry()
    assert camera.ground(0.5, camera.horizon_row - 0.01) is None
    assert camera.ground(0.5, camera.horizon_row + 0.01) is not None
    assert camera.project(-50.0, 0.0) is None


def test_the_band_scales_with_the_height() -> None:
    low, high = CameraGeometry(height_m=1.5).band, CameraGeometry(height_m=3.0).band
    assert high.d_near_m == pytest.approx(2 * low.d_near_m)
    assert high.d_far_m == pytest.approx(2 * low.d_far_m) == 15.0


def test_a_junction_lies_within_the_band() -> None:
    band = CameraGeometry().band
    assert band.contains(band.d_near_m)
    assert band.contains(band.d_far_m)
    assert not band.contains(band.d_far_m + 0.01)
    assert band.in_transition(band.d_far_m * 1.19)
    assert not band.in_transition(band.d_far_m * 1.21)


def test_the_band_of_a_level_camera_begins_far_away() -> None:
    camera = CameraGeometry(pitch_rad=0.0, horizontal_fov_rad=0.21, aspect=4.9)
    assert camera.band.d_near_m > 30
