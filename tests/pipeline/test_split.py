"""Drone and laptop as two flights on this host, linked by the drone's router over TCP."""

import random
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Generator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from av.video.codeccontext import VideoCodecContext
from av.video.frame import PictureType

import peers
from juncnet import links
from juncnet import topics as t
from juncnet.flight import Flight, read_flight
from juncnet.identity import read_identity
from juncnet.messages import (
    Override,
    OverrideKind,
    Reply,
    SetMission,
    Velocity,
    VelocityCommand,
)
from juncnet.zenoh_bus import ZenohBus
from juncnet_services.frame_capture.h264 import split_annex_b
from juncnet_services.frame_capture.h264_rtp import packetise
from juncnet_services.frame_capture.remote import RemoteCamera
from juncnet_services.frame_capture.rtp import is_picture_loss_indication
from vehicle_side import certificates as make_certificates

HEAVY = ("torch", "onnxruntime", "skimage", "cv2", "av", "iceoryx2", "supervisor", "rich")
BLOCKED = f"""
import runpy, sys
from importlib.machinery import PathFinder
class Without:
    @staticmethod
    def find_spec(name, path=None, target=None):
        absent = name.partition(".")[0] in {HEAVY!r}
        return None if absent else PathFinder.find_spec(name, path, target)
sys.meta_path = [Without if finder is PathFinder else finder for finder in sys.meta_path]
sys.argv[0] = sys.argv[1]
runpy.run_module(sys.argv.pop(1), run_name="__main__", alter_sys=True)
"""
"""Runs a module where only the drone's dependencies are installed."""
LIMIT_S = 60.0
WIDTH, HEIGHT = 320, 180


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class CameraOnTheNetwork:
    """Sends H.264 over RTP at 25 pictures a second; key frames at first and when asked only."""

    def __init__(self, port: int) -> None:
        self._where = ("127.0.0.1", port)
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.asked = self.sent = 0

    def __enter__(self) -> "CameraOnTheNetwork":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        self._socket.close()

    def _run(self) -> None:
        context = av.CodecContext.create("libx264", "w")
        assert isinstance(context, VideoCodecContext)
        context.width, context.height, context.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        context.framerate, context.time_base = Fraction(25), Fraction(1, 25)
        context.gop_size, context.thread_count = 10_000, 1
        context.options = {"preset": "ultrafast", "tune": "zerolatency", "forced-idr": "1"}
        rng, sequence = np.random.default_rng(1), 0
        while not self._ended.wait(0.04):
            pixels = rng.integers(0, 255, (HEIGHT * 3 // 2, WIDTH), np.uint8)
            frame = av.VideoFrame.from_ndarray(pixels, format="yuv420p")
            frame.pts = self.sent
            if self._was_asked():
                frame.pict_type = PictureType.I
            packets: list[Any] = context.encode(frame)  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
            nals = [nal for packet in packets for nal in split_annex_b(bytes(packet))]
            for datagram in packetise(nals, sequence, 3600 * self.sent, 7):
                self._socket.sendto(datagram, self._where)
                sequence = (sequence + 1) % 0x10000
            self.sent += 1

    def _was_asked(self) -> bool:
        try:
            found = is_picture_loss_indication(self._socket.recv(2048))
        except OSError:
            return False
        self.asked += found
        return found


@dataclass
class Split:
    """Where the two sides meet; `certificates`: a folder a role, None for plain links."""

    folder: Path
    ports: tuple[int, int]
    camera: CameraOnTheNetwork
    certificates: Path | None

    def laptop(self, service: str, others: Sequence[str] = ()) -> ZenohBus:
        """Return the bus of a process of the laptop's side."""
        flight = Flight("laptop", self.folder / "laptop", "robot", (service, *others))
        flight.directory.mkdir(exist_ok=True)
        role = "operator" if service == "operator" else "navigation"
        identity = self.certificates and read_identity(self.certificates / role)
        remote = links.remote(*(f"127.0.0.1:{port}" for port in self.ports), identity=identity)
        settings = links.member(flight, service)
        return ZenohBus(settings, flight, service, self.folder, "zenoh", remote)


@contextmanager
def drone(
    folder: Path, ports: tuple[int, int], rtp: int, certificates: Path | None
) -> Generator[Flight]:
    """The drone's side, started where no library for pictures is installed."""
    directory = folder / "drone"
    settings = [
        f"links.certificates={certificates / 'drone' if certificates else ''}",
        "router.host=127.0.0.1",
        f"router.port={ports[0]}",
        f"router.video_port={ports[1]}",
        f"frame_capture.source.port={rtp}",
        "frame_capture.source.address=127.0.0.1",
        f"launch.state_dir={directory}/state",
    ]
    options = ["--layout", "drone", "--flight-dir", str(directory)]
    options += [word for setting in settings for word in ("--set", setting)]
    services = ("frame_capture", "command_output", "router")
    processes = [
        subprocess.Popen([sys.executable, "-c", BLOCKED, f"juncnet_services.{name}", *options])
        for name in services
    ]
    try:
        assert peers.eventually((directory / "router.endpoint").exists, LIMIT_S)
        yield read_flight(directory)
        assert [process.poll() for process in processes] == [None] * len(services)
    finally:
        for process in processes:
            process.terminate()
        assert [process.wait(20) for process in processes] == [0] * len(services)


def command(bus: ZenohBus, forward_mps: float) -> VelocityCommand:
    return VelocityCommand(
        header=bus.stamp(), issued=bus.stamp(), velocity=Velocity(forward_mps=forward_mps)
    )


@pytest.fixture(name="split", params=["plain", "certificates"])
def _split(folder: Path, request: pytest.FixtureRequest) -> Generator[Split]:
    certificates = make_certificates(folder / "roles") if request.param != "plain" else None
    ports, rtp = (free_port(), free_port()), free_port(socket.SOCK_DGRAM)
    with ExitStack() as stack:
        stack.enter_context(drone(folder, ports, rtp, certificates))
        camera = stack.enter_context(CameraOnTheNetwork(rtp))
        yield Split(folder, ports, camera, certificates)


def test_a_drone_without_libraries_for_pictures_shows_its_camera_and_obeys(
    split: Split,
) -> None:
    # The stream has one key frame, its first picture: who joins later has to ask for another.
    assert peers.eventually(lambda: split.camera.sent >= 25, LIMIT_S)
    assert split.camera.asked == 0
    with split.laptop("frame_capture", ["junction_navigation"]) as eyes:
        camera = RemoteCamera(eyes, 2.0)
        pictures: list[tuple[int, str]] = []
        deadline = time.monotonic() + LIMIT_S
        while len(pictures) < 20 and time.monotonic() < deadline:
            with camera.take(0.2) as picture:
                if picture is not None and picture.header is not None:
                    pictures.append((picture.header.sequence, picture.header.clock))
                    assert (picture.layout.width, picture.layout.height) == (WIDTH, HEIGHT)
        assert len(pictures) == 20
        assert pictures == sorted(pictures)
        assert split.camera.asked > 0
    with split.laptop("junction_navigation", ["frame_capture"]) as navigation:
        states = navigation.subscribe(t.VEHICLE_STATE)

        def obeyed() -> bool:
            navigation.publish(t.COMMAND_VELOCITY, command(navigation, 1.0))
            state = states.take(0.04)
            return state is not None and state.commanded.forward_mps > 0.5

        assert peers.eventually(obeyed, LIMIT_S)


def test_requests_and_kept_topics_cross_the_link_once(
    split: Split,
) -> None:
    asked: list[str] = []

    def accept(request: SetMission) -> Reply:
        asked.append(request.mission.name)
        return Reply(accepted=True)

    with (
        split.laptop("junction_navigation") as navigation,
        split.laptop("operator", ["junction_navigation"]) as operator,
    ):
        navigation.serve(t.MISSION_SET, accept)
        acks = operator.subscribe(t.COMMAND_ACK, 100)
        order = Override(
            issued=operator.stamp(), kind=OverrideKind.HOLD, operator=f"o{random.random()}"
        )

        def confirmed() -> bool:
            operator.publish(t.COMMAND_OVERRIDE, order)
            ack = acks.take(0.5)
            return ack is not None and ack.accepted

        assert peers.eventually(confirmed, LIMIT_S)
        commands = operator.subscribe(t.COMMAND_VELOCITY, 1000)
        sequences: list[int] = []

        def heard() -> bool:  # a publisher never waits: a busy link drops some
            navigation.publish(t.COMMAND_VELOCITY, command(navigation, 1.0))
            operator.wait(0.02)
            sequences.extend(c.issued.sequence for _, c in commands.drain())
            return len(sequences) > 40

        assert peers.eventually(heard, LIMIT_S)
        sequences += [c.issued.sequence for c in iter(lambda: commands.take(0.5), None)]
        assert len(set(sequences)) == len(sequences), "heard by the router as well"
        reply = operator.request(t.MISSION_SET, SetMission.model_validate(MISSION), 20)
        assert reply.accepted, reply.reason
        assert asked == ["turn"]


MISSION = {"mission": {"name": "turn"}}
