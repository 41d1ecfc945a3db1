"""`juncnet bench forwarding`: what layout `drone` costs a vehicle's computer.

H.264 made beforehand is sent to it over RTP at the camera's rate; another process takes the video
and commands at 25 Hz over the router. Nothing is rendered, encoded or decoded meanwhile.
"""

import argparse
import json
import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np

from juncnet.bus import Bus
from juncnet.flight import read_flight
from juncnet.frames import FrameLayout
from juncnet.launch import connect
from juncnet.messages import PixelFormat, Velocity, VelocityCommand
from juncnet.topics import CAMERA_VIDEO, COMMAND_VELOCITY
from juncnet_services.cli.bench.measured import cpu_s
from juncnet_services.cli.bench.split_flight import JUNCNET
from juncnet_services.cli.provenance import provenance
from juncnet_services.cli.supervise import Supervisor
from juncnet_services.frame_capture.h264_rtp import packetise
from juncnet_services.simulator.video import Encoder, VideoOptions

FPS = 25
PICTURES = 50
"""Made beforehand, and sent over and over; the first is a key frame."""
SHIFT_PX = 6


def access_units(width: int, height: int, bits_per_s: int) -> list[list[bytes]]:
    """Return H.264 of a pattern that moves, as NAL units, with noise enough for the bit rate."""
    rng = np.random.default_rng(1)
    coarse = rng.integers(40, 200, (height // 8, width // 8), np.uint8)
    pattern = np.kron(coarse, np.ones((8, 8), np.uint8))
    pattern = np.pad(pattern, ((0, height - pattern.shape[0]), (0, width - pattern.shape[1])))
    options = VideoOptions(bits_per_s=bits_per_s, key_frame_every_s=PICTURES / FPS)
    encoder = Encoder(FrameLayout.packed(PixelFormat.I420, width, height), FPS, options)
    units: list[list[bytes]] = []
    for number in range(PICTURES):
        luminance = np.roll(pattern, number * SHIFT_PX, axis=1)
        noisy = luminance + rng.integers(0, 24, luminance.shape, np.uint8)
        chroma = np.full(width * height // 2, 128, np.uint8)
        pixels = np.concatenate([noisy.reshape(-1), chroma])
        units.append(encoder.encode(pixels, key_frame=number == 0))
    return units


class Sender:
    """Sends the access units as RTP, in turn, each in one burst as an encoder does."""

    def __init__(self, units: list[list[bytes]], port: int) -> None:
        self._units, self._where = units, ("127.0.0.1", port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._sequence = self._number = 0
        self.sent = 0
        """Bytes."""

    def send(self) -> None:
        """Send the next access unit."""
        nals = self._units[self._number % len(self._units)]
        for datagram in packetise(nals, self._sequence, 3600 * self._number % 2**32, 7):
            self._sequence = (self._sequence + 1) % 0x10000
            self._socket.sendto(datagram, self._where)
            self.sent += len(datagram)
        self._number += 1


def command(bus: Bus) -> VelocityCommand:
    """Return a command that rests on a picture of now."""
    return VelocityCommand(header=bus.stamp(), issued=bus.stamp(), velocity=Velocity())


def measure(folder: Path, units: list[list[bytes]], seconds: float) -> dict[str, Any]:
    """Return the share of one core that each process of layout `drone` uses, in percent."""
    flight = read_flight(next(folder.glob("juncnet/*/flight.json")).parent)
    supervisor = Supervisor(flight.directory)
    address = (flight.directory / "router.endpoint").read_text().strip()
    layout = json.loads((flight.directory / "layout.json").read_text())
    sender = Sender(units, int(layout["frame_capture"]["source"]["port"]))
    with connect(address) as bus:
        video, heard = bus.subscribe(CAMERA_VIDEO, 1000), 0

        def run(duration_s: float) -> int:
            begin_s, count = time.monotonic(), 0
            for tick in range(round(duration_s * FPS)):
                sender.send()
                bus.publish(COMMAND_VELOCITY, command(bus))
                time.sleep(max(0.0, begin_s + (tick + 1) / FPS - time.monotonic()))
                count += len(video.drain())
            return count

        run(3.0)

        def used() -> dict[str, float]:
            return {s.name: cpu_s(s.pid) for s in supervisor.status() if s.pid}

        sender.sent, before, began_s = 0, used(), time.monotonic()
        heard = run(seconds)
        elapsed_s, after = time.monotonic() - began_s, used()
    shares = {name: 100 * (after[name] - before[name]) / elapsed_s for name in before}
    return {
        "cpu_percent": {name: round(share, 1) for name, share in shares.items()},
        "cpu_percent_sum": round(sum(shares.values()), 1),
        "pictures_a_second": round(heard / elapsed_s, 1),
        "megabits_a_second": round(8e-6 * sender.sent / elapsed_s, 1),
    }


def main(argv: list[str]) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(prog="juncnet bench forwarding", description=__doc__)
    parser.add_argument("--size", default="1920x1080", help="of the pictures")
    parser.add_argument("--video", type=float, default=8.0, help="of the camera [Mbit/s]")
    parser.add_argument("--seconds", type=float, default=20.0, help="to measure")
    parser.add_argument("--json", action="store_true", help="print one object")
    options = parser.parse_args(argv)
    width, height = (int(number) for number in options.size.split("x"))
    units = access_units(width, height, round(1e6 * options.video))
    folder = Path(tempfile.mkdtemp(prefix="jn-"))
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(folder)}
    settings = ["links.certificates=", "router.host=127.0.0.1", "router.port=0",
                f"launch.state_dir={folder}/state"]  # fmt: skip
    words = [word for setting in settings for word in ("--set", setting)]
    try:
        started = subprocess.run([*JUNCNET, "up", "drone", *words], env=environment, text=True,
                                 capture_output=True, check=False)  # fmt: skip
        if started.returncode:
            print(started.stderr, file=sys.stderr)
            return 1
        result = measure(folder, units, options.seconds)
    finally:
        for path in folder.glob("juncnet/*/flight.json"):
            Supervisor(path.parent).stop()
        shutil.rmtree(folder, ignore_errors=True)
    origin = provenance(["juncnet", "bench", "forwarding", *argv])
    if options.json:
        print(json.dumps(result | {"provenance": origin.model_dump(mode="json")}, indent=2))
    else:
        print(json.dumps(result, indent=2))
    return 0
