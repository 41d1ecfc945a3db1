"""A vehicle for tests that keeps all it was ever told, where a test in the same process sees it."""

from typing import ClassVar

from juncnet.messages import Velocity
from juncnet_services.command_output.vehicles.log import LogVehicle


class KeepingVehicle(LogVehicle):
    """Moves nothing; what it keeps grows for as long as the process lives."""

    speeds: ClassVar[list[float]] = []
    """The forward speed of every setpoint [m/s]."""
    told: ClassVar[list[Velocity]] = []
    """Every velocity that was not zero."""
    done: ClassVar[list[str]] = []
    """Take-offs, landings, motors cut: once for each call."""

    def send(self, velocity: Velocity, brake: bool, lasts_s: float) -> None:
        self.speeds.append(velocity.forward_mps)
        if velocity != Velocity():
            self.told.append(velocity)
        super().send(velocity, brake, lasts_s)

    def take_off(self) -> None:
        self.done.append("take_off")

    def land(self) -> None:
        self.done.append("land")

    def emergency(self) -> None:
        self.done.append("emergency")

    @classmethod
    def forget(cls) -> None:
        """Forget all that was told."""
        cls.speeds.clear()
        cls.told.clear()
        cls.done.clear()
