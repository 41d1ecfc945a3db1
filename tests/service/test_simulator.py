"""The simulator with a fake bus: it flies what it hears, shows it and tells the truth."""

import socket
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import pytest
from pydantic import ValidationError

from fakes import FakeBus
from juncnet.simulation import link
from juncnet.simulation.dynamics import Copter, Motion
from juncnet_services.simulator.drone import Drone
from juncnet_services.simulator.service import run
from juncnet_services.simulator.setup import Config, make_camera, make_world

SMALL = Config(world="crossing_town", width=320, height=180, drift=False)
S = 1_000_000_000


@contextmanager
def client(directory: Path) -> Generator[socket.socket, None, None]:
    end = link.open_client(directory)
    try:
        yield end
    finally:
        end.close()


def test_flies_shows_and_tells(tmp_path: Path) -> None:
    with client(tmp_path) as end:

        def fly(bus: FakeBus) -> None:
            end.sendto(
                link.encode(link.Setpoint(forward_mps=3.0)), str(link.server_address(tmp_path))
            )
            end.setblocking(True)
            end.settimeout(10.0)
            bus.clock.advance(0.04)
            link.decode_telemetry(end.recv(link.MAX_DATAGRAM))

        script: list[float | Callable[[FakeBus], None]] = [fly, *[0.04] * 50]
        bus = FakeBus(script, "simulator", tmp_path)
        run(bus, SMALL)
    truths, frames = bus.published["simulator/truth"], bus.frames["simulator/camera"]
    assert len(frames) > 40
    assert [f.header.sequence for f in frames] == list(range(1, len(frames) + 1))
    assert frames[-1].luminance().std() > 5.0
    first, last = truths[0], truths[-1]
    start = make_world(SMALL).start
    assert (first.pose.x_m, first.pose.y_m) == pytest.approx((start.x_m, start.y_m))
    assert first.path == last.path != ()
    assert last.velocity.forward_mps == pytest.approx(3.0, abs=0.1)
    assert first.mouth_m - last.mouth_m == pytest.approx(4.3, abs=0.7)
    assert last.header in [frame.header for frame in frames]
    assert last.real_time_factor > 0.9
    assert bus.health.counters["real_time_factor"] == last.real_time_factor
    assert not link.server_address(tmp_path).exists()


def test_malformed_datagrams_are_counted_and_survived(tmp_path: Path) -> None:
    drone = Drone(Copter(), Motion(0, 0, 3, 0), 10.0, 0, airborne=True)
    drone.hear(b"nonsense", "a", 0)
    drone.hear(b'{"type":"setpoint","forward_mps":"x"}', None, 0)
    assert len(drone.take_errors()) == 2
    assert drone.take_errors() == []
    drone.hear(link.encode(link.Setpoint(forward_mps=1.0)), "a", 0)
    assert drone.at(S // 4).forward_mps > 0.0


def flown(drone: Drone, begin_s: float, end_s: float) -> Motion:
    for tenth in range(round(begin_s * 10), round(end_s * 10) + 1):
        drone.at(tenth * S // 10)
    return drone.at(round(end_s * S))


def test_keeps_its_last_setpoint_until_the_link_is_lost() -> None:
    drone = Drone(Copter(), Motion(0, 0, 3, 0), 2.0, 0, airborne=True)
    drone.hear(link.encode(link.Setpoint(forward_mps=2.0)), None, 0)
    assert flown(drone, 0.0, 1.9).forward_mps == pytest.approx(2.0, abs=0.05)
    assert flown(drone, 1.9, 5.0).forward_mps == pytest.approx(0.0, abs=0.05)
    assert drone.simulated_s == pytest.approx(5.0)


def test_a_stall_loses_simulated_time() -> None:
    drone = Drone(Copter(), Motion(0, 0, 3, 0), 2.0, 0, airborne=True)
    drone.at(3 * S)
    assert drone.simulated_s == pytest.approx(0.5)


def test_telemetry_goes_to_those_heard_of_late() -> None:
    drone = Drone(Copter(), Motion(1, 2, 3, 7.0), 10.0, 0, airborne=True)
    drone.hear(link.encode(link.Hello()), "early", 0)
    drone.hear(link.encode(link.Hello()), "late", 3 * S)
    datagram, listeners = drone.telemetry(3 * S)
    assert listeners == ["late"]
    telemetry = link.decode_telemetry(datagram)
    assert (telemetry.x_m, telemetry.time_ns, telemetry.flying) == (1.0, 3 * S, True)
    assert telemetry.yaw_rad == pytest.approx(7.0 - 6.283185, abs=1e-5)


def test_configuration_names_worlds_and_looks() -> None:
    look = Config(world="tee_village", palette="withheld", time_of_day="evening")
    assert make_world(look).style.palette == "withheld"
    assert make_world(Config(seed=7)).name == "random-7"
    rover = make_camera(Config(vehicle="rover", width=640, height=480))
    assert (rover.height_m, rover.aspect) == (2.2, pytest.approx(4 / 3))
    with pytest.raises(ValidationError, match="crossing_town"):
        Config(world="atlantis")
    with pytest.raises(ValidationError, match="speeed"):
        Config.model_validate({"speeed": 1})
