"""A stop during a take-off over MAVLink, in simulated time: it is where it was at the stop."""

from typing import Any

import pytest

pytest.importorskip("pymavlink", reason="extra [mavlink] is not installed")

from juncnet_services.command_output.vehicles.mavlink_flight import Phase
from juncnet_services.command_output.vehicles.pacing import Aim, Wish
from mavlink_air import ALL, Air, ardupilot, go, px4

COPTERS = [pytest.param(px4, id="px4"), pytest.param(ardupilot, id="ardupilot")]
FALL_M = 0.2


def stopped(air: Air, after_s: float) -> float:
    """Order a take-off, stop it later, and return the height at the stop."""
    air.fly(2.0)
    air.core.take_off(air.now_ns)
    air.fly(after_s)
    air.core.abort_take_off(air.now_ns)
    return air.autopilot.height_m


def fly_without_a_fall(air: Air, seconds: float) -> None:
    """Fly on; fail if the motors end in the air."""
    for _ in range(round(seconds / 0.05)):
        armed = air.autopilot.armed
        air.fly(0.05)
        disarmed = armed and not air.autopilot.armed
        assert not (disarmed and air.autopilot.height_m > FALL_M), air.autopilot.height_m


@pytest.mark.parametrize("tenths", range(2, 70, 3))
@pytest.mark.parametrize("make", COPTERS)
def test_a_stop_leaves_a_copter_disarmed_on_the_ground_or_at_its_height(
    make: Any, tenths: int
) -> None:
    air = make()
    height_m = stopped(air, tenths / 10)
    fly_without_a_fall(air, 8.0)
    assert air.core.phase is Phase.IDLE
    assert air.core.trouble == ""
    if air.autopilot.armed:
        assert height_m > 0.05
        assert air.autopilot.height_m == pytest.approx(height_m, abs=0.35)
    else:
        assert height_m < FALL_M
        assert air.autopilot.height_m == pytest.approx(0, abs=0.05)


@pytest.mark.parametrize(("make", "kind"), ALL)
def test_a_stop_after_0_2_s_leaves_nothing_armed_and_no_mode_changed(make: Any, kind: str) -> None:
    air = make(kind)
    stopped(air, 0.2)
    air.fly(8.0)
    assert set(air.autopilot.numbers()) == {511}


@pytest.mark.parametrize(("make", "kind"), ALL)
def test_what_arms_after_the_stop_is_disarmed(make: Any, kind: str) -> None:
    air = make(kind)
    air.autopilot.refuses = {400}
    stopped(air, 2.6)
    assert air.core.phase is Phase.ABORTING
    air.autopilot.refuses = set()
    air.autopilot.armed = True
    air.fly(4.0)
    assert not air.autopilot.armed
    assert air.autopilot.height_m < 0.05


def test_a_disarm_that_is_refused_is_named_and_the_copter_stays_on_the_ground() -> None:
    air = px4()
    air.fly(2.0)
    air.core.take_off(air.now_ns)
    while air.core.phase is not Phase.CLIMBING:
        air.fly(0.05)
    air.core.abort_take_off(air.now_ns)
    air.autopilot.refuses = {400}
    air.fly(5.0)
    assert "disarm" in air.core.trouble
    assert "MAV_RESULT 2" in air.core.trouble
    air.fly(10.0)
    assert air.autopilot.height_m < 0.3


@pytest.mark.parametrize("make", COPTERS)
def test_a_copter_in_the_air_that_still_says_that_it_stands_is_never_disarmed(make: Any) -> None:
    air = make()
    air.fly(2.0)
    air.core.take_off(air.now_ns)
    while air.autopilot.height_m < 1.0:
        air.fly(0.05)
    air.core.seen.landed_state = 1
    air.core.abort_take_off(air.now_ns)
    told = len(air.autopilot.commands)
    air.core.seen.landed_state = 1
    air.give(air.core.due(Wish(), air.now_ns + 1))
    air.fly(5.0)
    assert 400 not in air.autopilot.numbers()[told:]
    assert air.autopilot.armed
    assert air.autopilot.height_m == pytest.approx(1.0, abs=0.35)


@pytest.mark.parametrize("make", COPTERS)
def test_an_aborted_take_off_goes_on_when_it_is_ordered_again(make: Any) -> None:
    air = make()
    height_m = stopped(air, 4.0)
    assert height_m > 0.5
    air.fly(4.0)
    air.fly(2.0, go(vertical_mps=0.5))
    assert air.autopilot.height_m > height_m + 0.5
    air.fly(8.0, Wish(Aim.LAND))
    assert not air.autopilot.armed
    air.core.take_off(air.now_ns)
    air.fly(0.5)
    air.core.abort_take_off(air.now_ns)
    air.core.take_off(air.now_ns)
    air.fly(12.0)
    assert air.autopilot.height_m == pytest.approx(3.0, abs=0.5)


@pytest.mark.parametrize("make", COPTERS)
def test_a_stop_after_the_take_off_changes_nothing(make: Any) -> None:
    air = make()
    air.take_off()
    height_m, told = air.autopilot.height_m, len(air.autopilot.commands)
    air.core.abort_take_off(air.now_ns)
    air.fly(5.0)
    assert air.autopilot.armed
    assert len(air.autopilot.commands) == told
    assert air.autopilot.height_m == pytest.approx(height_m, abs=0.1)


def test_a_pilots_own_arming_long_after_a_stop_is_left_alone() -> None:
    air = ardupilot()
    air.autopilot.refuses = {400}
    stopped(air, 2.6)
    air.fly(4.0)
    air.autopilot.armed = True
    air.fly(4.0)
    assert air.autopilot.armed


def test_a_pilot_who_takes_over_after_a_stop_is_left_alone() -> None:
    air = ardupilot()
    air.autopilot.refuses = {400}
    stopped(air, 2.6)
    assert air.core.phase is Phase.ABORTING
    told = air.autopilot.numbers().count(400)
    air.autopilot.mode, air.autopilot.armed = (0, 0), True
    air.fly(4.0)
    assert air.autopilot.numbers().count(400) == told
