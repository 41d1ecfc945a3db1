"""command_output: command/velocity, command/override -> vehicle, vehicle/state, command/ack.

The only process that moves the vehicle: it obeys operator and pipeline within limits, and holds
when neither speaks. Its guard holds when it cannot.
"""

from contextlib import closing
from typing import Any, Self

from pydantic import Field, model_validator

from juncnet.bus import Bus
from juncnet.clocks import Instant
from juncnet.launch import launch
from juncnet.topics import COMMAND_OVERRIDE, COMMAND_VELOCITY, VEHICLE_STATE
from juncnet_services.command_output.answers import acknowledge, obey
from juncnet_services.command_output.arbiter import Arbiter, Rules
from juncnet_services.command_output.guard_link import GuardLink
from juncnet_services.command_output.latch import LastAccepted, Latch
from juncnet_services.command_output.limits import Limiter, Limits
from juncnet_services.command_output.setpoints import Setpoints
from juncnet_services.command_output.vehicles import check_options, open_vehicle

TICK_S = 0.01
"""The watchdog looks at least this often, whether or not messages come."""


class Config(Rules):
    """Options of `command_output`: the rules of what is obeyed, and the vehicle."""

    vehicle: str = "simulated"
    """The driver: `simulated`, `log`, or `package.module:Class`."""
    options: dict[str, Any] = Field(default_factory=dict)
    """Options of the driver, validated by its own model."""
    limits: Limits = Limits()

    @model_validator(mode="after")
    def _driver_takes_its_options(self) -> Self:
        check_options(self.vehicle, self.options)
        return self


def run(bus: Bus, config: Config) -> None:
    """Move the vehicle until the bus stops, then leave it in a hold."""
    commands = bus.subscribe(COMMAND_VELOCITY)
    orders = bus.subscribe(COMMAND_OVERRIDE, capacity=256)
    latch, accepted = Latch(bus.state_dir), LastAccepted(bus.flight_dir)
    arbiter = Arbiter(config, latch.read(), accepted.read(), bus.offsets)
    with (
        closing(open_vehicle(config.vehicle, config.options, bus.flight_dir)) as vehicle,
        GuardLink(vehicle.hold(), bus.flight_dir) as guard,
    ):
        setpoints = Setpoints(vehicle, Limiter(config.limits, vehicle.capabilities), guard)
        while bus.running:
            bus.wait(TICK_S)
            now = Instant(bus.clock.now_ns(), bus.clock.id)
            trouble = vehicle.trouble
            verdicts = [(o, arbiter.override(o, now, trouble)) for _, o in orders.drain()]
            header = obey(bus, arbiter, [command for _, command in commands.drain()], now)
            decision = arbiter.step(now)
            if setpoints.tell(decision, now):
                bus.health.output(now.ns, header)
            if setpoints.state_due(decision, now):
                bus.publish(VEHICLE_STATE, setpoints.state(decision, bus.stamp()))
                bus.health.set("send_failures", vehicle.send_failures)
                bus.health.set("guard_restarts", guard.restarts)
            forgotten = (latch.keep(arbiter.latched), accepted.keep(arbiter.last_accepted))
            acknowledge(bus, verdicts, "; ".join(filter(None, forgotten)))
        setpoints.end(Instant(bus.clock.now_ns(), bus.clock.id))


def main() -> None:
    """Start the process."""
    launch(run, Config)
