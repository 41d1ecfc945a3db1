"""What goes to the vehicle and when: on every change and at a steady rate, always within limits.

What is told of it to others goes at the steady rate only, whatever the rate of commands: whoever
commands hears it, and must not be driven by the answer to the last command.
"""

from juncnet.clocks import NS_PER_S, Instant
from juncnet.messages import Output, Stamp, VehicleState, Velocity
from juncnet_services.command_output.arbiter import GUARD_MARGIN_S, Decision
from juncnet_services.command_output.guard_link import GuardLink
from juncnet_services.command_output.limits import Limiter
from juncnet_services.command_output.vehicles import Telemetry, Vehicle

PERIOD_S = 0.04
"""Of setpoints while nothing changes, and of vehicle/state while its output is the same."""
GUARD_IDLE_S = 0.17
"""While holding: the guard takes over after so long without a setpoint of ours."""
MAX_TELEMETRY_AGE_S = 0.2


class Setpoints:
    """Tells `vehicle` what was decided, and the guard by when it must hear of it again."""

    def __init__(self, vehicle: Vehicle, limiter: Limiter, guard: GuardLink) -> None:
        self._vehicle = vehicle
        self._limiter = limiter
        self._guard = guard
        self._told: Decision | None = None
        self._told_ns = 0
        self._stated: tuple[Output, str] | None = None
        self._stated_ns = 0

    def tell(self, decision: Decision, now: Instant) -> bool:
        """Send the setpoint if it has changed or is due; return whether it was sent."""
        if decision == self._told and now.ns - self._told_ns < PERIOD_S * NS_PER_S:
            return False
        velocity = self._limiter.step(decision.velocity, not decision.moving, now)
        hold_in_s = _hold_in_s(decision, now)
        match decision.output:
            case Output.LANDING:
                self._vehicle.land()
            case Output.EMERGENCY:
                self._vehicle.emergency()
            case _:
                if decision.output is Output.TAKING_OFF and not self._taking_off:
                    self._vehicle.take_off()
                self._vehicle.send(velocity, not decision.moving, hold_in_s)
        self._guard.beat(hold_in_s, self._vehicle.hold())
        self._told, self._told_ns = decision, now.ns
        return True

    @property
    def _taking_off(self) -> bool:
        return self._told is not None and self._told.output is Output.TAKING_OFF

    def state_due(self, decision: Decision, now: Instant) -> bool:
        """Return whether vehicle/state is to be published now: the output changed, or in turn."""
        what = (decision.output, decision.reason)
        if what == self._stated and now.ns - self._stated_ns < PERIOD_S * NS_PER_S:
            return False
        self._stated, self._stated_ns = what, now.ns
        return True

    def state(self, decision: Decision, at: Stamp) -> VehicleState:
        """Return what the vehicle is told and, where fresh, what it measures."""
        seen = self._vehicle.telemetry(MAX_TELEMETRY_AGE_S) or Telemetry()
        return VehicleState(
            at=at,
            capabilities=self._vehicle.capabilities,
            yaw_rad=seen.yaw_rad,
            velocity=seen.velocity,
            pose=seen.pose,
            gps=seen.gps,
            battery=seen.battery,
            flying=seen.flying,
            output=decision.output,
            output_reason="; ".join(filter(None, (decision.reason, self._vehicle.trouble))),
            commanded=self._limiter.velocity,
        )

    def end(self, now: Instant) -> None:
        """Send a last hold: what the vehicle keeps when this process ends in order."""
        self._vehicle.send(self._limiter.step(Velocity(), True, now), True, GUARD_IDLE_S)


def _hold_in_s(decision: Decision, now: Instant) -> float:
    """Seconds from `now` until the guard shall hold if it hears nothing newer."""
    if decision.ends is None:
        return GUARD_IDLE_S
    return (decision.ends.ns - now.ns) / NS_PER_S + GUARD_MARGIN_S
