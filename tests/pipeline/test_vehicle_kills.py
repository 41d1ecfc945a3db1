"""A real command_output flies each vehicle and is killed in flight: it is held in time."""

import math
import os
import signal
import socket
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import pytest

from bebop_drone import Drone, flying_drone
from juncnet.messages import OverrideKind, Velocity
from juncnet.simulation.dynamics import CALM, Copter, Motion
from juncnet_services.command_output.vehicles import arsdk
from juncnet_services.simulator.drone import Drone as SimulatedDrone
from vehicle_rig import Rig, rig, until

AHEAD = Velocity(forward_mps=1.0)
LIMIT_S = 0.2


@dataclass
class Watched:
    """A vehicle of a test: its setpoints (when, whether it is a hold), and how fast it is."""

    setpoints: Callable[[], list[tuple[float, bool]]]
    speed_mps: Callable[[], float]
    height_m: Callable[[], float]


@contextmanager
def bebop() -> Generator[tuple[str, Watched]]:
    with flying_drone(Drone()) as drone:

        def setpoints() -> list[tuple[float, bool]]:
            told = [(t, p) for t, _, _, p in list(drone.commands) if p[:4] == arsdk.pcmd()[:4]]
            return [(t, p[4] == 0) for t, p in told]

        options = f"address = '127.0.0.1'\ndiscovery_port = {drone.port}\nevents_port = 0\n"
        body = drone.body
        yield (
            f"[command_output]\nvehicle = 'bebop'\n[command_output.options]\n{options}",
            Watched(setpoints, lambda: math.hypot(*body.body_speed()), lambda: 1.0),
        )


@contextmanager
def px4() -> Generator[tuple[str, Watched]]:
    pytest.importorskip("pymavlink", reason="extra [mavlink] is not installed")
    from autopilot import STRICT, Autopilot, flying

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("127.0.0.1", 0))
        port = link.getsockname()[1]
    pilot = Autopilot("copter", STRICT, px4=True)
    with flying(pilot, port):

        def setpoints() -> list[tuple[float, bool]]:
            return [(t, math.hypot(m.vx, m.vy) == 0) for t, m in list(pilot.setpoints)]

        options = f"url = 'udpin:127.0.0.1:{port}'\ntake_off_m = 1.0\n"
        yield (
            f"[command_output]\nvehicle = 'mavlink'\n[command_output.options]\n{options}",
            Watched(setpoints, lambda: math.hypot(*pilot.velocity[:2]), lambda: pilot.height_m),
        )


VEHICLES = [pytest.param(bebop, id="bebop"), pytest.param(px4, id="px4")]


def fly(run: Rig, seen: Watched) -> None:
    """Take off, resume, and go ahead."""
    run.ready()
    until(lambda: (s := run.state()) is not None and s.flying, "does not fly")
    until(lambda: seen.height_m() > 0.8, "does not climb")
    time.sleep(1.5)
    assert run.order(OverrideKind.RESUME).accepted
    run.velocity = AHEAD
    until(lambda: seen.speed_mps() > 0.7, "does not go ahead")


def holds_after_s(seen: Watched, since_s: float) -> float:
    """Return when the first hold after `since_s` came, from which on there were only holds."""

    def last_move() -> int:
        return max(i for i, (_, hold) in enumerate(seen.setpoints()) if not hold)

    until(lambda: len(seen.setpoints()) > last_move() + 5, "no holds", 5.0)
    return seen.setpoints()[last_move() + 1][0] - since_s


@pytest.mark.parametrize("vehicle", VEHICLES)
@pytest.mark.parametrize(
    "blow", [signal.SIGKILL, pytest.param(signal.SIGSTOP, marks=pytest.mark.full)]
)
def test_a_killed_or_hanging_command_output_is_held_in_time(vehicle: Any, blow: int) -> None:
    with vehicle() as (layout, seen), rig(layout) as run:
        fly(run, seen)
        os.kill(run.process.pid, blow)
        last_s = run.last_sent_s
        assert holds_after_s(seen, last_s) < LIMIT_S
        height_m = seen.height_m()
        until(lambda: seen.speed_mps() < 0.15, "does not come to rest")
        assert seen.height_m() == pytest.approx(height_m, abs=0.15)


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_a_successor_flies_on(vehicle: Any) -> None:
    with vehicle() as (layout, seen), rig(layout) as run:
        fly(run, seen)
        run.process.kill()
        run.process.wait(5)
        until(lambda: seen.speed_mps() < 0.15, "does not come to rest")
        run.velocity = None
        run.process = run.start()
        run.velocity = AHEAD
        time.sleep(0.5)

        def goes() -> bool:
            state = run.state()
            if state is not None and "operator resumes" in state.output_reason:
                run.order(OverrideKind.RESUME)
            return seen.speed_mps() > 0.7

        until(goes, "does not fly on")


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_an_ordered_end_leaves_it_held(vehicle: Any) -> None:
    with vehicle() as (layout, seen), rig(layout) as run:
        fly(run, seen)
        run.process.terminate()
        assert run.process.wait(10) == 0
        assert seen.setpoints()[-1][1]
        until(lambda: seen.speed_mps() < 0.15, "does not come to rest")


def both_dead(run: Rig) -> float:
    """Kill the guard and command_output at once; return when."""
    guard = run.guard()
    guard.kill()
    run.process.kill()
    return time.monotonic()


@pytest.mark.full
def test_both_dead_a_bebop_keeps_its_last_pcmd() -> None:
    with bebop() as (layout, seen), rig(layout) as run:
        fly(run, seen)
        dead_s = both_dead(run)
        while time.monotonic() < dead_s + 3:
            assert seen.speed_mps() > 0.5
            time.sleep(0.05)
        assert seen.setpoints()[-1][0] < dead_s + 0.1


@pytest.mark.full
def test_both_dead_an_autopilot_does_what_its_parameters_say() -> None:
    with px4() as (layout, seen), rig(layout) as run:
        fly(run, seen)
        dead_s = both_dead(run)
        until(lambda: seen.speed_mps() < 0.3, "does not come to rest")
        assert 0.9 < time.monotonic() - dead_s < 3.0  # COM_OF_LOSS_T is 1


@pytest.mark.full
def test_both_dead_the_simulated_vehicle_goes_on_for_its_time() -> None:
    with rig("[command_output]\nvehicle = 'simulated'\n") as run:
        start = Motion(0.0, 0.0, 3.0, 0.0)
        drone = SimulatedDrone(Copter(drift=CALM), start, 2.0, time.monotonic_ns(), True)

        def speed_mps() -> float:
            return drone.at(time.monotonic_ns()).forward_mps

        with drone.linked(run.flight.directory, time.monotonic_ns):
            run.velocity = AHEAD
            until(lambda: speed_mps() > 0.7, "does not go ahead")
            dead_s = both_dead(run)
            while time.monotonic() < dead_s + 1.5:
                assert speed_mps() > 0.5
                time.sleep(0.02)
            until(lambda: speed_mps() < 0.1, "does not hover")
            assert time.monotonic() - dead_s > 1.8
