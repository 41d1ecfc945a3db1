"""More video than a link carries, under another robot's name: `flood` sends, `drain` listens."""

import sys
import time
from pathlib import Path

from juncnet.launch import connect
from juncnet.messages import VideoPacket
from juncnet.topics import CAMERA_VIDEO

ROBOT = "overload"
PACKET_BYTES = 50_000


def flood(directory: Path, bits_per_s: int) -> None:
    """Publish camera/video of robot `overload` at this rate until the process ends."""
    period_s = 8 * PACKET_BYTES / bits_per_s
    payload = b"\0\0\0\1" + bytes(PACKET_BYTES - 4)
    with connect(directory) as bus:
        due_s = time.monotonic()
        while bus.running:
            packet = VideoPacket.of(payload, header=bus.stamp(), key_frame=False)
            bus.publish(CAMERA_VIDEO, packet, robot=ROBOT)
            due_s += period_s
            time.sleep(max(0.0, due_s - time.monotonic()))


def drain(address: str) -> None:
    """Listen to it through the vehicle's router, and say once a second how much came."""
    with connect(address, robot=ROBOT, timeout_s=30) as bus:
        packets, count = bus.subscribe(CAMERA_VIDEO, 1000), 0
        told_s = time.monotonic()
        while bus.running:
            bus.wait(0.2)
            count += len(packets.drain())
            if time.monotonic() - told_s >= 1:
                told_s = time.monotonic()
                print(f"{8e-6 * count * PACKET_BYTES:.1f} Mbit", flush=True)
                count = 0


if __name__ == "__main__":
    if sys.argv[1] == "flood":
        flood(Path(sys.argv[2]), int(sys.argv[3]))
    else:
        drain(sys.argv[2])
