"""ROS 2 vehicles: geometry_msgs/Twist over Zenoh, to rmw_zenoh or zenoh-bridge-ros2dds, no ROS.

The vehicle measures nothing that we hear: navigation goes by time at the commanded speed. ROS 2 has
no standard order to take off, to land or to cut motors: what flies sinks for `land`, everything
else is zero velocity.
"""

import contextlib
import logging
import os
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
RESTART_S = 1.0
START_S = 10.0
"""A link process that does not listen after so long is replaced."""
HEARD_S = 2.0
"""A link process that says nothing for so long is in trouble."""


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
    """Sends velocities to a `ros2_link` process, which it starts when there is none."""

    Options: ClassVar[type[DriverOptions]] = Ros2Options

    def __init__(self, options: Ros2Options, flight_dir: Path) -> None:
        self.capabilities = _capabilities(options)
        self.send_failures = 0
        self.trouble = "the link to ROS 2 is being started"
        self._options = options
        self._path = flight_dir / ros2_link.SOCKET
        self._own = flight_dir / f"ros2-client-{os.getpid()}.sock"
        self._own.unlink(missing_ok=True)
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(self._own))
        self._socket.setblocking(False)
        self._process: subprocess.Popen[bytes] | None = None
        self._started_ns = 0
        self._heard_ns = time.monotonic_ns()
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
        return Hold(self._socket.fileno(), str(self._path), (ros2_link.HOLD,))

    def telemetry(self, max_age_s: float) -> Telemetry | None:
        """Return None: nothing is measured. Listens to the link process."""
        del max_age_s
        now_ns = time.monotonic_ns()
        with contextlib.suppress(BlockingIOError):
            while True:
                linked = self._socket.recv(64) == b"linked"
                self._heard_ns = now_ns
                self._say(
                    "" if linked else f"no Zenoh router at {self._options.endpoint}: is it on?"
                )
        if now_ns - self._heard_ns > HEARD_S * NS_PER_S:
            self._say("the link process does not answer")
        return None

    def close(self) -> None:
        for datagram in (ros2_link.HOLD, ros2_link.BYE):
            with contextlib.suppress(OSError):
                self._socket.sendto(datagram, str(self._path))
        if self._process is not None:
            try:
                self._process.wait(2.0)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait(1.0)
        self._socket.close()
        self._own.unlink(missing_ok=True)

    def _put(self, datagram: bytes) -> None:
        try:
            self._socket.sendto(datagram, str(self._path))
        except BlockingIOError:
            self.send_failures += 1
        except OSError:
            self.send_failures += 1
            self._start()

    def _start(self) -> None:
        """Start the link process, for none listens; one that has just been started is awaited."""
        now_ns = time.monotonic_ns()
        if self._process is not None:
            starting = self._process.poll() is None
            if now_ns - self._started_ns < (START_S if starting else RESTART_S) * NS_PER_S:
                return
            self._process.kill()
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
        self._process = subprocess.Popen(
            [sys.executable, "-m", ros2_link.__name__, str(self._path), link.model_dump_json()],
            stdin=subprocess.DEVNULL,
            start_new_session=True,
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
