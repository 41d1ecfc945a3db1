"""Layout `bebop`: its driver has the drone send video, and frame_capture shows it whole."""

import itertools
import os
import subprocess
import sys
import time
from collections.abc import Callable, Generator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from bebop_drone import Drone, flying_drone
from juncnet import links
from juncnet.assets import asset_path
from juncnet.flight import new_flight
from juncnet.topics import CAMERA_FRAME, CAMERA_VIDEO
from juncnet.zenoh_bus import ZenohBus
from juncnet_services.command_output.vehicles import arsdk
from videos import band_of, free_port, sender

PROCESSES = ("frame_capture", "command_output", "radon_preprocessing")
LIMIT_S = 40.0
SIZES = {"480p": (856, 480), "720p": (1280, 720)}


@contextmanager
def started(directory: Path, settings: list[str]) -> Generator[None]:
    """Run the two processes of the layout that have to do with the drone."""
    with ExitStack() as stack:
        for name in PROCESSES[:2]:
            command = [sys.executable, "-m", f"juncnet_services.{name}"]
            command += ["--layout", str(asset_path("bebop", "layouts", ".toml"))]
            command += ["--flight-dir", str(directory)]
            for setting in settings:
                command += ["--set", setting]
            process = subprocess.Popen(command, env=dict(os.environ))
            stack.callback(process.wait, 10)
            stack.callback(process.terminate)
        yield


def until(condition: Callable[[], bool], what: str) -> None:
    deadline_s = time.monotonic() + LIMIT_S
    while not condition():
        assert time.monotonic() < deadline_s, what
        time.sleep(0.02)


@pytest.mark.parametrize("video", ["480p", pytest.param("720p", marks=pytest.mark.full)])
def test_the_drones_video_is_the_camera_of_its_layout(folder: Path, video: str) -> None:
    port, flight = free_port(), new_flight("bebop", PROCESSES, folder)
    settings = [
        f"launch.state_dir={folder}/state",
        f"frame_capture.source.port={port}",
        "frame_capture.source.address=127.0.0.1",
        "command_output.options.address=127.0.0.1",
        "command_output.options.events_port=0",
        f"command_output.options.video_port={port}",
        f"command_output.options.video={video}",
    ]
    with (
        flying_drone(Drone()) as drone,
        ZenohBus(links.member(flight, PROCESSES[2]), flight, PROCESSES[2], folder) as bus,
    ):
        frames, units = bus.frames_in(CAMERA_FRAME), bus.subscribe(CAMERA_VIDEO, 1000)
        settings.append(f"command_output.options.discovery_port={drone.port}")
        with started(flight.directory, settings):
            until(
                lambda: arsdk.VIDEO_ON in drone.payloads(), "the drone was not told to send video"
            )
            assert arsdk.video_resolutions(video == "720p") in drone.payloads()
            told = int(str(drone.request["arstream2_client_stream_port"]))
            with sender(f"rtp://127.0.0.1:{told}", "rtp", SIZES[video]):
                bands: list[int] = []
                deadline_s = time.monotonic() + LIMIT_S
                while len(bands) < 15:
                    assert time.monotonic() < deadline_s, f"{len(bands)} pictures"
                    with frames.take(0.2) as frame:
                        if frame is not None:
                            assert (frame.width, frame.height) == SIZES[video]
                            bands.append(band_of(frame.luminance()))
            # Pictures move on: the band goes down, and begins anew at the top.
            assert all(a != b for a, b in itertools.pairwise(bands))
            assert any(unit.key_frame for _, unit in units.drain())
