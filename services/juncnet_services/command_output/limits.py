"""What a vehicle is told at most, whoever told it: pure.

Speeds and yaw rate are bounded, their changes too: by the acceleration limits while a velocity is
obeyed, by the braking limits in a hold. Axes that a vehicle lacks are zero; one that cannot turn
in place turns no tighter than its minimum radius allows at its speed.
"""

import math

from pydantic import BaseModel, ConfigDict, Field

from juncnet.clocks import NS_PER_S, Instant
from juncnet.messages import Capabilities, Velocity

MAX_STEP_S = 0.1
"""Longest time between two steps that counts: a pause earns no jump in velocity."""


class Limits(BaseModel):
    """Largest magnitudes, per axis."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    forward_mps: float = Field(default=6.0, ge=0, le=50)
    lateral_mps: float = Field(default=2.0, ge=0, le=50)
    vertical_mps: float = Field(default=1.5, ge=0, le=50)
    yaw_rate_radps: float = Field(default=1.2, ge=0, le=20)
    acceleration_mps2: float = Field(default=3.0, gt=0, le=50)
    """Of each velocity axis, while a velocity is obeyed."""
    yaw_acceleration_radps2: float = Field(default=6.0, gt=0, le=100)
    brake_mps2: float = Field(default=4.0, gt=0, le=50)
    """Of each velocity axis, in a hold."""
    yaw_brake_radps2: float = Field(default=10.0, gt=0, le=100)
    """Of the yaw rate, in a hold."""


class Limiter:
    """Follows a target velocity within `limits`, as far as `capabilities` go; starts at rest."""

    def __init__(self, limits: Limits, capabilities: Capabilities) -> None:
        self.limits = limits
        self.capabilities = capabilities
        self.velocity = Velocity()
        self._stepped: Instant | None = None

    def step(self, target: Velocity, brake: bool, now: Instant) -> Velocity:
        """Return the velocity to send at `now`; `brake`: to rest by the braking limits.

        Safe for any float in `target`: NaN and infinity count as zero. A clock that stands still,
        runs backwards or is another one than before allows no change but braking by `MAX_STEP_S`.
        """
        limits, can, last = self.limits, self.capabilities, self.velocity
        seconds = self._elapsed_s(now, MAX_STEP_S if brake else 0.0)
        linear = (limits.brake_mps2 if brake else limits.acceleration_mps2) * seconds
        angular = limits.yaw_brake_radps2 if brake else limits.yaw_acceleration_radps2
        want = Velocity() if brake else target
        forward = _follow(last.forward_mps, want.forward_mps, limits.forward_mps, linear)
        lateral = _follow(last.lateral_mps, want.lateral_mps, limits.lateral_mps, linear)
        vertical = _follow(last.vertical_mps, want.vertical_mps, limits.vertical_mps, linear)
        yaw_rate = _follow(
            last.yaw_rate_radps, want.yaw_rate_radps, limits.yaw_rate_radps, angular * seconds
        )
        if not can.turns_in_place and can.minimum_radius_m > 0:
            yaw_rate = _bounded(yaw_rate, abs(forward) / can.minimum_radius_m)
        self.velocity = Velocity(
            forward_mps=forward,
            lateral_mps=lateral if can.lateral else 0.0,
            vertical_mps=vertical if can.vertical else 0.0,
            yaw_rate_radps=yaw_rate,
        )
        return self.velocity

    def _elapsed_s(self, now: Instant, unknown_s: float) -> float:
        """Seconds since the step before, 0..`MAX_STEP_S`; `unknown_s` when they cannot be known."""
        before, self._stepped = self._stepped, now
        if before is None or before.clock != now.clock or now.ns < before.ns:
            return unknown_s
        return min(MAX_STEP_S, (now.ns - before.ns) / NS_PER_S)


def _bounded(value: float, limit: float) -> float:
    """Return `value` within +-`limit`, 0 for what is no number."""
    return max(-limit, min(limit, value)) if math.isfinite(value) else 0.0


def _follow(last: float, target: float, limit: float, change: float) -> float:
    """Return `last` moved towards `target` by at most `change`, within +-`limit`."""
    step = _bounded(_bounded(target, limit) - last, change)
    return _bounded(last + step, limit)
