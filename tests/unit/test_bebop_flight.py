"""The Bebop's driver without sockets, in simulated time: what it tells, and how the drone flies."""

import math
import struct
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bebop_drone import Body
from juncnet.messages import Velocity
from juncnet_services.command_output.vehicles import arsdk
from juncnet_services.command_output.vehicles.arsdk import (
    Buffer,
    FlyingState,
    Frame,
    FrameType,
    command,
)
from juncnet_services.command_output.vehicles.bebop_flight import (
    STEP_NS,
    BebopCore,
    Tuning,
    hold_packets,
)
from juncnet_services.command_output.vehicles.pacing import Aim, Wish

STEP_S = 0.01
HOLD = Wish()


def event(payload: bytes, sequence: int = 0) -> bytes:
    return arsdk.encode(Frame(FrameType.DATA, Buffer.EVENTS, sequence, payload))


class Air:
    """A core, a body and their time; packets are lost with none, and events come at 5 Hz."""

    def __init__(self, body: Body | None = None, setup: tuple[bytes, ...] = ()) -> None:
        self.core = BebopCore(Tuning(), setup, -20)
        self.body = body or Body()
        self.now_s = 100.0
        self.told: list[Frame] = []
        self.acknowledges = True
        self.core.connected(self.now_ns)
        self.report()

    @property
    def now_ns(self) -> int:
        return round(self.now_s * 1e9)

    def report(self) -> None:
        self.core.heard(event(command(1, 4, 1, "I", self.body.state)), self.now_ns)

    def fly(self, seconds: float, wish: Wish | Callable[[], Wish] = HOLD) -> None:
        for step in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            before = self.body.state
            self.body.step(STEP_S, self.now_s)
            if step % 20 == 0:
                for payload in self.body.events():
                    self.core.heard(event(payload), self.now_ns)
            if step % 5 == 0:
                for packet in self.core.due(wish() if callable(wish) else wish, self.now_ns):
                    self.obey(packet)
            if self.body.state is not before:
                self.report()

    def obey(self, packet: bytes) -> None:
        (frame,), rest = arsdk.decode(packet)
        assert rest == b""
        self.told.append(frame)
        self.body.told(frame.payload, self.now_s)
        if frame.kind is FrameType.DATA_WITH_ACK and self.acknowledges:
            number = frame.buffer + arsdk.ACK_OFFSET
            answer = Frame(FrameType.ACK, number, 0, bytes([frame.sequence]))
            self.core.heard(arsdk.encode(answer), self.now_ns)

    def take_off(self) -> None:
        self.core.take_off(self.now_ns)
        self.fly(2.0)
        assert self.body.state is FlyingState.HOVERING

    def payloads(self) -> list[bytes]:
        return [frame.payload for frame in self.told]

    def speeds(self) -> tuple[float, float]:
        """Return the speeds forward and to the left."""
        forward, right = self.body.body_speed()
        return forward, -right


def go(**velocity: float) -> Wish:
    return Wish(Aim.FLY, Velocity(**velocity), False, 2**62)


def test_never_takes_off_unless_told_whatever_is_wished() -> None:
    air = Air()
    air.fly(3.0, go(forward_mps=2))
    assert arsdk.TAKE_OFF not in air.payloads()
    assert all(p[4] == 0 for p in air.payloads() if p[:4] == arsdk.pcmd()[:4])


@pytest.mark.parametrize("wanted", [0.5, 1.5, 3.0])
def test_reaches_and_keeps_a_forward_speed_by_tilting(wanted: float) -> None:
    air = Air()
    air.take_off()
    air.fly(4.0, go(forward_mps=wanted))
    assert air.speeds() == pytest.approx((wanted, 0), abs=0.15 * wanted)
    air.fly(6.0, go(forward_mps=wanted))
    assert air.speeds() == pytest.approx((wanted, 0), abs=0.05)


def test_reaches_a_speed_to_the_left_and_into_a_wind_that_it_does_not_know() -> None:
    air = Air(Body(yaw_rad=-2.0))
    air.take_off()
    air.fly(10.0, go(lateral_mps=1.0))
    assert air.speeds() == pytest.approx((0, 1.0), abs=0.05)


def test_does_not_overshoot_by_more_than_a_fifth() -> None:
    air = Air()
    air.take_off()
    fastest = 0.0
    for _ in range(80):
        air.fly(0.1, go(forward_mps=3.0))
        fastest = max(fastest, air.speeds()[0])
    assert 2.9 < fastest < 3.6


def test_turns_counter_clockwise_for_a_positive_yaw_rate_and_climbs_for_up() -> None:
    air = Air()
    air.take_off()
    yaw, height = air.body.yaw_rad, air.body.height_m
    air.fly(2.0, go(yaw_rate_radps=0.5, vertical_mps=0.5))
    assert air.body.yaw_rad - yaw == pytest.approx(-1.0, abs=0.05)
    assert air.body.height_m - height == pytest.approx(1.0, abs=0.05)
    assert all(p[4] == 0 for p in air.payloads() if p[:4] == arsdk.pcmd()[:4])


def test_the_rotation_that_the_drone_reports_is_what_100_percent_are() -> None:
    air = Air(Body(max_rotation_degps=50))
    air.core.heard(event(command(1, 12, 1, "fff", 50, 10, 200)), air.now_ns)
    air.take_off()
    yaw = air.body.yaw_rad
    air.fly(1.0, go(yaw_rate_radps=math.radians(25)))
    assert math.degrees(yaw - air.body.yaw_rad) == pytest.approx(25, abs=2)


def test_a_hold_is_a_hover_at_once_and_the_drone_comes_to_rest() -> None:
    air = Air()
    air.take_off()
    air.fly(4.0, go(forward_mps=2.0))
    air.told.clear()
    air.fly(0.04, HOLD)
    assert air.payloads()[0] == arsdk.pcmd()
    air.fly(4.0, HOLD)
    assert air.speeds() == pytest.approx((0, 0), abs=0.05)


def test_hovers_when_the_drone_no_longer_says_how_fast_it_is() -> None:
    air = Air()
    air.take_off()
    air.fly(2.0, go(forward_mps=2.0))
    air.now_s += 0.7
    (frame,), _ = arsdk.decode(air.core.due(go(forward_mps=2.0), air.now_ns)[0])
    assert frame.payload == arsdk.pcmd()
    assert air.core.telemetry(air.now_ns, 0.2) is None


def test_lands_when_told_until_it_does_and_not_again() -> None:
    air = Air()
    air.take_off()
    air.fly(3.0, Wish(Aim.LAND))
    assert air.body.state is FlyingState.LANDED
    assert air.payloads().count(arsdk.LANDING) == 1
    air.fly(3.0, Wish(Aim.LAND))
    assert air.payloads().count(arsdk.LANDING) == 1


def test_what_is_not_acknowledged_is_sent_again_under_the_same_number() -> None:
    air = Air()
    air.take_off()
    air.acknowledges = False
    air.told.clear()
    air.fly(1.0, Wish(Aim.LAND))
    landings = [f.sequence for f in air.told if f.payload == arsdk.LANDING]
    assert len(landings) == 7
    assert len(set(landings)) == 1


def test_an_emergency_goes_to_the_buffer_of_high_priority_and_nothing_else_does() -> None:
    air = Air()
    air.take_off()
    air.fly(3.0, HOLD)
    air.fly(2.0, Wish(Aim.LAND))
    assert Buffer.HIGH_PRIORITY not in {f.buffer for f in air.told}
    air = Air()
    air.take_off()
    air.fly(2.0, Wish(Aim.EMERGENCY))
    assert {f.payload for f in air.told if f.buffer == Buffer.HIGH_PRIORITY} == {arsdk.EMERGENCY}
    assert air.body.state is FlyingState.EMERGENCY
    assert "restart it" in air.core.trouble


def test_a_stop_forgets_a_take_off_that_has_not_left() -> None:
    air = Air()
    air.core.take_off(air.now_ns)
    air.fly(1.0, Wish(Aim.LAND))
    assert arsdk.TAKE_OFF not in air.payloads()


def test_an_aborted_take_off_is_repeated_no_more() -> None:
    air = Air()
    air.acknowledges = False
    air.core.take_off(air.now_ns)
    air.fly(0.2)
    assert arsdk.TAKE_OFF in air.payloads()
    air.core.abort_take_off(air.now_ns)
    air.told.clear()
    air.fly(3.5)
    assert arsdk.TAKE_OFF not in air.payloads()
    air.acknowledges = True
    air.core.abort_take_off(air.now_ns)
    air.fly(2.0, Wish(Aim.LAND))
    air.take_off()


def test_the_drone_is_set_up_in_order_one_command_after_the_other() -> None:
    setup = (arsdk.ALL_SETTINGS, arsdk.ALL_STATES, arsdk.VIDEO_ON)
    air = Air(setup=setup)
    air.fly(1.0)
    told = [f for f in air.told if f.buffer == Buffer.WITH_ACK]
    assert tuple(f.payload for f in told) == setup
    assert [f.sequence for f in told] == [0, 1, 2]


def test_pings_are_answered_and_events_acknowledged() -> None:
    air = Air()
    ping = arsdk.encode(Frame(FrameType.DATA, Buffer.PING, 9, b"when"))
    (pong,), _ = arsdk.decode(air.core.heard(ping, air.now_ns)[0])
    assert (pong.buffer, pong.payload) == (Buffer.PONG, b"when")
    battery = Frame(FrameType.DATA_WITH_ACK, Buffer.EVENTS_WITH_ACK, 7, command(0, 5, 1, "B", 40))
    (ack,), _ = arsdk.decode(air.core.heard(arsdk.encode(battery), air.now_ns)[0])
    assert (ack.kind, ack.buffer, ack.payload) == (FrameType.ACK, 254, b"\x07")


def test_a_silent_drone_is_lost_and_a_new_connection_begins_anew() -> None:
    air = Air(setup=(arsdk.ALL_STATES,))
    air.fly(1.0)
    assert not air.core.lost
    air.core.due(HOLD, air.now_ns + 4_000_000_000)
    assert air.core.lost
    air.core.connected(air.now_ns)
    assert not air.core.lost
    assert "not said yet" in air.core.trouble


def test_telemetry_is_in_our_axes() -> None:
    air = Air(Body(yaw_rad=0.5))
    air.take_off()
    air.core.heard(event(command(0, 5, 1, "B", 40)), air.now_ns)
    air.core.heard(event(command(1, 4, 4, "ddd", 47.1, 8.2, 400.0)), air.now_ns)
    air.fly(6.0, go(forward_mps=1.0, yaw_rate_radps=0.3))
    seen = air.core.telemetry(air.now_ns, 0.2)
    assert seen is not None
    assert seen.velocity is not None
    assert seen.velocity.forward_mps == pytest.approx(1.0, abs=0.3)
    assert seen.velocity.yaw_rate_radps == pytest.approx(0.3, abs=0.05)
    assert seen.yaw_rad == pytest.approx(math.remainder(-air.body.yaw_rad, math.tau), abs=0.1)
    assert (seen.battery, seen.flying) == (0.4, True)
    assert seen.gps is not None
    assert seen.gps.latitude_deg == 47.1


def test_the_guards_packets_continue_the_numbers_whenever_it_begins() -> None:
    packets = hold_packets()
    air = Air()
    for later_ms in (0, 20, 50, 90, 900, 2500):
        (frame,), _ = arsdk.decode(air.core.due(HOLD, air.now_ns)[0])
        guards = packets[(air.now_ns + later_ms * 1_000_000) // STEP_NS % 256]
        (theirs,), _ = arsdk.decode(guards)
        newer = theirs.sequence - frame.sequence
        assert newer > 0 or newer < -10 or later_ms < 12.5
        assert theirs.payload == arsdk.pcmd()
        air.now_s += 0.333


@settings(max_examples=200, deadline=None)
@given(st.lists(st.binary(max_size=40), max_size=20))
def test_no_bytes_from_the_network_stop_the_driver(datagrams: list[bytes]) -> None:
    air = Air()
    for data in datagrams:
        air.core.heard(data, air.now_ns)
        air.core.heard(event(struct.pack("<BBH", 1, 4, 5) + data), air.now_ns)
        for packet in air.core.due(go(forward_mps=1), air.now_ns):
            assert arsdk.decode(packet)[1] == b""
    air.core.telemetry(air.now_ns, 0.2)
