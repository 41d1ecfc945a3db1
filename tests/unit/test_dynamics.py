"""Vehicles against what first-order lags, circles and limits give."""

import math

import pytest

from juncnet.messages import Velocity
from juncnet.simulation.dynamics import CALM, Copter, Drift, Motion, Rover, Vehicle

DT_S = 0.01
REST = Motion(0.0, 0.0, 3.0, 0.0)


def fly(
    vehicle: Vehicle, seconds: float, setpoint: Velocity, state: Motion = REST, brake: bool = False
) -> Motion:
    for _ in range(round(seconds / DT_S)):
        state = vehicle.step(state, setpoint, DT_S, brake)
    return state


def test_copter_lags_first_order() -> None:
    slow = fly(Copter(), 0.35, Velocity(forward_mps=0.5))
    assert slow.forward_mps == pytest.approx(0.5 * (1 - math.exp(-1)), rel=1e-3)
    assert fly(Copter(), 5.0, Velocity(forward_mps=3.0)).forward_mps == pytest.approx(3.0, abs=1e-3)


def test_acceleration_is_limited() -> None:
    copter = fly(Copter(), 0.1, Velocity(forward_mps=10.0))
    assert copter.forward_mps == pytest.approx(0.4)
    rover = fly(Rover(), 0.1, Velocity(forward_mps=5.0))
    assert rover.forward_mps == pytest.approx(0.15)


def test_copter_turns_left_in_place() -> None:
    state = fly(Copter(), 2.0, Velocity(yaw_rate_radps=1.0))
    assert state.yaw_rad == pytest.approx(2.0 - 0.2, abs=0.02)
    assert (state.x_m, state.y_m) == (0.0, 0.0)


def test_copter_moves_left_and_up() -> None:
    state = fly(Copter(), 3.0, Velocity(lateral_mps=1.0, vertical_mps=0.5))
    assert state.y_m > 2.0
    assert state.z_m > 4.0


def test_rover_cannot_turn_in_place() -> None:
    state = fly(Rover(), 3.0, Velocity(yaw_rate_radps=1.0))
    assert (state.x_m, state.y_m, state.yaw_rad) == (0.0, 0.0, 0.0)


def test_rover_keeps_its_smallest_radius() -> None:
    rover = Rover()
    state = fly(rover, 4.0, Velocity(forward_mps=1.0, yaw_rate_radps=3.0))
    assert state.yaw_rate_radps == pytest.approx(1.0 / 2.5, rel=0.01)
    points: list[tuple[float, float]] = []
    for _ in range(round(2 * math.pi * 2.5 / DT_S)):
        state = rover.step(state, Velocity(forward_mps=1.0, yaw_rate_radps=3.0), DT_S)
        points.append((state.x_m, state.y_m))
    width = max(x for x, _ in points) - min(x for x, _ in points)
    assert width == pytest.approx(5.0, rel=0.01)


def test_rover_brakes_harder_than_it_speeds_up() -> None:
    moving = fly(Rover(), 5.0, Velocity(forward_mps=2.0))
    stopped = fly(Rover(), 0.55, Velocity(forward_mps=2.0), moving, brake=True)
    assert stopped.forward_mps == 0.0
    assert stopped.x_m - moving.x_m == pytest.approx(2.0**2 / (2 * 4.0), rel=0.05)
    assert fly(Rover(), 0.55, Velocity(forward_mps=2.0)).forward_mps < 1.0


def test_speed_error_is_not_measured() -> None:
    true, wrong = Copter(), Copter(speed_error=1.2)
    a, b = (fly(v, 5.0, Velocity(forward_mps=2.0)) for v in (true, wrong))
    assert b.x_m == pytest.approx(1.2 * a.x_m)
    assert b.forward_mps == a.forward_mps


def test_rovers_arc_does_not_depend_on_the_speed_error() -> None:
    rover = Rover(speed_error=0.8)
    moving = Motion(0.0, 0.0, 0.0, 0.0, forward_mps=2.0, yaw_rate_radps=0.4)
    state = rover.step(moving, Velocity(forward_mps=2.0, yaw_rate_radps=0.4), DT_S)
    assert state.yaw_rad / math.hypot(state.x_m, state.y_m) == pytest.approx(0.2, rel=1e-3)


def test_drift_is_slow_seeded_and_bounded() -> None:
    drifts = [Drift(seed=seed).at(t) for seed in range(20) for t in range(0, 200, 3)]
    assert max(math.hypot(x, y) for x, y, _ in drifts) <= 0.1 + 1e-9
    assert max(abs(yaw) for *_, yaw in drifts) <= math.radians(0.5)
    assert Drift(seed=1).at(3.0) == Drift(seed=1).at(3.0) != Drift(seed=2).at(3.0)
    assert CALM.at(3.0) == (0.0, 0.0, 0.0)


def test_copter_that_holds_keeps_its_place() -> None:
    state = fly(Copter(drift=Drift(seed=3)), 10.0, Velocity(), brake=True)
    assert (state.x_m, state.y_m, state.z_m) == (0.0, 0.0, 3.0)
