"""A vehicle that only logs what it is told: for real video, and for trying a pipeline out."""

import logging
import time
from collections import deque
from pathlib import Path
from typing import ClassVar, Literal

from pydantic import Field

from juncnet.clocks import NS_PER_S
from juncnet.messages import Velocity
from juncnet_services.command_output.vehicles import (
    DriverOptions,
    Hold,
    Telemetry,
    usual_capabilities,
)

LOG = logging.getLogger(__name__)
KEPT = 1000
"""Commands kept in memory, the newest."""


class LogOptions(DriverOptions):
    """Options of the vehicle `log`."""

    kind: Literal["copter", "rover"] = "copter"
    """Whose capabilities to claim."""
    every_s: float = Field(default=1.0, ge=0.1)
    """At most one line in so many seconds."""


class LogVehicle:
    """Logs and keeps (`sent`) what it is told; it has no link and measures nothing."""

    Options: ClassVar[type[DriverOptions]] = LogOptions

    def __init__(self, options: LogOptions, flight_dir: Path) -> None:
        del flight_dir
        self.capabilities = usual_capabilities(options.kind, telemetry=False)
        self.send_failures = 0
        self.trouble = ""
        self.sent: deque[tuple[str, Velocity]] = deque(maxlen=KEPT)
        self._every_ns = int(options.every_s * NS_PER_S)
        self._logged_ns = 0

    def send(self, velocity: Velocity, brake: bool, lasts_s: float) -> None:
        del lasts_s
        self._keep("hold" if brake else "move", velocity)

    def take_off(self) -> None:
        self._keep("take_off", Velocity())

    def abort_take_off(self) -> None:
        self._keep("abort_take_off", Velocity())

    def land(self) -> None:
        self._keep("land", Velocity())

    def emergency(self) -> None:
        self._keep("emergency", Velocity())

    def hold(self) -> Hold | None:
        return None

    def telemetry(self, max_age_s: float) -> Telemetry | None:
        del max_age_s
        return None

    def close(self) -> None:
        pass

    def _keep(self, what: str, velocity: Velocity) -> None:
        self.sent.append((what, velocity))
        now_ns = time.monotonic_ns()
        if now_ns - self._logged_ns < self._every_ns:
            return
        self._logged_ns = now_ns
        LOG.info(
            "%s: forward %.2f, lateral %.2f, vertical %.2f m/s, yaw rate %.2f rad/s",
            what,
            velocity.forward_mps,
            velocity.lateral_mps,
            velocity.vertical_mps,
            velocity.yaw_rate_radps,
        )
