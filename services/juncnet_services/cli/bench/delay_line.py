"""Holds every packet of a TUN device back for a while: where the kernel has no netem."""

import fcntl
import os
import select
import struct
import sys
import time
from collections import deque

TUNSETIFF, IFF_TUN, IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
MAX_PACKET = 65536
MAX_WAITING = 20_000
"""Packets that wait at most; more are lost."""


def run(device: str, delay_s: float) -> None:
    """Serve the TUN `device`, which is there already, until the process is ended."""
    tun = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(tun, TUNSETIFF, struct.pack("16sH", device.encode(), IFF_TUN | IFF_NO_PI))
    waiting: deque[tuple[float, bytes]] = deque(maxlen=MAX_WAITING)
    while True:
        left_s = max(0.0, waiting[0][0] - time.monotonic()) if waiting else None
        readable, _, _ = select.select([tun], [], [], left_s)
        if readable:
            waiting.append((time.monotonic() + delay_s, os.read(tun, MAX_PACKET)))
        while waiting and waiting[0][0] <= time.monotonic():
            os.write(tun, waiting.popleft()[1])


if __name__ == "__main__":
    run(sys.argv[1], float(sys.argv[2]))
