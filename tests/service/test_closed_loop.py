"""Whole flights in simulated time: the shipped model and follower, through the cores of all."""

import random

import cv2
import pytest

from juncnet.camera import CameraGeometry
from juncnet.messages import Mission, Turn, Velocity
from juncnet_services.cli.closed_loop import LATE, ClosedLoop
from juncnet_services.cli.demo import prepare
from juncnet_services.cli.judge import Summary

SEED = 16
MISSION = Mission(
    name="short", turns=(Turn(at=1, turn="right"), Turn(at=2, turn="left")), finish_after=3
)
SIZE = ("simulator.width=320", "simulator.height=180")


def fly(vehicle: str, seed: int, *settings: str, mission: Mission | None = None) -> Summary:
    """Return the summary of one flight, and fail when anything was refused in it."""
    cv2.setNumThreads(1)  # as in the services
    loop = ClosedLoop(prepare(vehicle, None, seed, mission, (*SIZE, *settings)))
    summary = loop.fly()
    assert loop.trace.errors == []
    return summary


def test_flown_right() -> None:
    summary = fly("copter", SEED, mission=MISSION)
    assert summary.flown_right, summary
    assert summary.junctions_counted == summary.junctions_true == 3


def test_commands_come_late_as_drawn_and_in_order() -> None:
    setup = prepare("copter", None, SEED, MISSION, SIZE)
    loop = ClosedLoop(setup, lateness=random.Random(1))
    sent = [0.001 * number for number in range(1, 400)]
    came = [loop.command_at_vehicle(Velocity(forward_mps=mps)).forward_mps for mps in sent]
    assert came == sorted(came)
    late = [round((mps - vehicle) / 0.001) for mps, vehicle in zip(sent, came, strict=True)]
    assert set(late) == set(range(len(LATE)))


def at_height(height_m: float) -> str:
    """Return the setting of a camera at this height, told to all who ask for it."""
    camera = CameraGeometry()
    return (
        f"shared.camera={{height_m = {height_m}, pitch_rad = {camera.pitch_rad}, "
        f"horizontal_fov_rad = {camera.horizontal_fov_rad}}}"
    )


@pytest.mark.full
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("height_m", [2.0, 3.0, 4.5])
def test_camera_heights(height_m: float, seed: int) -> None:
    summary = fly("copter", seed, at_height(height_m))
    assert summary.flown_right, summary


@pytest.mark.full
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("cruise_mps", [2.0, 3.0, 4.0])
def test_speeds(cruise_mps: float, seed: int) -> None:
    summary = fly("copter", seed, f"junction_navigation.cruise_mps={cruise_mps}")
    # The time that a flight may take is for 3 m/s: at 2 m/s all but the time must be right.
    slower = min(1.0, cruise_mps / 3.0)
    reasons = [r for r in summary.reasons if not (slower < 1 and r.startswith("took"))]
    assert reasons == [], summary
    assert summary.time_s < 1.5 * summary.ideal_time_s / slower


@pytest.mark.full
@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("speed_error", [0.8, 1.2])
@pytest.mark.parametrize("telemetry", ["true", "false"])
def test_a_speed_error_with_and_without_telemetry(
    speed_error: float, seed: int, telemetry: str
) -> None:
    options = f'command_output.options={{kind = "copter", telemetry = {telemetry}}}'
    summary = fly("copter", seed, f"simulator.speed_error={speed_error}", options)
    assert summary.flown_right, summary


@pytest.mark.full
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_rover(seed: int) -> None:
    summary = fly("rover", seed)
    assert summary.flown_right, summary
