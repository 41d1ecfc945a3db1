"""The MAVLink driver without a link, in simulated time, against an autopilot that answers."""

import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

pytest.importorskip("pymavlink", reason="extra [mavlink] is not installed")

from autopilot import COPTER, FLIES_ON, ROVER, STRICT, Autopilot
from juncnet_services.command_output.vehicles.mavlink_failsafe import findings
from juncnet_services.command_output.vehicles.mavlink_flight import Flight, MavlinkCore, Phase
from juncnet_services.command_output.vehicles.mavlink_wire import Autopilot as Firmware
from juncnet_services.command_output.vehicles.pacing import Aim, Wish
from mavlink_air import ALL, HOLD, Air, ardupilot, go, px4


@pytest.mark.parametrize(("make", "kind"), ALL)
def test_nothing_is_armed_and_no_mode_is_changed_unless_told(make: Any, kind: str) -> None:
    air = make(kind)
    air.fly(5.0, go(forward_mps=2))
    assert set(air.autopilot.numbers()) == {511}
    assert air.autopilot.heartbeats == pytest.approx(5, abs=1)


@pytest.mark.parametrize(("make", "kind"), ALL)
def test_takes_off_when_told_and_obeys_at_20_hz(make: Any, kind: str) -> None:
    air = make(kind)
    air.take_off()
    began_s = air.now_s
    start = list(air.autopilot.position)
    air.fly(5.0, go(forward_mps=1.0))
    assert air.autopilot.rate_hz(began_s, air.now_s) == pytest.approx(20, abs=1)
    moved = [a - b for a, b in zip(air.autopilot.position, start, strict=True)]
    assert math.hypot(*moved[:2]) == pytest.approx(4.7, abs=0.3)
    assert math.atan2(moved[1], moved[0]) == pytest.approx(air.autopilot.yaw, abs=0.05)
    wanted_m = 3.0 if kind == "copter" else 0.0
    assert air.autopilot.height_m == pytest.approx(wanted_m, abs=0.5)


@pytest.mark.parametrize(("make", "kind"), ALL)
def test_turns_counter_clockwise_for_a_positive_yaw_rate(make: Any, kind: str) -> None:
    air = make(kind)
    air.take_off()
    yaw = air.autopilot.yaw
    air.fly(3.0, go(forward_mps=1.0, yaw_rate_radps=0.4))
    assert math.remainder(yaw - air.autopilot.yaw, math.tau) == pytest.approx(1.2, abs=0.2)


def test_px4_is_asked_for_offboard_after_a_second_of_setpoints_and_armed_after_that() -> None:
    air = px4()
    air.take_off()
    first = {m.command: t for t, m in reversed(air.autopilot.commands)}
    assert first[176] - air.autopilot.setpoints[0][0] >= 1.0
    assert first[176] < first[400]
    assert 22 not in first


def test_the_height_is_held_by_position_and_not_by_a_vertical_speed_of_zero() -> None:
    air = px4()
    air.take_off()
    height_m = air.autopilot.height_m
    air.fly(20.0, go(forward_mps=1.0))
    assert air.newest().type_mask == 1475
    assert air.newest().coordinate_frame == 1
    assert air.autopilot.height_m == pytest.approx(height_m, abs=0.1)
    air.fly(4.0, go(vertical_mps=0.5))
    assert air.autopilot.height_m == pytest.approx(height_m + 2, abs=0.7)


@pytest.mark.parametrize(
    ("make", "kind", "mask"),
    [(ardupilot, "copter", 1479), (ardupilot, "rover", 1511), (px4, "rover", 3527)],
)
def test_type_masks(make: Any, kind: str, mask: int) -> None:
    air = make(kind)
    air.take_off()
    air.fly(1.0, go(forward_mps=1))
    assert air.newest().type_mask == mask


def test_an_ackermann_rover_is_turned_by_the_direction_of_its_velocity() -> None:
    air = px4("rover")
    air.take_off()
    air.fly(0.5, go(forward_mps=2.0, yaw_rate_radps=0.3))
    told = air.newest()
    course = math.atan2(told.vy, told.vx)
    assert math.hypot(told.vx, told.vy) == pytest.approx(2.0, abs=0.01)
    assert course - air.autopilot.yaw == pytest.approx(-0.3 / 1.5, abs=0.03)


@pytest.mark.parametrize(("make", "kind"), ALL)
def test_a_hold_stands_still_and_goes_out_out_of_turn(make: Any, kind: str) -> None:
    air = make(kind)
    air.take_off()
    air.fly(3.0, go(forward_mps=2.0))
    air.give(air.core.due(HOLD, air.now_ns + 1))
    told = air.newest()
    assert (told.vx, told.vy, told.vz, told.yaw_rate) == (0, 0, 0, 0)
    air.fly(3.0)
    assert math.hypot(*air.autopilot.velocity) < 0.05


@pytest.mark.parametrize(("make", "kind"), ALL)
def test_the_guards_packet_stands_still_at_the_height_held(make: Any, kind: str) -> None:
    air = make(kind)
    air.take_off()
    air.fly(3.0, go(forward_mps=2.0))
    packet = air.core.hold_packet()
    assert air.core.hold_packet() == packet
    for _ in range(60):
        air.fly(0.05, linked=False)
        air.give([packet])
    assert math.hypot(*air.autopilot.velocity) < 0.05
    assert air.autopilot.offboard
    wanted_m = 3.0 if kind == "copter" else 0.0
    assert air.autopilot.height_m == pytest.approx(wanted_m, abs=0.5)


def test_a_copter_that_is_connected_to_in_the_air_keeps_a_height_that_is_not_known_yet() -> None:
    air = px4()
    air.take_off()
    air.fly(1.0)
    height_m = air.autopilot.height_m
    air.core.connected(air.now_ns)
    air.core.heard(air.autopilot.told(air.now_s + 1)[0], air.now_ns)
    for packets in (air.core.due(HOLD, air.now_ns), [air.core.hold_packet()]):
        air.give(packets)
        assert air.core.controlled
        assert air.newest().type_mask == 1479
    air.fly(5.0)
    assert air.newest().type_mask == 1475
    assert air.autopilot.height_m == pytest.approx(height_m, abs=0.2)


@pytest.mark.parametrize(("make", "kind"), ALL)
def test_with_accepted_parameters_a_lost_link_comes_to_rest_by_itself(make: Any, kind: str) -> None:
    air = make(kind)
    air.take_off()
    air.fly(3.0, go(forward_mps=2.0))
    air.fly(1.4, linked=False)
    start = list(air.autopilot.position)
    air.fly(5.0, linked=False)
    moved = [a - b for a, b in zip(air.autopilot.position, start, strict=True)]
    assert math.hypot(*moved[:2]) < 1.0


def test_where_a_lost_link_flies_on_there_is_no_take_off_and_the_remedy_is_named() -> None:
    air = px4(parameters=FLIES_ON)
    air.fly(2.0)
    assert "COM_OBL_RC_ACT to 5" in air.core.trouble
    assert "COM_RC_IN_MODE 4" in air.core.trouble
    air.core.take_off(air.now_ns)
    air.fly(5.0, go(forward_mps=1))
    assert set(air.autopilot.numbers()) == {511}
    assert air.autopilot.setpoints == []


def test_in_trouble_a_vehicle_that_flies_under_our_setpoints_is_held_and_never_moved() -> None:
    air = px4(parameters=FLIES_ON)
    air.autopilot.armed, air.autopilot.mode, air.autopilot.position[2] = True, (6, 0), -3.0
    air.fly(4.0, go(forward_mps=2))
    assert air.autopilot.rate_hz(air.now_s - 2, air.now_s) == pytest.approx(20, abs=1)
    assert all(math.hypot(m.vx, m.vy) == 0 for _, m in air.autopilot.setpoints)
    assert air.autopilot.height_m == pytest.approx(3.0, abs=0.1)


JUDGED = [
    (Firmware.PX4, "copter", STRICT, ""),
    (Firmware.PX4, "copter", STRICT | {"COM_OBL_RC_ACT": 4}, ""),
    (Firmware.PX4, "copter", STRICT | {"COM_OBL_RC_ACT": 0}, "COM_OBL_RC_ACT to 5"),
    (Firmware.PX4, "copter", STRICT | {"COM_OBL_RC_ACT": 3}, "Return"),
    (Firmware.PX4, "copter", STRICT | {"COM_OBL_RC_ACT": 7}, "Disarm"),
    (
        Firmware.PX4,
        "copter",
        {"COM_OBL_RC_ACT": 0, "COM_OF_LOSS_T": 1, "COM_RC_IN_MODE": 0, "NAV_RCL_ACT": 1},
        "",
    ),
    (
        Firmware.PX4,
        "copter",
        {"COM_OBL_RC_ACT": 0, "COM_OF_LOSS_T": 1, "COM_RC_IN_MODE": 0, "NAV_RCL_ACT": 0},
        "NAV_RCL_ACT 0",
    ),
    (Firmware.PX4, "copter", STRICT | {"COM_OF_LOSS_T": 5}, "COM_OF_LOSS_T to 1.5"),
    (Firmware.PX4, "rover", {"COM_OBL_RC_ACT": 5}, "could not be read"),
    (Firmware.ARDUPILOT, "copter", {"GUID_TIMEOUT": 3, "FS_GCS_ENABLE": 1}, "GUID_TIMEOUT to 1.5"),
    (Firmware.ARDUPILOT, "copter", COPTER, ""),
    (Firmware.ARDUPILOT, "rover", ROVER, ""),
    (Firmware.ARDUPILOT, "rover", ROVER | {"FS_ACTION": 1}, "FS_ACTION to 2"),
    (Firmware.ARDUPILOT, "rover", ROVER | {"FS_GCS_ENABLE": 0}, "FS_GCS_ENABLE to 1"),
]


@pytest.mark.parametrize(("firmware", "kind", "values", "told"), JUDGED)
def test_failsafes_are_judged(firmware: Any, kind: Any, values: Any, told: str) -> None:
    found = "; ".join(findings(firmware, kind, values, 1.5))
    assert (told in found) if told else found == ""


def test_parameters_that_are_never_answered_are_trouble() -> None:
    air = px4(parameters={"COM_OBL_RC_ACT": 5})
    air.fly(1.0)
    assert "being read" in air.core.trouble
    air.fly(5.0)
    assert "COM_OF_LOSS_T" in air.core.trouble
    assert "could not be read" in air.core.trouble


def test_a_rover_in_a_copters_layout_is_trouble() -> None:
    air = Air(Autopilot("rover", STRICT, px4=True))
    air.core = MavlinkCore(Flight(kind="copter"))
    air.fly(2.0)
    assert "flies a rover" in air.core.trouble


@pytest.mark.parametrize("command", [176, 400])
def test_a_refused_take_off_is_given_up_and_named_for_a_while(command: int) -> None:
    air = px4()
    air.autopilot.refuses = {command}
    air.fly(2.0)
    air.core.take_off(air.now_ns)
    air.fly(6.0)
    assert "MAV_RESULT 2" in air.core.trouble
    assert air.core.phase is Phase.IDLE
    air.fly(5.0)
    assert air.core.trouble == ""
    assert not air.autopilot.armed


def test_a_pilot_who_takes_over_keeps_the_vehicle() -> None:
    air = px4()
    air.take_off()
    air.autopilot.mode = (3, 0)
    air.autopilot.commands.clear()
    air.fly(10.0, go(forward_mps=2))
    assert 176 not in air.autopilot.numbers()
    assert not air.autopilot.offboard
    air.core.take_off(air.now_ns)
    air.fly(3.0)
    assert air.autopilot.offboard
    assert 400 not in air.autopilot.numbers()


@pytest.mark.parametrize("make", [px4, ardupilot])
def test_a_copter_lands_and_the_landing_is_the_autopilots(make: Any) -> None:
    air = make("copter")
    air.take_off()
    air.fly(8.0, Wish(Aim.LAND))
    assert not air.autopilot.armed
    assert air.autopilot.height_m == pytest.approx(0, abs=0.1)
    modes = [m for _, m in air.autopilot.commands if m.command == 176]
    assert len(modes) <= 4


@pytest.mark.parametrize("make", [px4, ardupilot])
def test_a_rover_stands_still_for_a_second_before_it_is_disarmed(make: Any) -> None:
    air = make("rover")
    air.take_off()
    air.fly(3.0, go(forward_mps=2))
    told_s = air.now_s
    air.fly(4.0, Wish(Aim.LAND))
    assert not air.autopilot.armed
    disarmed_s = next(t for t, m in air.autopilot.commands if m.command == 400 and m.param1 == 0)
    assert disarmed_s - told_s >= 1.0
    between = [m for t, m in air.autopilot.setpoints if told_s < t < disarmed_s]
    assert len(between) >= 19
    assert all(math.hypot(m.vx, m.vy) == 0 for m in between)


@pytest.mark.parametrize(("make", "kind"), ALL)
def test_an_emergency_disarms_by_force(make: Any, kind: str) -> None:
    air = make(kind)
    air.take_off()
    air.fly(1.0, Wish(Aim.EMERGENCY))
    assert not air.autopilot.armed
    cut = [m for _, m in air.autopilot.commands if m.command == 400 and m.param1 == 0]
    assert {m.param2 for m in cut} == {21196}


def test_an_ordered_end_leaves_the_autopilot_in_its_own_hold() -> None:
    air = px4()
    assert air.core.ending() == []
    air.take_off()
    air.give(air.core.ending())
    assert air.autopilot.mode == (4, 3)
    air = ardupilot()
    air.take_off()
    air.give(air.core.ending())
    assert air.autopilot.mode == (17, 0)


def test_telemetry_is_in_our_axes_and_grows_old() -> None:
    air = px4()
    air.take_off()
    air.fly(4.0, go(forward_mps=1.0, lateral_mps=0.5))
    seen = air.core.telemetry(air.now_ns, 0.2)
    assert seen is not None
    assert seen.velocity is not None
    assert seen.velocity.forward_mps == pytest.approx(1.0, abs=0.05)
    assert seen.velocity.lateral_mps == pytest.approx(0.5, abs=0.05)
    assert seen.pose is not None
    assert seen.pose.z_m == pytest.approx(3.0, abs=0.5)
    assert seen.yaw_rad == pytest.approx(-0.4, abs=0.01)
    assert (seen.battery, seen.flying) == (0.77, True)
    assert air.core.telemetry(air.now_ns + 300_000_000, 0.2) is None


def test_a_silent_autopilot_is_lost() -> None:
    air = px4()
    air.fly(1.0)
    air.core.due(HOLD, air.now_ns + 3_500_000_000)
    assert air.core.lost


@settings(max_examples=60, deadline=None)
@given(st.lists(st.binary(max_size=300), max_size=5))
def test_no_bytes_from_the_link_stop_the_driver(data: list[bytes]) -> None:
    air = px4()
    air.fly(0.5)
    for datagram in data:
        air.core.heard(datagram, air.now_ns)
        air.core.heard(b"\xfd" + datagram, air.now_ns)
    air.core.due(go(forward_mps=1), air.now_ns)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(width=32), min_size=7, max_size=7))
def test_numbers_that_are_none_are_not_measured(values: list[float]) -> None:
    from pymavlink.dialects.v20 import common as dialect

    air = px4()
    air.fly(1.0)
    air.core.heard(
        air.autopilot.pack(dialect.MAVLink_local_position_ned_message(0, *values[:6])), air.now_ns
    )
    attitude = dialect.MAVLink_attitude_message(0, *values[:6])
    air.core.heard(air.autopilot.pack(attitude), air.now_ns)
    air.core.due(go(forward_mps=1), air.now_ns)
    assert air.core.telemetry(air.now_ns, 10) is not None
