"""The built-in follower against roads whose geometry is known."""

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from juncnet.camera import CameraGeometry
from juncnet.frames import Frame, FrameLayout
from juncnet.messages import (
    Capabilities,
    Output,
    PixelFormat,
    RoadSurface,
    Stamp,
    VehicleState,
    Velocity,
)
from juncnet.small_picture import SIZE, shrink
from juncnet_services.road_following.centre_line import CentreLine, find
from juncnet_services.road_following.follower import FollowerError, load_follower
from juncnet_services.road_following.ground_view import GroundView
from juncnet_services.road_following.masks import ColourMask, MaskError, NetworkMask
from juncnet_services.road_following.steering import SteeringOptions, steer
from juncnet_services.road_following.vision import VisionFollower, VisionOptions

CAMERA = CameraGeometry()
BUILT_IN = "juncnet_services.road_following.vision:VisionFollower"
STANDING = VehicleState(
    at=Stamp(epoch=1, sequence=0, time_ns=0, clock="test"),
    capabilities=Capabilities(turns_in_place=True, telemetry=True),
    velocity=Velocity(),
    output=Output.PIPELINE,
)
GRASS, ASPHALT = (110, 105, 120), (75, 130, 126)


def ground_of(width: int, height: int) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return x and y (metres) of the ground seen by each pixel; x is NaN in the sky."""
    column = (np.arange(width)[None] + 0.5) / width
    row = (np.arange(height)[:, None] + 0.5) / height
    right = (column - 0.5) / CAMERA.focal
    down = (row - 0.5) / CAMERA.aspect / CAMERA.focal
    s, c = math.sin(CAMERA.pitch_rad), math.cos(CAMERA.pitch_rad)
    fall = s + down * c
    scale = np.where(fall > 1e-3, CAMERA.height_m / np.maximum(fall, 1e-3), np.nan)
    return (c - down * s) * scale, -right * scale


def road_mask(line: CentreLine, side_arm_at: float | None = None) -> NDArray[np.float32]:
    """Return the mask (48, 80) of a road, with an arm to the left 6 m wide where asked."""
    x, y = ground_of(SIZE[0], SIZE[1])
    half = line.half_width_m * np.hypot(1.0, line.slope(x))
    road = np.abs(y - line.y(x)) <= half
    if side_arm_at is not None:
        road |= (np.abs(x - side_arm_at) < 3.0) & (y > 0)
    return road.reshape(SIZE[1] // 2, 2, SIZE[0] // 2, 2).mean(axis=(1, 3)).astype(np.float32)


def view() -> GroundView:
    return GroundView(CAMERA, (SIZE[1] // 2, SIZE[0] // 2), far_m=14.0)


def picture(offset_m: float, sequence: int = 0, road: bool = True) -> Frame:
    """Return an I420 picture of a straight grey road 6 m wide through grass."""
    width, height = 640, 360
    x, y = ground_of(width, height)
    on = (np.abs(y - offset_m) < 3.0) & np.isfinite(x) & road
    planes = [np.where(on, a, g).astype(np.uint8) for a, g in zip(ASPHALT, GRASS, strict=True)]
    parts = [planes[0].ravel(), planes[1][::2, ::2].ravel(), planes[2][::2, ::2].ravel()]
    layout = FrameLayout.packed(PixelFormat.I420, width, height)
    header = Stamp(epoch=1, sequence=sequence, time_ns=sequence * 40_000_000, clock="test")
    return Frame(header, layout, np.concatenate(parts))


@pytest.mark.parametrize(
    "line",
    [
        CentreLine(0.0, 0.0, 0.0, 0.0, 3.0),
        CentreLine(1.0, -0.2, 0.0, 0.0, 2.0),
        CentreLine(-0.5, 0.0, 1 / 12, 0.0, 3.0),
        CentreLine(0.0, 0.1, -1 / 15, 0.0, 2.5),
    ],
)
def test_centre_line_of_a_known_road_is_found(line: CentreLine) -> None:
    ground = view()
    found = find(ground, ground.from_above(road_mask(line)), 6.0)
    x = np.linspace(3.0, 8.0, 11)
    assert np.abs(found.y(x) - line.y(x)).max() < 0.25
    assert found.half_width_m == pytest.approx(line.half_width_m, abs=0.25)
    assert found.support > 0.5


def test_side_arm_does_not_pull_the_centre_line() -> None:
    ground = view()
    straight = CentreLine(0.0, 0.0, 0.0, 0.0, 3.0)
    found = find(ground, ground.from_above(road_mask(straight, side_arm_at=9.0)), 6.0)
    assert np.abs(found.y(np.array([4.0, 6.0, 8.0]))).max() < 0.3


def test_moved_line_is_the_same_line_from_elsewhere() -> None:
    line = CentreLine(0.5, 0.1, 0.05, 0.0, 3.0)
    moved = line.moved(1.0, 0.0)
    x = np.array([2.0, 5.0])
    np.testing.assert_allclose(moved.y(x), line.y(x + 1.0), atol=1e-9)
    assert line.moved(0.0, 0.1).heading == pytest.approx(math.tan(math.atan(0.1) - 0.1))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_steering_turns_towards_the_road(side: float) -> None:
    options = SteeringOptions()
    velocity = steer(CentreLine(offset_m=side), 1.0, 3.0, 0.0, options)
    assert velocity.yaw_rate_radps * side > 0.1
    bend = steer(CentreLine(curvature_1pm=side / 12), 1.0, 3.0, 0.0, options)
    assert bend.yaw_rate_radps * side == pytest.approx(3.0 / 12, rel=0.35)
    assert steer(CentreLine(), 1.0, 3.0, 0.0, options).yaw_rate_radps == 0.0


def test_steering_slows_down_in_bends_and_doubt_and_keeps_limits() -> None:
    options = SteeringOptions(minimum_radius_m=5.0)
    assert steer(CentreLine(), 1.0, 3.0, 0.0, options).forward_mps == 3.0
    assert steer(CentreLine(), 0.1, 3.0, 0.0, options).forward_mps == pytest.approx(1.5)
    tight = steer(CentreLine(offset_m=4.0, curvature_1pm=0.25), 1.0, 3.0, 0.0, options)
    assert tight.forward_mps < 2.5
    assert abs(tight.yaw_rate_radps) <= min(1.0, 3.0 / 5.0) + 1e-9


@pytest.mark.parametrize("offset_m", [-1.0, 0.0, 1.0])
def test_follower_by_colour_sees_the_offset(offset_m: float) -> None:
    follower = VisionFollower(VisionOptions(mask="colour"))
    proposal = None
    for sequence in range(5):
        proposal = follower.follow(picture(offset_m, sequence), None)
    assert proposal is not None
    assert proposal.road is not None
    assert proposal.road.width_m == pytest.approx(6.0, abs=0.5)
    near = min(proposal.road.centre, key=lambda point: point[0])
    assert near[1] == pytest.approx(offset_m, abs=0.3)
    assert proposal.confidence > 0.5


def test_the_surface_is_told_for_vehicles_that_tell_their_motion_and_forgotten_behind_a_gap() -> (
    None
):
    rolling = STANDING.model_copy(update={"velocity": Velocity(forward_mps=3.0)})
    silent = STANDING.model_copy(update={"velocity": None})
    follower = VisionFollower(VisionOptions(mask="colour"))

    def surface_of(frame: Frame, state: VehicleState | None) -> RoadSurface | None:
        proposal = follower.follow(frame, state)
        assert proposal is not None
        return proposal.surface

    assert surface_of(picture(0.0), None) is None
    assert surface_of(picture(0.0, 1), silent) is None
    seen = None
    for sequence in range(2, 90):
        seen = surface_of(picture(0.0, sequence), rolling)
    assert seen is not None
    middle = len(seen.rows[0]) // 2
    near, far = seen.rows[0], seen.rows[-1]
    assert near[middle] == far[middle] == "#"
    assert far[12] == far[-13] == ".", "7 m to either side"
    behind = surface_of(picture(0.0, 120), rolling)
    assert behind is not None
    assert behind.rows[0].strip() == "", "nobody knows where the robot went for a second"


def test_a_road_that_becomes_narrower_at_one_side_is_measured_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shown = CentreLine()

    def probability(mask: ColourMask, small: NDArray[np.uint8]) -> NDArray[np.float32]:
        del mask, small
        return road_mask(shown)

    monkeypatch.setattr(ColourMask, "probability", probability)
    follower = VisionFollower(VisionOptions(mask="colour"))
    for frames, offset_m, half_m in ((30, 0.0, 3.85), (30, 1.75, 2.1)):
        shown = CentreLine(offset_m=offset_m, half_width_m=half_m)
        for _ in range(frames):
            follower.follow(picture(0.0), STANDING)
        assert follower.line is not None
        assert follower.line.half_width_m == pytest.approx(half_m, abs=0.2)
        assert follower.line.offset_m == pytest.approx(offset_m, abs=0.2)


def test_small_picture_is_the_same_from_every_format() -> None:
    frame = picture(0.5)
    small = shrink(frame)
    assert small.shape == (SIZE[1], SIZE[0], 3)
    bgr = Frame(
        frame.header,
        FrameLayout.packed(PixelFormat.BGR8, frame.width, frame.height),
        frame.bgr().reshape(-1),
    )
    assert np.abs(shrink(bgr).astype(int)[..., 0] - small[..., 0]).mean() < 20
    half = frame.width * frame.height
    u, v = frame.pixels[half : half * 5 // 4], frame.pixels[half * 5 // 4 :]
    pairs = np.concatenate([frame.pixels[:half], np.stack([u, v], axis=1).ravel()])
    layout = FrameLayout.packed(PixelFormat.NV12, frame.width, frame.height)
    np.testing.assert_array_equal(shrink(Frame(frame.header, layout, pairs)), small)
    grey = FrameLayout.packed(PixelFormat.GRAY8, frame.width, frame.height)
    small_grey = shrink(Frame(frame.header, grey, frame.pixels[:half]))
    np.testing.assert_array_equal(small_grey[..., 0], small[..., 0])
    assert (small_grey[..., 1:] == 128).all()


def test_missing_model_and_blind_camera_are_named(tmp_path: Any) -> None:
    with pytest.raises(MaskError, match="no road mask model"):
        NetworkMask(tmp_path / "none.onnx")
    with pytest.raises(ValueError, match="no ground"):
        GroundView(CameraGeometry(height_m=100.0, pitch_rad=0.0), (48, 80), far_m=5.0)


@pytest.mark.parametrize(
    ("path", "options", "text"),
    [
        ("nonsense", {}, "package.module:Class"),
        ("no_such_module_at_all:Follower", {}, "cannot import no_such_module_at_all"),
        ("juncnet_services.road_following.vision:Nothing", {}, "has no class Nothing"),
        ("collections:OrderedDict", {}, "no method follow"),
        (BUILT_IN, {"sped": 3}, "no option sped"),
        (BUILT_IN, {"width_m": -1}, "option width_m"),
        (BUILT_IN, {"mask": "no/such.onnx"}, "failed to construct"),
    ],
)
def test_followers_that_cannot_be_loaded_say_why(
    path: str, options: dict[str, Any], text: str
) -> None:
    with pytest.raises(FollowerError, match=text):
        load_follower(path, options)
