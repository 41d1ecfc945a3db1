"""What followed a kill, as it reached the vehicle; and the tap that hears it."""

import socket
import time
from pathlib import Path

import pytest

from juncnet.messages import Phase
from juncnet.simulation.link import Setpoint, Telemetry, encode, open_server, server_address
from juncnet_services.cli.link_tap import LinkTap, Told
from juncnet_services.cli.strikes import Kill, strike

KILL = Kill(ns=1_000_000_000, process="road_following", phase=Phase.TURNING, count=2)
END_NS = 10_000_000_000


def told(second: float, forward_mps: float = 3.0, brake: bool = False) -> Told:
    return Told(round(second * 1e9), Setpoint(forward_mps=forward_mps, brake=brake))


def test_a_hold_is_timed_from_the_kill_and_from_the_last_command() -> None:
    setpoints = [told(0.96), told(1.04), told(1.15, 2.0, brake=True), told(1.5, 0.0, brake=True)]
    setpoints += [told(2.15, 1.0), told(5.0, 0.0, brake=True)]
    found = strike(7, KILL, END_NS, setpoints, [round(s * 1e9) for s in (0.9, 1.0, 2.1)])
    assert found.hold_s == pytest.approx(0.15)
    assert found.since_command_s == pytest.approx(0.15)
    assert found.still_s is None
    assert found.silence_s == pytest.approx(0.65)
    assert found.commanded_s == pytest.approx(1.0)
    assert (found.seed, found.process, found.phase, found.count) == (
        7,
        "road_following",
        Phase.TURNING,
        2,
    )


def test_a_stop_by_the_pipeline_is_timed_from_where_it_begins() -> None:
    speeds = [(1.1, 2.5), (1.2, 3.0), (1.3, 2.0), (1.4, 1.0), (1.5, 0.2), (1.6, 0.0), (3.5, 0.4)]
    setpoints = [*(told(s, v) for s, v in speeds), told(8.0, 0.0, brake=True)]
    found = strike(7, KILL, END_NS, setpoints, [])
    assert found.hold_s is None
    assert found.since_command_s is None
    assert found.still_s == pytest.approx(0.2)
    assert found.commanded_s == pytest.approx(2.0)


def test_nothing_need_follow_a_kill() -> None:
    found = strike(7, KILL, round(1.2e9), [told(0.98), told(1.02), told(1.06), told(3.0)], [])
    assert (found.hold_s, found.still_s, found.commanded_s) == (None, None, None)
    assert found.silence_s == pytest.approx(0.04)


def test_the_tap_hands_on_in_both_directions(tmp_path: Path) -> None:
    telemetry = encode(Telemetry(1, 0.0, 0.0, 3.0, 0.0, 1.0, 0.0, 0.0, True, 0.9))
    setpoint = Setpoint(forward_mps=1.5)
    with (
        open_server(tmp_path) as vehicle,
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as driver,
        LinkTap(tmp_path) as tap,
    ):
        vehicle.settimeout(5.0)
        driver.settimeout(5.0)
        driver.bind(str(tmp_path / "driver.sock"))
        driver.sendto(encode(setpoint), str(server_address(tmp_path)))
        datagram, sender = vehicle.recvfrom(4096)
        assert datagram == encode(setpoint)
        vehicle.sendto(telemetry, sender)
        assert driver.recv(4096) == telemetry
        deadline = time.monotonic() + 5.0
        while not tap.told and time.monotonic() < deadline:
            time.sleep(0.005)
        assert [t.setpoint for t in tap.told] == [setpoint]
