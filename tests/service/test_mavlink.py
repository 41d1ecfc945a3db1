"""The MAVLink driver over UDP: links, the guard's packet, an end in order."""

import contextlib
import itertools
import math
import os
import pty
import socket
import statistics
import time
from collections.abc import Callable, Generator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from juncnet.messages import Velocity
from juncnet_services.command_output.vehicles import AbortsTakeOff, Vehicle, open_vehicle

pytest.importorskip("pymavlink", reason="extra [mavlink] is not installed")

from autopilot import FLIES_ON, ROVER, STRICT, Autopilot, flying
from juncnet_services.command_output.guard_link import GuardLink


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("127.0.0.1", 0))
        return int(link.getsockname()[1])


def until(condition: Callable[[], bool], what: str, timeout_s: float = 15.0) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, what
        time.sleep(0.005)


@contextmanager
def linked(
    autopilot: Autopilot, tmp_path: Path, **options: Any
) -> Generator[tuple[Vehicle, Autopilot]]:
    port = free_port()
    own = {"url": f"udpin:127.0.0.1:{port}", "kind": autopilot.kind}
    vehicle = open_vehicle("mavlink", own | options, tmp_path)
    try:
        with flying(autopilot, port):
            yield vehicle, autopilot
            vehicle.close()
    finally:
        vehicle.close()


def airborne(vehicle: Vehicle, autopilot: Autopilot) -> None:
    until(lambda: vehicle.trouble == "", vehicle.trouble)
    vehicle.take_off()
    until(lambda: autopilot.offboard and autopilot.height_m > 0.8, "did not take off")


def drive(vehicle: Vehicle, seconds: float) -> None:
    for _ in range(round(seconds / 0.04)):
        vehicle.send(Velocity(forward_mps=1.0), brake=False, lasts_s=0.17)
        time.sleep(0.04)


def test_a_flight_over_udp_at_20_hz_that_ends_in_the_autopilots_hold(tmp_path: Path) -> None:
    pilot = Autopilot("copter", STRICT, px4=True)
    with linked(pilot, tmp_path, take_off_m=1.0) as (vehicle, autopilot):
        airborne(vehicle, autopilot)
        until(lambda: autopilot.setpoints[-1][1].vx == 0, "")
        time.sleep(1.0)
        began_s = time.monotonic()
        drive(vehicle, 2.0)
        sent = [t for t, _ in autopilot.setpoints if t >= began_s]
        # The usual distance: a busy machine delays some, and has fewer in all.
        usual_s = statistics.median(b - a for a, b in itertools.pairwise(sent))
        assert 1 / usual_s == pytest.approx(20, abs=1)
        assert math.hypot(*autopilot.velocity[:2]) > 0.7
        seen = vehicle.telemetry(0.2)
        assert seen is not None
        assert seen.flying
    assert pilot.mode == (4, 3)


def test_the_drivers_own_watchdog_stops_what_is_not_commanded_anew(tmp_path: Path) -> None:
    pilot = Autopilot("copter", STRICT, px4=True)
    with linked(pilot, tmp_path, take_off_m=1.0) as (vehicle, autopilot):
        airborne(vehicle, autopilot)
        until(lambda: autopilot.height_m > 0.9, "does not climb")
        drive(vehicle, 1.5)
        assert math.hypot(autopilot.setpoints[-1][1].vx, autopilot.setpoints[-1][1].vy) > 0.5
        last_s = time.monotonic()
        until(lambda: autopilot.setpoints[-1][1].vx == 0, "goes on")
        assert autopilot.setpoints[-1][0] - last_s < 0.3
        until(lambda: math.hypot(*autopilot.velocity[:2]) < 0.1, "does not stand still")
        assert autopilot.offboard


def test_an_aborted_take_off_keeps_its_height_over_the_link(tmp_path: Path) -> None:
    pilot = Autopilot("copter", STRICT, px4=True)
    with linked(pilot, tmp_path, take_off_m=5.0) as (vehicle, autopilot):
        airborne(vehicle, autopilot)
        assert isinstance(vehicle, AbortsTakeOff)
        vehicle.abort_take_off()
        height_m = autopilot.height_m
        time.sleep(2.0)
        assert autopilot.armed
        assert autopilot.height_m == pytest.approx(height_m, abs=0.4)


def test_an_end_that_lands(tmp_path: Path) -> None:
    pilot = Autopilot("copter", STRICT, px4=True)
    with linked(pilot, tmp_path, take_off_m=1.0, at_end="land") as (vehicle, autopilot):
        airborne(vehicle, autopilot)
        drive(vehicle, 0.5)
    told = [m.vx for _, m in pilot.setpoints[-3:]]
    assert told == [0, 0, 0]
    assert pilot.mode == (4, 6)


@pytest.mark.parametrize(("at_end", "armed", "mode"), [("hold", True, 4), ("land", False, 15)])
def test_an_end_of_a_rover(tmp_path: Path, at_end: str, armed: bool, mode: int) -> None:
    pilot = Autopilot("rover", ROVER, px4=False)
    with linked(pilot, tmp_path, at_end=at_end) as (vehicle, autopilot):
        until(lambda: vehicle.trouble == "", vehicle.trouble)
        vehicle.take_off()
        deadline_s = time.monotonic() + 15
        while math.hypot(*autopilot.velocity[:2]) < 0.3:
            assert time.monotonic() < deadline_s, "does not go"
            drive(vehicle, 0.08)
    assert math.hypot(pilot.setpoints[-1][1].vx, pilot.setpoints[-1][1].vy) == 0
    assert (pilot.armed, pilot.mode) == (armed, (mode, 0))


def test_the_guard_holds_height_and_mode_with_the_newest_packet(tmp_path: Path) -> None:
    pilot = Autopilot("copter", STRICT, px4=True)
    with (
        linked(pilot, tmp_path, take_off_m=1.0) as (vehicle, autopilot),
        GuardLink(vehicle.hold(), tmp_path) as guard,
    ):
        assert guard.pid is None
        airborne(vehicle, autopilot)
        guard.beat(10.0, vehicle.hold())
        time.sleep(0.6)
        guard.beat(0.0, vehicle.hold())

        def lately() -> int:
            return sum(t > time.monotonic() - 0.5 for t, _ in autopilot.setpoints)

        # Those of the guard, 20 a second, come beside those of the driver.
        until(lambda: lately() >= 15, "the guard is not heard")
        newest = [m for _, m in autopilot.setpoints[-10:]]
        assert {m.type_mask for m in newest} == {1475}
        assert all(m.z == pytest.approx(-1.0, abs=0.15) for m in newest)


def test_an_autopilot_that_flies_on_is_named_over_the_link_and_stays_on_the_ground(
    tmp_path: Path,
) -> None:
    pilot = Autopilot("copter", FLIES_ON, px4=True)
    with linked(pilot, tmp_path) as (vehicle, autopilot):
        until(lambda: "set COM_OBL_RC_ACT to 5" in vehicle.trouble, vehicle.trouble)
        vehicle.take_off()
        drive(vehicle, 1.5)
        assert not autopilot.armed
        assert autopilot.setpoints == []


def test_no_autopilot_is_named_with_what_to_check(tmp_path: Path) -> None:
    vehicle = open_vehicle("mavlink", {"url": f"udpin:127.0.0.1:{free_port()}"}, tmp_path)
    until(lambda: "no heartbeat" in vehicle.trouble, vehicle.trouble)
    vehicle.close()


def test_a_stranger_who_is_heard_first_does_not_keep_the_autopilot_out(tmp_path: Path) -> None:
    port = free_port()
    options = {"url": f"udpin:127.0.0.1:{port}"}
    with (
        closing(open_vehicle("mavlink", options, tmp_path)) as vehicle,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
    ):
        stranger.connect(("127.0.0.1", port))
        stranger.settimeout(10)
        until(lambda: "no heartbeat" in vehicle.trouble, vehicle.trouble)
        stranger.send(b"GET / HTTP/1.0\r\n\r\n")
        assert stranger.recv(1000), "the stranger was not heard"
        with flying(Autopilot("copter", STRICT, px4=True), port) as autopilot:
            until(lambda: vehicle.trouble == "", "the autopilot is not heard")
            stranger.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                while stranger.recv(1000):
                    pass
            told = len(autopilot.setpoints)
            stranger.send(Autopilot("copter", STRICT, px4=True).told(1.0)[0])
            until(lambda: len(autopilot.setpoints) > told + 10, "the autopilot is told no more")
            with pytest.raises(BlockingIOError):
                stranger.recv(1000)


def test_after_a_reconnect_the_guard_holds_the_autopilot_where_it_is_now(tmp_path: Path) -> None:
    port = free_port()
    with (
        closing(open_vehicle("mavlink", {"url": f"udpin:127.0.0.1:{port}"}, tmp_path)) as vehicle,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
        GuardLink(None, tmp_path) as guard,
    ):
        with flying(Autopilot("copter", STRICT, px4=True), port):
            until(lambda: vehicle.trouble == "", "the autopilot is not heard")
            time.sleep(0.2)
            before = vehicle.hold()
            assert before is not None
            guard.beat(10.0, before)
        until(lambda: "no heartbeat" in vehicle.trouble, "the silence is not noticed")
        assert vehicle.hold() == before
        stranger.connect(("127.0.0.1", port))
        stranger.settimeout(10)
        stranger.send(b"?")
        assert stranger.recv(1000), "the stranger was not heard"
        assert vehicle.hold() == before
        with flying(Autopilot("copter", STRICT, px4=True), port) as autopilot:
            until(lambda: vehicle.trouble == "", "the autopilot is not heard anew")
            present = vehicle.hold()
            assert present is not None
            assert present.address not in (before.address, stranger.getsockname(), None)
            guard.beat(0.0, present)
            # Those of the guard, 20 a second, come beside those of the driver.
            until(
                lambda: sum(t > time.monotonic() - 0.5 for t, _ in autopilot.setpoints) >= 15,
                "the guard is not heard",
            )


def test_a_port_that_is_taken_is_named(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        with pytest.raises(ValueError, match="another program"):
            open_vehicle("mavlink", {"url": f"udpin:127.0.0.1:{port}"}, tmp_path)


@pytest.mark.parametrize("url", ["tcp:127.0.0.1", "udpin:14550", "serial:ttyACM0:57600"])
def test_a_link_that_is_none_is_named(tmp_path: Path, url: str) -> None:
    with pytest.raises(ValueError, match="udpin:ADDRESS:PORT"):
        open_vehicle("mavlink", {"url": url}, tmp_path)


def test_tcp_carries_it_and_its_loss_ends_the_process(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    vehicle = open_vehicle("mavlink", {"url": f"tcp:127.0.0.1:{port}"}, tmp_path)
    until(lambda: "is the simulator on?" in vehicle.trouble, vehicle.trouble)
    with socket.create_server(("127.0.0.1", port)) as server:
        server.settimeout(10)
        ours, _ = server.accept()
    ours.setblocking(False)
    autopilot = Autopilot("copter", STRICT, px4=True)

    def exchange() -> None:
        now_s = time.monotonic()
        try:
            answers = autopilot.heard(ours.recv(4096), now_s)
        except BlockingIOError:
            answers = []
        for packet in [*answers, *autopilot.told(now_s)]:
            ours.sendall(packet)
        time.sleep(0.02)

    deadline_s = time.monotonic() + 10
    while vehicle.trouble:
        assert time.monotonic() < deadline_s, vehicle.trouble
        exchange()
    with GuardLink(vehicle.hold(), tmp_path) as guard:
        before = len(autopilot.setpoints)
        guard.beat(0.0, vehicle.hold())
        while len(autopilot.setpoints) < before + 20:
            assert time.monotonic() < deadline_s + 5, "nobody is heard"
            exchange()
    ours.close()
    until(lambda: is_gone(vehicle, "connection is gone"), "the loss was not noticed")
    vehicle.close()


def is_gone(vehicle: Vehicle, text: str) -> bool:
    """Return whether the driver says so and ends its process."""
    try:
        vehicle.send(Velocity(), brake=True, lasts_s=0.17)
    except OSError as error:
        return text in str(error)
    return False


def test_a_serial_port_carries_it_and_its_loss_ends_the_process(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    name = os.ttyname(theirs)
    vehicle = open_vehicle("mavlink", {"url": f"serial:{name}:57600"}, tmp_path)
    os.close(theirs)
    autopilot = Autopilot("copter", STRICT, px4=True)
    os.set_blocking(ours, False)
    deadline_s = time.monotonic() + 10
    while vehicle.trouble:
        assert time.monotonic() < deadline_s, vehicle.trouble
        now_s = time.monotonic()
        try:
            answers = autopilot.heard(os.read(ours, 4096), now_s)
        except BlockingIOError:
            answers = []
        for packet in [*answers, *autopilot.told(now_s)]:
            os.write(ours, packet)
        time.sleep(0.02)
    hold = vehicle.hold()
    assert hold is not None
    assert hold.address is None
    os.close(ours)
    until(lambda: is_gone(vehicle, "serial port is gone"), "the loss was not noticed")
    vehicle.close()
