"""Processes for the tests of the bus: `python peers.py ROLE FLIGHT_DIR NAME TRANSPORT`.

Pictures are derived from their sequence, so a reader can tell a torn picture, and a header that
came with another picture's pixels.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Generator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from juncnet import links
from juncnet import topics as t
from juncnet.flight import Flight, new_flight, read_flight
from juncnet.frame_ports import FrameTransport
from juncnet.frames import Frame, FrameLayout
from juncnet.messages import (
    EventKind,
    JunctionEvent,
    Mission,
    NavigationState,
    Phase,
    PixelFormat,
    Reply,
    SetMission,
    Stamp,
    Velocity,
    VelocityCommand,
)
from juncnet.zenoh_bus import ZenohBus

SIZES = ((320, 240), (640, 480), (1920, 1080))
PROCESSES = ("alpha", "beta", "gamma")


def picture(stamp: Stamp) -> Frame:
    """Return the picture that belongs to this stamp: its size and every byte follow from it."""
    width, height = SIZES[stamp.sequence // 10 % len(SIZES)]
    layout = FrameLayout.packed(PixelFormat.I420, width, height)
    return Frame(stamp, layout, np.full(layout.nbytes, stamp.sequence % 251, np.uint8))


def is_whole(frame: Frame) -> bool:
    """Return whether the pixels are those of the header, all of them."""
    expected = picture(frame.header)
    return frame.layout == expected.layout and bool((frame.pixels == expected.pixels).all())


def member(flight: Flight, name: str, transport: FrameTransport = "auto") -> ZenohBus:
    """Return a bus in this process that takes part as `name`."""
    return ZenohBus(links.member(flight, name), flight, name, flight.directory, transport)


@contextmanager
def started(
    role: str, flight: Flight, name: str, transport: str = "auto"
) -> Generator["subprocess.Popen[str]"]:
    """Start a process of this module, and kill it at the end."""
    process = subprocess.Popen(
        [sys.executable, __file__, role, str(flight.directory), name, transport],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@contextmanager
def a_flight(robot: str = "robot") -> Generator[Flight]:
    """Make a flight in a short temporary path, and remove it."""
    with tempfile.TemporaryDirectory(prefix="jn-") as root:
        yield new_flight(robot, PROCESSES, Path(root))


def eventually(condition: Callable[[], bool], timeout_s: float = 10.0) -> bool:
    """Return whether `condition()` becomes true within `timeout_s`."""
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.005)
    return False


def write_frames(bus: ZenohBus) -> None:
    """Send pictures as fast as 100 a second."""
    writer = bus.frames_out(t.CAMERA_FRAME)
    while bus.running:
        frame = picture(bus.stamp())
        loan = writer.loan(frame.layout)
        loan.pixels[:] = frame.pixels
        loan.send(frame.header)
        time.sleep(0.01)


def hold_a_frame(bus: ZenohBus) -> None:
    """Take a picture and keep it, until killed."""
    reader = bus.frames_in(t.CAMERA_FRAME)
    while bus.running:
        with reader.take(1.0) as frame:
            if frame is not None:
                print("holding", flush=True)
                time.sleep(60)


def talk(bus: ZenohBus) -> None:
    """Publish commands, events and a kept state; serve missions."""
    names: list[str] = []

    def set_mission(request: SetMission) -> Reply:
        names.append(request.mission.name)
        return Reply(accepted=True, reason=request.mission.name)

    bus.serve(t.MISSION_SET, set_mission)
    state = NavigationState(
        header=None,
        flight=bus.flight,
        phase=Phase.WAITING,
        count=7,
        mission=Mission(),
        next_turn=None,
    )
    bus.publish(t.NAVIGATION_STATE, state)
    for index in range(5):
        bus.publish(t.JUNCTION_EVENT, event(bus, index))
    while bus.running:
        stamp = bus.stamp()
        command = VelocityCommand(header=stamp, issued=stamp, velocity=Velocity())
        bus.publish(t.COMMAND_VELOCITY, command)
        time.sleep(0.01)


def event(bus: ZenohBus, index: int) -> JunctionEvent:
    """Return the `index`-th event."""
    return JunctionEvent(
        header=bus.stamp(),
        flight=bus.flight,
        index=index,
        kind=EventKind.APPROACHED,
        count=index,
        probability=0.9,
    )


ROLES = {"write_frames": write_frames, "hold_a_frame": hold_a_frame, "talk": talk}

if __name__ == "__main__":
    with member(read_flight(Path(sys.argv[2])), sys.argv[3], sys.argv[4]) as own_bus:  # type: ignore[arg-type]
        own_bus.report_health()
        ROLES[sys.argv[1]](own_bus)
