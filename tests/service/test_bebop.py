"""The Bebop's driver over loopback, with a drone in Python that speaks ARSDK3."""

import itertools
import statistics
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from bebop_drone import Drone, flying_drone
from juncnet.messages import Velocity
from juncnet_services.command_output.guard_link import GuardLink
from juncnet_services.command_output.vehicles import Vehicle, arsdk, bebop_discovery, open_vehicle
from juncnet_services.command_output.vehicles.arsdk import Buffer, FlyingState
from juncnet_services.command_output.vehicles.bebop import BebopOptions

AHEAD = Velocity(forward_mps=1.0)


@contextmanager
def driving(drone: Drone, tmp_path: Path, **options: Any) -> Generator[Vehicle]:
    own = {"address": "127.0.0.1", "discovery_port": drone.port, "events_port": 0}
    vehicle = open_vehicle("bebop", own | options, tmp_path)
    try:
        yield vehicle
    finally:
        vehicle.close()


def until(condition: Callable[[], bool], what: str, timeout_s: float = 10.0) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, what
        time.sleep(0.005)


def airborne(drone: Drone, vehicle: Vehicle) -> None:
    until(lambda: vehicle.trouble == "", "not connected")
    vehicle.take_off()
    until(lambda: drone.body.state is FlyingState.HOVERING, "did not take off")
    until(lambda: (seen := vehicle.telemetry(0.2)) is not None and seen.flying, "no telemetry")


def drive(vehicle: Vehicle, seconds: float) -> None:
    """Command as command_output does, at 25 Hz."""
    for _ in range(round(seconds / 0.04)):
        vehicle.send(AHEAD, brake=False, lasts_s=0.17)
        time.sleep(0.04)


def pcmds(drone: Drone) -> list[tuple[float, bytes]]:
    return [(t, p) for t, _, _, p in list(drone.commands) if p[:4] == arsdk.pcmd()[:4]]


def test_a_flight_from_connection_to_landing(tmp_path: Path) -> None:
    with flying_drone() as drone:
        with driving(drone, tmp_path, at_end="land") as vehicle:
            airborne(drone, vehicle)
            began_s = time.monotonic()
            drive(vehicle, 2.0)
            sent = [t for t, _ in pcmds(drone) if t >= began_s]
            # The usual distance: a busy machine delays some, and has fewer in all.
            usual_s = statistics.median(b - a for a, b in itertools.pairwise(sent))
            assert 1 / usual_s == pytest.approx(20, abs=1)
            assert drone.body.body_speed()[0] > 0.5
            seen = vehicle.telemetry(0.2)
            assert seen is not None
            assert seen.battery == 0.87
            assert drone.pongs > 0
            assert {buffer for buffer, _ in drone.acks} == {254}
        assert arsdk.LANDING in drone.payloads(Buffer.WITH_ACK)
        # What is not acknowledged in time on a busy machine is sent again.
        setup = list(dict.fromkeys(drone.payloads(Buffer.WITH_ACK)))[:2]
        assert setup == [arsdk.ALL_SETTINGS, arsdk.ALL_STATES]
        assert arsdk.VIDEO_ON in drone.payloads(Buffer.WITH_ACK)
        assert drone.request["arstream2_client_stream_port"] == 55004


def test_a_hold_leaves_at_once_and_the_watchdog_holds_by_itself(tmp_path: Path) -> None:
    with flying_drone() as drone, driving(drone, tmp_path) as vehicle:
        airborne(drone, vehicle)
        drive(vehicle, 1.0)
        last_s = time.monotonic()
        until(lambda: pcmds(drone)[-1][1] == arsdk.pcmd(), "no hover")
        assert pcmds(drone)[-1][0] - last_s < 0.25
        drive(vehicle, 0.5)
        vehicle.send(Velocity(), brake=True, lasts_s=0.17)
        told_s = time.monotonic()
        until(lambda: pcmds(drone)[-1][1] == arsdk.pcmd(), "no hover")
        assert pcmds(drone)[-1][0] - told_s < 0.15


def test_the_guards_packets_are_obeyed_by_the_drone(tmp_path: Path) -> None:
    with flying_drone() as drone, driving(drone, tmp_path) as vehicle:
        airborne(drone, vehicle)
        drive(vehicle, 0.5)
        with GuardLink(vehicle.hold(), tmp_path) as guard:
            guard.beat(0.0, vehicle.hold())

            def lately() -> int:
                return sum(t > time.monotonic() - 0.5 for t, _ in pcmds(drone))

            # Those of the guard, 20 a second, come beside those of the driver.
            until(lambda: lately() >= 15, "the guard is not heard")


def test_a_refusal_is_named_with_its_remedy_and_tried_again(tmp_path: Path) -> None:
    with flying_drone(Drone(status=-3000)) as drone, driving(drone, tmp_path) as vehicle:
        until(lambda: "another controller has it" in vehicle.trouble, vehicle.trouble)
        drone.status = 0
        until(lambda: vehicle.trouble == "", "not connected")


def test_a_drone_that_announces_itself_is_found(tmp_path: Path) -> None:
    zeroconf = pytest.importorskip("zeroconf", reason="extra [bebop] is not installed")
    with flying_drone() as drone, zeroconf.Zeroconf(interfaces=["127.0.0.1"]) as network:
        own = {"address": "discover", "events_port": 0}
        vehicle = open_vehicle("bebop", own, tmp_path)
        until(lambda: "announces itself" in vehicle.trouble, vehicle.trouble)
        network.register_service(announcement(zeroconf, "Bebop2-1", drone.port))
        until(lambda: vehicle.trouble == "", vehicle.trouble)
        vehicle.close()
        network.register_service(announcement(zeroconf, "Bebop2-2", drone.port))
        with pytest.raises(
            ConnectionError, match=r"Bebop2-1 at .*, Bebop2-2 at .*name the address"
        ):
            bebop_discovery.find(3.0)


def announcement(zeroconf: Any, name: str, port: int) -> Any:
    """Return what a Bebop of this name announces."""
    return zeroconf.ServiceInfo(
        bebop_discovery.SERVICE,
        f"{name}.{bebop_discovery.SERVICE}",
        addresses=[bytes([127, 0, 0, 1])],
        port=port,
        server=f"{name}.local.",
    )


def test_without_zeroconf_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bebop_discovery, "is_installed", lambda: False)
    with pytest.raises(ValueError, match=r"name the address, or .*\[bebop\]"):
        BebopOptions(address="discover")


def test_no_drone_is_named_with_its_remedy_and_survived(tmp_path: Path) -> None:
    with flying_drone() as drone:
        port = drone.port
    vehicle = open_vehicle("bebop", {"address": "127.0.0.1", "discovery_port": port}, tmp_path)
    until(lambda: "in its WiFi?" in vehicle.trouble, vehicle.trouble)
    vehicle.send(AHEAD, brake=False, lasts_s=0.17)
    vehicle.close()


def test_a_drone_that_goes_silent_is_connected_anew(tmp_path: Path) -> None:
    with flying_drone() as drone, driving(drone, tmp_path) as vehicle:
        until(lambda: vehicle.trouble == "", "not connected")
        drone.silent = True
        until(lambda: "silent" in vehicle.trouble, "not noticed")
        drone.silent = False
        until(lambda: drone.connections == 2 and vehicle.trouble == "", "not connected anew")


def test_video_is_as_chosen(tmp_path: Path) -> None:
    with flying_drone() as drone, driving(drone, tmp_path, video="720p", video_port=56000):
        told = drone.payloads
        until(lambda: arsdk.VIDEO_ON in told(Buffer.WITH_ACK), "no video")
        assert arsdk.video_resolutions(stream_720=True) in told(Buffer.WITH_ACK)
        assert drone.request["arstream2_client_stream_port"] == 56000


def test_options_that_do_not_exist_are_named() -> None:
    with pytest.raises(ValueError, match="adress"):
        BebopOptions.model_validate({"adress": "192.168.42.1"})
