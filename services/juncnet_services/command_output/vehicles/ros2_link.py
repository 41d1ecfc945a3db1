"""The process between command_output and ROS 2: velocities from a UNIX socket to Zenoh.

Zenoh needs a session, which a guard of the standard library does not have. So this process has it,
and command_output and its guard both send it small datagrams, each with the time at which its
velocity ends. Then, if nothing newer has come, it publishes zero velocity by itself, at `RATE_HZ`,
until it hears from one of them or `LINGER_S` are over. A restarted command_output finds it running.

There are two of these processes: one that speaks, and a standby that looks every 50 ms whether the
speaker's socket is still served. If not it takes the socket's place, stops the vehicle and goes on.
The driver `ros2` starts standbys, and kills a speaker that does not answer.
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
STANDBY = "ros2-standby.sock"
BYE = b"bye"
STAY = b"stay"
"""Keeps a standby from ending."""
PROBE = b"probe"
"""Asks nothing; that it can be sent is the answer."""
DATAGRAM = struct.Struct("<q4d")
"""When it ends (monotonic ns); forward, lateral, vertical in m/s, yaw rate in rad/s."""
HOLD = DATAGRAM.pack(0, 0.0, 0.0, 0.0, 0.0)
RATE_HZ = 20.0
LINGER_S = 10.0
STATUS_S = 0.1


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
        self._session = session
        self._put = session.publisher(target.key)

    def __call__(self, velocity: Velocity) -> None:
        if self._sequence == 0:
            for token in self._target.tokens(self._session.id):
                self._session.show(token)
        self._sequence += 1
        now_ns = time.time_ns()
        attachment = self._target.attachment(self._sequence, now_ns, self._gid)
        self._put(self._target.payload(velocity, now_ns), attachment)


def stand_by(link: socket.socket, standby: Path, speaker: Path) -> bool:
    """Return True as the speaker, once there is no other; False when nobody needs a standby."""
    heard_ns = time.monotonic_ns()
    while time.monotonic_ns() - heard_ns < LINGER_S * NS_PER_S:
        if select.select([link], [], [], 1 / RATE_HZ)[0]:
            if newest(link)[0] == BYE:
                return False
            heard_ns = time.monotonic_ns()
        try:
            link.sendto(PROBE, str(speaker))
        except BlockingIOError:
            continue
        except OSError:
            with contextlib.suppress(FileNotFoundError):
                standby.replace(speaker)
                return True
    return False


def speak(
    link: socket.socket, publish: Callable[[Velocity], None], linked: Callable[[], bool]
) -> None:
    """Publish what comes, zero when it has ended; returns after `BYE` or a long silence."""
    heard_ns = time.monotonic_ns()
    until_ns = told_ns = 0
    publish(Velocity())
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
            if time.monotonic_ns() >= until_ns:
                publish(Velocity())
            continue
        heard_ns, until_ns = time.monotonic_ns(), wish[0]
        publish(wish[1] if heard_ns < until_ns else Velocity())
        if sender and heard_ns - told_ns > STATUS_S * NS_PER_S:
            told_ns = heard_ns
            status = f"{os.getpid()} {'linked' if linked() else 'alone'}"
            with contextlib.suppress(OSError):
                link.sendto(status.encode(), sender)


def newest(link: socket.socket) -> tuple[bytes, str | None]:
    """Return the newest datagram that waits and who sent it: `BYE` before all, probes behind."""
    found: tuple[bytes, str | None] = (PROBE, None)
    with contextlib.suppress(BlockingIOError):
        while found[0] != BYE:
            datagram, sender = link.recvfrom(256)
            if datagram != PROBE:
                found = datagram, sender
    return found


def main(directory: Path, options: LinkOptions) -> None:
    """Be the standby in `directory`, then the speaker, then end."""
    link = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    link.setblocking(False)
    temporary = directory / f"{STANDBY}.{os.getpid()}"
    link.bind(str(temporary))
    temporary.replace(directory / STANDBY)
    session = RawSession(options.endpoint)
    publish = Publisher(session, options.target)
    try:
        if stand_by(link, directory / STANDBY, directory / SOCKET):
            speak(link, publish, lambda: session.linked)
    finally:
        session.close()
        link.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]), LinkOptions.model_validate(json.loads(sys.argv[2])))
