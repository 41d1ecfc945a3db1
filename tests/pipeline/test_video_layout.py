"""`juncnet up video`: an H.264 file as camera, a vehicle that only logs; `down` leaves nothing."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import TypeVar

import av
import cv2
import numpy as np
import pytest
from av.video.frame import VideoFrame

from flights import START_LIMIT_S
from juncnet.bus import Bus
from juncnet.camera import CameraGeometry
from juncnet.flight import Flight
from juncnet.iceoryx_node import SHARED_MEMORY
from juncnet.launch import connect
from juncnet.messages import Message, Output
from juncnet.simulation.render import Renderer
from juncnet.simulation.towns import random_world
from juncnet.topics import (
    CAMERA_FRAME,
    CAMERA_IMAGE,
    CAMERA_VIDEO,
    COMMAND_VELOCITY,
    JUNCTION_SCORE,
    MODEL_ACTIVE,
    RADON_FEATURES,
    ROAD_COMMAND,
    VEHICLE_STATE,
    Topic,
)
from juncnet_services.cli import down, status, up
from juncnet_services.cli.local_flights import all_flights, pids_of, running_flights
from videos import FPS, add_h264, encode, mux

M = TypeVar("M", bound=Message)
SIZE = 1920, 1080
SECONDS, SPEED_MPS = 5, 2.0
CAMERA = "{ height_m = 3.0, pitch_rad = 0.349, horizontal_fov_rad = 1.396 }"
TAKE_S = 30.0


def drive() -> Iterator[VideoFrame]:
    """Yield what a copter sees that flies straight on from a world's start."""
    width, height = SIZE
    world = random_world(5)
    start = world.start
    renderer = Renderer(world, width, height, CameraGeometry(aspect=width / height))
    for index in range(FPS * SECONDS):
        ahead_m = SPEED_MPS * index / FPS
        x_m = start.x_m + ahead_m * math.cos(start.yaw_rad)
        y_m = start.y_m + ahead_m * math.sin(start.yaw_rad)
        pixels = renderer.render_i420(x_m, y_m, start.yaw_rad)
        yield VideoFrame.from_ndarray(pixels.reshape(height * 3 // 2, width), format="yuv420p")


def write_drive(path: Path) -> Path:
    """Write `drive` to a file as H.264."""
    with av.open(str(path), "w") as container:
        for packet in encode(add_h264(container, *SIZE), drive()):
            mux(container, packet)
    return path


def taken(bus: Bus, topic: Topic[M], count: int) -> list[M]:
    """Return `count` messages of a topic."""
    inbox = bus.subscribe(topic, count)
    found = [inbox.take(TAKE_S) for _ in range(count)]
    return [message for message in found if message is not None]


def check_pictures(bus: Bus) -> None:
    """Fail unless raw pictures, JPEG pictures and H.264 arrive, in the size of the file."""
    frames = bus.frames_in(CAMERA_FRAME)
    with frames.take(TAKE_S) as frame:
        assert frame is not None
        assert (frame.layout.width, frame.layout.height) == SIZE
        assert frame.luminance().std() > 5
    images = taken(bus, CAMERA_IMAGE, 3)
    assert len(images) == 3
    for image in images:
        decoded = cv2.imdecode(np.frombuffer(image.payload, np.uint8), cv2.IMREAD_COLOR)
        assert decoded is not None
        assert decoded.shape == (image.height, image.width, 3)
    assert any(packet.key_frame for packet in taken(bus, CAMERA_VIDEO, 2 * FPS))


def check_pipeline(bus: Bus) -> None:
    """Fail unless features, scores, road commands and velocities follow from the pictures."""
    (active,) = taken(bus, MODEL_ACTIVE, 1)
    features = taken(bus, RADON_FEATURES, 5)
    assert {feature.preprocessing for feature in features} == {active.preprocessing_hash}
    assert all(score.model == active.model for score in taken(bus, JUNCTION_SCORE, 5))
    roads = taken(bus, ROAD_COMMAND, 50)
    assert sum(road.velocity is not None for road in roads) > 25
    commands = taken(bus, COMMAND_VELOCITY, 50)
    assert max(command.velocity.forward_mps for command in commands) > 0.5
    states = taken(bus, VEHICLE_STATE, 10)
    assert len(states) == 10
    assert not any(state.capabilities.telemetry for state in states)
    assert {state.output for state in states} <= {Output.PIPELINE, Output.HOLD}


def shared_memory_of(flight: Flight) -> list[str]:
    """Return what lies in this host's shared memory under the flight's name."""
    return sorted(path.name for path in SHARED_MEMORY.glob(f"{flight.tag}*"))


def test_up_video_works_and_down_leaves_nothing(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = (
        f'frame_capture.source.path="{write_drive(tmp_path / "drive.mp4")}"',
        f"shared.camera={CAMERA}",
        f'launch.state_dir="{folder}/state"',
    )
    options = [word for setting in settings for word in ("--set", setting)]
    assert up.main(["video", "--timeout", str(START_LIMIT_S), *options]) == 0
    (flight,) = running_flights()
    with connect(flight.directory) as bus:
        check_pictures(bus)
        check_pipeline(bus)
    capsys.readouterr()
    assert status.main(["--json"]) == 0
    (found,) = json.loads(capsys.readouterr().out)
    assert found["well"]
    assert {row["process"] for row in found["processes"]} == set(flight.processes)
    pids = pids_of(flight)
    assert len(pids) == len(flight.processes)
    assert down.main([]) == 0
    assert not any(Path("/proc", str(pid)).exists() for pid in pids)
    assert all_flights() == []
    assert not flight.directory.exists()
    assert shared_memory_of(flight) == []
