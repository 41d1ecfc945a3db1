"""The process between command_output and ROS 2: velocities from a UNIX socket to Zenoh.

Zenoh needs a session, which a guard of the standard library does not have. So this process has it,
and command_output and its guard both send it small datagrams, each with the time at which its
velocity ends. Then, if nothing newer has come, it publishes zero velocity by itself, at `RATE_HZ`,
until it hears from one of them or `LINGER_S` are over. Started by the driver `ros2`; a restarted
command_output finds it running.
"""

import contextlib
import json
import os
import select
import socket
import struct
import sys
import time
from collections.abc import Callable
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from juncnet.clocks import NS_PER_S
from juncnet.messages import Velocity
from juncnet.zenoh_raw import RawSession
from juncnet_services.command_output.vehicles.ros2_wire import Target

SOCKET = "ros2.sock"
BYE = b"bye"
DATAGRAM = struct.Struct("<q4d")
"""When it ends (monotonic ns); forward, lateral, vertical in m/s, yaw rate in rad/s."""
HOLD = DATAGRAM.pack(0, 0.0, 0.0, 0.0, 0.0)
RATE_HZ = 20.0
LINGER_S = 10.0
STATUS_S = 0.25


class LinkOptions(BaseModel):
    """What the driver hands over, as JSON, on the command line."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    endpoint: str
    target: Target


def wish_in(datagram: bytes) -> tuple[int, Velocity] | None:
    """Return the end and the velocity in a datagram; None when malformed or out of range."""
    try:
        until_ns, forward, lateral, vertical, yaw_rate = DATAGRAM.unpack(datagram)
        velocity = Velocity(
            forward_mps=forward,
            lateral_mps=lateral,
            vertical_mps=vertical,
            yaw_rate_radps=yaw_rate,
        )
    except (struct.error, ValueError):
        return None
    return until_ns, velocity


class Publisher:
    """Publishes what `target` wants, numbered and stamped."""

    def __init__(self, session: RawSession, target: Target) -> None:
        self._target, self._sequence = target, 0
        self._gid = os.urandom(16)
        for token in target.tokens(session.id):
            session.show(token)
        self._put = session.publisher(target.key)

    def __call__(self, velocity: Velocity) -> None:
        self._sequence += 1
        now_ns = time.time_ns()
        attachment = self._target.attachment(self._sequence, now_ns, self._gid)
        self._put(self._target.payload(velocity, now_ns), attachment)


def serve(
    link: socket.socket, publish: Callable[[Velocity], None], linked: Callable[[], bool]
) -> None:
    """Publish what comes, zero when it has ended; returns after `BYE` or a long silence."""
    heard_ns = time.monotonic_ns()
    until_ns = told_ns = 0
    while time.monotonic_ns() - heard_ns < LINGER_S * NS_PER_S:
        left_s = (until_ns - time.monotonic_ns()) / NS_PER_S
        if not select.select([link], [], [], left_s if left_s > 0 else 1 / RATE_HZ)[0]:
            publish(Velocity())
            continue
        datagram, sender = newest(link)
        if datagram == BYE:
            publish(Velocity())
            return
        wish = wish_in(datagram)
        if wish is None:
            continue
        heard_ns, until_ns = time.monotonic_ns(), wish[0]
        publish(wish[1] if heard_ns < until_ns else Velocity())
        if sender and heard_ns - told_ns > STATUS_S * NS_PER_S:
            told_ns = heard_ns
            with contextlib.suppress(OSError):
                link.sendto(b"linked" if linked() else b"alone", sender)


def newest(link: socket.socket) -> tuple[bytes, str | None]:
    """Return the newest datagram that waits and who sent it; a `BYE` before it counts."""
    datagram, sender = link.recvfrom(256)
    with contextlib.suppress(BlockingIOError):
        while datagram != BYE:
            datagram, sender = link.recvfrom(256)
    return datagram, sender


def main(path: Path, options: LinkOptions) -> None:
    """Serve the socket at `path`; whatever was there before is not heard any more."""
    link = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    link.setblocking(False)
    temporary = path.with_suffix(f".{os.getpid()}")
    link.bind(str(temporary))
    temporary.replace(path)
    session = RawSession(options.endpoint)
    try:
        serve(link, Publisher(session, options.target), lambda: session.linked)
    finally:
        session.close()
        link.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), LinkOptions.model_validate(json.loads(sys.argv[2])))
