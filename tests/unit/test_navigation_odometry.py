"""Distance and direction: by telemetry, by what was commanded, over a silence, over a restart."""

import math

import pytest

from juncnet.messages import Capabilities, Mission, Output, Pose, Stamp, VehicleState, Velocity
from juncnet_services.junction_navigation.config import NavigatorConfig
from juncnet_services.junction_navigation.odometry import Odometry
from juncnet_services.junction_navigation.progress import Progress

STEP = 40_000_000
MEASURING = Capabilities(kind="copter", turns_in_place=True, telemetry=True)


def progress() -> Progress:
    mission = Mission(finish_after=2)
    return Progress(flight="f", configured=mission, mission=mission)


def vehicle(forward_mps: float = 0.0, **fields: object) -> VehicleState:
    values: dict[str, object] = {
        "at": Stamp(epoch=1, sequence=1, time_ns=1, clock="c"),
        "capabilities": MEASURING,
        "yaw_rad": 0.0,
        "velocity": Velocity(forward_mps=forward_mps),
        "output": Output.PIPELINE,
    }
    return VehicleState.model_validate(values | fields)


def test_distance_is_measured_or_commanded() -> None:
    state = progress()
    odometry = Odometry(NavigatorConfig(), state, resumed=False)
    for i in range(26):
        odometry.advance(i * STEP, vehicle(2.0))
    assert state.odometer_m == pytest.approx(2.0)
    assert odometry.at(500_000_000)[0] == pytest.approx(1.0)
    silent = Capabilities(turns_in_place=True)
    commanded = Velocity(forward_mps=2.0, yaw_rate_radps=1.0)
    state = progress()
    odometry = Odometry(NavigatorConfig(velocity_lag_s=0.0), state, resumed=False)
    for i in range(26):
        odometry.advance(i * STEP, vehicle(capabilities=silent, commanded=commanded))
    assert state.odometer_m == pytest.approx(2.0)
    assert state.yaw_rad == pytest.approx(1.0)


def test_yaw_is_unwrapped() -> None:
    state = progress()
    odometry = Odometry(NavigatorConfig(), state, resumed=False)
    for i, yaw in enumerate((3.0, -3.0, -2.0)):
        odometry.advance(i, vehicle(yaw_rad=yaw))
    assert state.yaw_rad == pytest.approx(2 * math.pi - 2.0)


def test_a_restart_goes_on_by_the_pose() -> None:
    state = progress()
    state.odometer_m, state.position_m = 50.0, (1.0, 1.0)
    Odometry(NavigatorConfig(), state, True).advance(0, vehicle(pose=Pose(x_m=4.0, y_m=5.0)))
    assert state.odometer_m == pytest.approx(55.0)


@pytest.mark.parametrize("silence_s", [0.6, 0.9, 2.4])
def test_a_silent_vehicle_went_as_far_as_its_pose_says(silence_s: float) -> None:
    state = progress()
    odometry = Odometry(NavigatorConfig(vehicle_silence_s=0.5), state, resumed=False)
    odometry.advance(0, vehicle(2.0, pose=Pose(x_m=0.0, y_m=0.0)))
    last = vehicle(2.0, pose=Pose(x_m=0.08, y_m=0.0))
    for number in range(1, 12):  # the last state is taken for the truth until it is too old
        odometry.advance(number * STEP, last)
    assert state.odometer_m == pytest.approx(0.88)
    after_ns = STEP + round(silence_s * 1e9)
    odometry.advance(after_ns, vehicle(2.0, pose=Pose(x_m=0.58, y_m=0.0)))
    assert state.odometer_m == pytest.approx(0.58)
