"""The simulated drone or rover: JSON datagrams over a UNIX socket in the flight's directory."""

import time
from pathlib import Path
from typing import ClassVar, Literal

from juncnet.clocks import NS_PER_S
from juncnet.messages import Pose, Velocity
from juncnet.simulation import link
from juncnet_services.command_output.vehicles import (
    DriverOptions,
    Hold,
    Telemetry,
    usual_capabilities,
)

LANDING_MPS = -0.5


class SimulatedOptions(DriverOptions):
    """Options of the vehicle `simulated`."""

    kind: Literal["copter", "rover"] = "copter"
    telemetry: bool = True
    """False: fly as a vehicle would that measures nothing; navigation goes by time."""


class SimulatedVehicle:
    """The vehicle whose simulator listens in `flight_dir`; it may die and come back."""

    Options: ClassVar[type[DriverOptions]] = SimulatedOptions

    def __init__(self, options: SimulatedOptions, flight_dir: Path) -> None:
        self.capabilities = usual_capabilities(options.kind, telemetry=options.telemetry)
        self.send_failures = 0
        self.trouble = ""
        self._address = str(link.server_address(flight_dir))
        self._newest: Telemetry | None = None
        self._newest_ns = 0
        _remove_dead(flight_dir)
        self._link = link.open_client(flight_dir)
        self._own = Path(self._link.getsockname())
        self._send(link.encode(link.Hello()))

    def send(self, velocity: Velocity, brake: bool, lasts_s: float) -> None:
        del lasts_s
        self._send(_setpoint(velocity, brake))

    def take_off(self) -> None:
        """Do nothing: the simulated vehicle starts in the air, or on its wheels."""

    def land(self) -> None:
        down = LANDING_MPS if self.capabilities.vertical else 0.0
        self._send(_setpoint(Velocity(vertical_mps=down), brake=not self.capabilities.vertical))

    def emergency(self) -> None:
        """Send what is nearest to a motor cut on a vehicle that has no motors: a hold."""
        self._send(_setpoint(Velocity(), brake=True))

    def hold(self) -> Hold | None:
        return Hold(self._link.fileno(), self._address, (link.encode(link.HOLD),))

    def telemetry(self, max_age_s: float) -> Telemetry | None:
        datagram = self._drain()
        now_ns = time.monotonic_ns()
        if datagram is not None and self.capabilities.telemetry:
            self._newest, self._newest_ns = _telemetry(datagram), now_ns
        return self._newest if now_ns - self._newest_ns <= max_age_s * NS_PER_S else None

    def close(self) -> None:
        self._link.close()
        self._own.unlink(missing_ok=True)

    def _send(self, datagram: bytes) -> None:
        """Send, or count it: no simulator, one that is starting, or one that does not read."""
        try:
            self._link.sendto(datagram, self._address)
        except OSError:
            self.send_failures += 1

    def _drain(self) -> bytes | None:
        """Return the newest datagram that waits, None if none does."""
        newest = None
        while True:
            try:
                newest = self._link.recv(link.MAX_DATAGRAM)
            except OSError:
                return newest


def _setpoint(velocity: Velocity, brake: bool) -> bytes:
    return link.encode(link.Setpoint(**velocity.model_dump(), brake=brake))


def _telemetry(datagram: bytes) -> Telemetry | None:
    """Return the simulator's telemetry, whose axes and units are ours; None when malformed."""
    try:
        seen = link.decode_telemetry(datagram)
        return Telemetry(
            yaw_rad=seen.yaw_rad,
            velocity=Velocity(
                forward_mps=seen.forward_mps,
                lateral_mps=seen.lateral_mps,
                yaw_rate_radps=seen.yaw_rate_radps,
            ),
            pose=Pose(x_m=seen.x_m, y_m=seen.y_m, z_m=seen.z_m, yaw_rad=seen.yaw_rad),
            battery=seen.battery,
            flying=seen.flying,
        )
    except ValueError:
        return None


def _remove_dead(flight_dir: Path) -> None:
    """Remove the sockets that killed predecessors left behind."""
    for path in flight_dir.glob("vehicle-client-*.sock"):
        pid = path.stem.rpartition("-")[2]
        if pid.isdigit() and not Path("/proc", pid).exists():
            path.unlink(missing_ok=True)
