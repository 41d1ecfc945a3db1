"""What goes to the vehicle and when: on every change and at a steady rate, always within limits.

What is told of it to others goes at the steady rate only, whatever the rate of commands: whoever
commands hears it, and must not be driven by the answer to the last command.
"""

from juncnet.clocks import NS_PER_S, Instant
from juncnet.messages import Output, Stamp, VehicleState, Velocity
from juncnet_services.command_output.arbiter import GUARD_MARGIN_S, TAKE_OFF_S, Decision
from juncnet_services.command_output.guard_link import GuardLink
from juncnet_services.command_output.limits import Limiter
from juncnet_services.command_output.vehicles import AbortsTakeOff, Telemetry, Vehicle

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
        self._took_off_ns: int | None = None
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
                self._took_off_ns = None
                self._vehicle.land()
            case Output.EMERGENCY:
                self._took_off_ns = None
                self._vehicle.emergency()
            case _:
                self._take_off_or_abort(decision, now)
                self._vehicle.send(velocity, not decision.moving, hold_in_s)
        self._guard.beat(hold_in_s, self._vehicle.hold())
        self._told, self._told_ns = decision, now.ns
        return True

    def _take_off_or_abort(self, decision: Decision, now: Instant) -> None:
        """Have the vehicle take off once for an order, and give that up at the first stop.

        That the take-off is the output no more, for `TAKE_OFF_S` are over, is no such stop: the
        vehicle finishes its climb. One that was stopped and ordered again between two calls ends at
        a time that is not known here, and its end counts as a stop.
        """
        told, taking_off = self._told, Output.TAKING_OFF
        was_taking_off = told is not None and told.output is taking_off
        if decision.output is taking_off and not was_taking_off:
            self._took_off_ns = now.ns
            self._vehicle.take_off()
        if decision.output is not Output.STOPPED or self._took_off_ns is None or told is None:
            return
        over_ns = self._took_off_ns + int(TAKE_OFF_S * NS_PER_S)
        expired = was_taking_off and self._told_ns < over_ns <= now.ns
        if expired or (told.output, told.reason) == (decision.output, decision.reason):
            return
        self._took_off_ns = None
        if isinstance(self._vehicle, AbortsTakeOff):
            self._vehicle.abort_take_off()

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
