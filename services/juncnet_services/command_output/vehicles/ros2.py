"""ROS 2 vehicles: geometry_msgs/Twist over Zenoh, to rmw_zenoh or zenoh-bridge-ros2dds, no ROS.

The vehicle measures nothing that we hear: navigation goes by time at the commanded speed. ROS 2 has
no standard order to take off, to land or to cut motors: what flies sinks for `land`, everything
else is zero velocity.
"""

import contextlib
import logging
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import ClassVar, Literal

from pydantic import Field

from juncnet.clocks import NS_PER_S
from juncnet.messages import Capabilities, Velocity
from juncnet_services.command_output.vehicles import (
    DriverOptions,
    Hold,
    Telemetry,
    ros2_link,
    usual_capabilities,
)
from juncnet_services.command_output.vehicles.ros2_wire import Target

LOG = logging.getLogger(__name__)
LANDING_MPS = -0.5
LANDING_CALL_S = 0.17
"""A call of `land` lasts for so long; they come at 25 Hz."""
END_S = 2.0
START_S = 10.0
"""A link process that does not listen after so long is replaced."""
STAY_S = 1.0
"""Between two calls to the standby."""
HUNG_S = 0.4
"""A speaker that has answered and says nothing for so long is killed; the standby takes over."""


class Ros2Options(DriverOptions):
    """Options of the vehicle `ros2`."""

    kind: Literal["copter", "rover"] = "rover"
    transport: Literal["rmw_zenoh", "bridge"] = "rmw_zenoh"
    """Who takes it: ROS 2 with rmw_zenoh, or zenoh-bridge-ros2dds beside any other ROS 2."""
    endpoint: str = Field(default="tcp/127.0.0.1:7447", pattern=r"^(tcp|udp|tls|unixsock-stream)/")
    """Of the Zenoh router: rmw_zenohd or the bridge."""
    topic: str = Field(default="cmd_vel", pattern=r"^/?[A-Za-z_][A-Za-z0-9_/]*$")
    stamped: bool = False
    """TwistStamped instead of Twist."""
    domain: int = Field(default=0, ge=0, le=232)
    node: str = Field(default="juncnet", pattern=r"^[A-Za-z_][A-Za-z0-9_]*$")
    frame_id: str = Field(default="base_link", pattern=r"^[\x20-\x7e]{0,64}$")
    minimum_radius_m: float = Field(default=0.0, ge=0, le=100)
    """Of a rover's turns; 0: it turns in place."""


class Ros2Vehicle:
    """Sends velocities to a `ros2_link` process; keeps another standing by."""

    Options: ClassVar[type[DriverOptions]] = Ros2Options

    def __init__(self, options: Ros2Options, flight_dir: Path) -> None:
        self.capabilities = _capabilities(options)
        self.send_failures = 0
        self.trouble = "the link to ROS 2 is being started"
        self._options = options
        self._directory = flight_dir
        self._speaker = str(flight_dir / ros2_link.SOCKET)
        self._standby = str(flight_dir / ros2_link.STANDBY)
        self._own = flight_dir / f"ros2-client-{os.getpid()}.sock"
        self._own.unlink(missing_ok=True)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(self._own))
        self._socket.setblocking(False)
        self._processes: list[subprocess.Popen[bytes]] = []
        self._started_ns = self._stayed_ns = 0
        self._heard_ns = self._read_ns = time.monotonic_ns()
        self._speaker_pid: int | None = None
        self._put(ros2_link.HOLD)

    def send(self, velocity: Velocity, brake: bool, lasts_s: float) -> None:
        """Send the velocity; in a hold it is where the vehicle is on its way to rest."""
        del brake
        self._put(_datagram(velocity, lasts_s))

    def take_off(self) -> None:
        """Do nothing: ROS 2 has no standard order for it."""

    def land(self) -> None:
        down = LANDING_MPS if self.capabilities.vertical else 0.0
        self._put(_datagram(Velocity(vertical_mps=down), LANDING_CALL_S))

    def emergency(self) -> None:
        """Stop: ROS 2 has no standard order that cuts motors."""
        self._put(ros2_link.HOLD)

    def hold(self) -> Hold | None:
        return Hold(self._socket.fileno(), self._speaker, (ros2_link.HOLD,))

    def telemetry(self, max_age_s: float) -> Telemetry | None:
        """Return None: nothing is measured. Listens to the link process."""
        del max_age_s
        now_ns = time.monotonic_ns()
        with contextlib.suppress(BlockingIOError):
            while True:
                pid, _, status = self._socket.recv(64).decode().partition(" ")
                self._heard_ns, self._speaker_pid = now_ns, int(pid)
                away = f"no Zenoh router at {self._options.endpoint}: is it on?"
                self._say("" if status == "linked" else away)
        # Time in which nobody asked here is not the speaker's silence.
        asked_s = (now_ns - self._read_ns) / NS_PER_S
        self._read_ns = now_ns
        silent_s = (now_ns - self._heard_ns) / NS_PER_S
        if self._speaker_pid is not None and silent_s > HUNG_S and asked_s < HUNG_S / 2:
            self._say("the link to ROS 2 hung, another takes over")
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(self._speaker_pid, signal.SIGKILL)
            self._speaker_pid = None
        return None

    def close(self) -> None:
        for datagram, to in (
            (ros2_link.HOLD, self._speaker),
            (ros2_link.BYE, self._standby),
            (ros2_link.BYE, self._speaker),
        ):
            with contextlib.suppress(OSError):
                self._socket.sendto(datagram, to)
        deadline_s = time.monotonic() + END_S
        for process in self._processes:
            try:
                process.wait(max(0.0, deadline_s - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait(1.0)
        self._socket.close()
        self._own.unlink(missing_ok=True)

    def _put(self, datagram: bytes) -> None:
        try:
            self._socket.sendto(datagram, self._speaker)
        except OSError:
            self.send_failures += 1
        now_ns = time.monotonic_ns()
        if now_ns - self._stayed_ns < STAY_S * NS_PER_S:
            return
        self._stayed_ns = now_ns
        try:
            self._socket.sendto(ros2_link.STAY, self._standby)
        except BlockingIOError:
            return
        except OSError:
            self._start_standby(now_ns)

    def _start_standby(self, now_ns: int) -> None:
        """Start a link process, for none stands by; one that has just been started is awaited."""
        self._processes = [process for process in self._processes if process.poll() is None]
        starting = bool(self._processes) and self._processes[-1].pid != self._speaker_pid
        if starting and now_ns - self._started_ns < START_S * NS_PER_S:
            return
        self._started_ns = now_ns
        options = self._options
        target = Target(
            transport=options.transport,
            topic=options.topic,
            domain=options.domain,
            stamped=options.stamped,
            node=options.node,
            frame_id=options.frame_id,
        )
        link = ros2_link.LinkOptions(endpoint=options.endpoint, target=target)
        self._processes.append(
            subprocess.Popen(
                [
                    sys.executable,
                    "-m",
                    ros2_link.__name__,
                    str(self._directory),
                    link.model_dump_json(),
                ],
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )
        )

    def _say(self, trouble: str) -> None:
        if trouble and trouble != self.trouble:
            LOG.warning("%s", trouble)
        self.trouble = trouble


def _datagram(velocity: Velocity, lasts_s: float) -> bytes:
    until_ns = time.monotonic_ns() + int(lasts_s * NS_PER_S)
    return ros2_link.DATAGRAM.pack(
        until_ns,
        velocity.forward_mps,
        velocity.lateral_mps,
        velocity.vertical_mps,
        velocity.yaw_rate_radps,
    )


def _capabilities(options: Ros2Options) -> Capabilities:
    usual = usual_capabilities(options.kind, telemetry=False)
    if options.kind == "copter":
        return usual
    radius_m = options.minimum_radius_m
    changes = {"minimum_radius_m": radius_m, "turns_in_place": radius_m == 0}
    return usual.model_copy(update=changes)
