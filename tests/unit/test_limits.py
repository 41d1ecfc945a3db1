"""What a vehicle is told at most."""

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from juncnet.clocks import Instant
from juncnet.messages import Capabilities, Velocity
from juncnet_services.command_output.limits import MAX_STEP_S, Limiter, Limits

COPTER = Capabilities(kind="copter", lateral=True, vertical=True, turns_in_place=True)
ROVER = Capabilities(kind="rover", minimum_radius_m=2.5)
AXES = ("forward_mps", "lateral_mps", "vertical_mps", "yaw_rate_radps")


def at(seconds: float) -> Instant:
    return Instant(1_000_000_000 + round(seconds * 1e9), "here")


def raw(**axes: float) -> Velocity:
    """Return a velocity that the message itself would refuse."""
    fields: dict[str, Any] = {**dict.fromkeys(AXES, 0.0), **axes}
    return Velocity.model_construct(**fields)


def test_speeds_up_by_the_acceleration_limit() -> None:
    limiter = Limiter(Limits(acceleration_mps2=2.0), COPTER)
    limiter.step(Velocity(forward_mps=3), False, at(0))
    for tick in range(1, 26):
        velocity = limiter.step(Velocity(forward_mps=3), False, at(tick * 0.04))
        assert velocity.forward_mps == pytest.approx(2.0 * tick * 0.04)


def test_a_hold_brakes_by_its_own_limit() -> None:
    limiter = Limiter(Limits(acceleration_mps2=2.0, brake_mps2=5.0), COPTER)
    for tick in range(60):
        limiter.step(Velocity(forward_mps=3), False, at(tick * 0.04))
    braked = limiter.step(Velocity(forward_mps=3), True, at(60 * 0.04))
    assert braked.forward_mps == pytest.approx(3 - 5 * 0.04)


def test_a_hold_ends_at_rest_in_the_braking_time() -> None:
    limiter = Limiter(Limits(brake_mps2=4.0), ROVER)
    for tick in range(60):
        limiter.step(Velocity(forward_mps=2, yaw_rate_radps=0.5), False, at(tick * 0.04))
    for tick in range(60, 74):
        limiter.step(Velocity(forward_mps=2), True, at(tick * 0.04))
    assert limiter.velocity == Velocity()


def test_axes_that_a_vehicle_lacks_stay_zero() -> None:
    limiter = Limiter(Limits(), ROVER)
    wish = Velocity(forward_mps=1, lateral_mps=1, vertical_mps=1)
    for tick in range(20):
        limiter.step(wish, False, at(tick * 0.04))
    assert (limiter.velocity.lateral_mps, limiter.velocity.vertical_mps) == (0.0, 0.0)
    assert limiter.velocity.forward_mps == pytest.approx(1.0)


def test_a_rover_turns_no_tighter_than_it_can() -> None:
    limiter = Limiter(Limits(), ROVER)
    limiter.step(Velocity(yaw_rate_radps=1), False, at(0))
    assert limiter.step(Velocity(yaw_rate_radps=1), False, at(0.1)).yaw_rate_radps == 0.0
    for tick in range(60):
        limiter.step(Velocity(forward_mps=2, yaw_rate_radps=1), False, at(0.2 + tick * 0.04))
    assert limiter.velocity.yaw_rate_radps == pytest.approx(2 / 2.5)


def test_a_pause_a_jump_back_or_another_clock_earns_no_velocity() -> None:
    limiter = Limiter(Limits(acceleration_mps2=2.0), COPTER)
    wish = Velocity(forward_mps=5)
    limiter.step(wish, False, at(0))
    assert limiter.step(wish, False, at(60)).forward_mps == pytest.approx(2.0 * MAX_STEP_S)
    assert limiter.step(wish, False, at(1)).forward_mps == pytest.approx(2.0 * MAX_STEP_S)
    other = Instant(at(99).ns, "elsewhere")
    assert limiter.step(wish, False, other).forward_mps == pytest.approx(2.0 * MAX_STEP_S)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_counts_as_zero(value: float) -> None:
    limiter = Limiter(Limits(), COPTER)
    for tick in range(10):
        limiter.step(raw(**dict.fromkeys(AXES, value)), False, at(tick * 0.04))
    assert limiter.velocity == Velocity()


floats = st.floats(allow_nan=True, allow_infinity=True)


@settings(max_examples=150, deadline=None)
@given(
    st.sampled_from([COPTER, ROVER]),
    st.lists(
        st.tuples(floats, floats, floats, floats, st.booleans(), st.floats(-1, 1)), max_size=20
    ),
)
def test_output_is_always_within_the_limits(
    can: Capabilities, steps: list[tuple[float, float, float, float, bool, float]]
) -> None:
    limits, now_s = Limits(), 10.0
    limiter = Limiter(limits, can)
    for forward, lateral, vertical, yaw_rate, brake, passed_s in steps:
        now_s += passed_s
        last = limiter.velocity
        wish = raw(
            forward_mps=forward, lateral_mps=lateral, vertical_mps=vertical, yaw_rate_radps=yaw_rate
        )
        velocity = limiter.step(wish, brake, at(now_s))
        assert Velocity.model_validate(velocity.model_dump()) == velocity
        for axis in AXES:
            assert abs(getattr(velocity, axis)) <= getattr(limits, axis)
        most = (limits.brake_mps2 if brake else limits.acceleration_mps2) * MAX_STEP_S + 1e-9
        for axis in AXES[:3]:
            assert abs(getattr(velocity, axis) - getattr(last, axis)) <= most
        if brake:
            assert abs(velocity.forward_mps) <= abs(last.forward_mps)
        if can is ROVER:
            assert abs(velocity.yaw_rate_radps) <= abs(velocity.forward_mps) / 2.5 + 1e-9
