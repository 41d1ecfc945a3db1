"""From the road's centre line to a velocity: pure pursuit, slower in bends and in doubt."""

import math

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from juncnet.messages import Velocity
from juncnet_services.road_following.centre_line import CentreLine


class SteeringOptions(BaseModel):
    """How the built-in follower drives."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    speed_mps: float = Field(default=3.0, gt=0, le=30)
    """On a straight road, well seen."""
    minimum_speed_mps: float = Field(default=0.6, ge=0, le=30)
    """In the tightest bend and in the greatest doubt."""
    lateral_acceleration_mps2: float = Field(default=1.2, gt=0, le=10)
    """Bends are driven no faster than this allows."""
    yaw_rate_limit_radps: float = Field(default=1.0, gt=0, le=6)
    minimum_radius_m: float = Field(default=0.0, ge=0, le=100)
    """Of the vehicle; 0: it turns in place."""
    lookahead_s: float = Field(default=1.3, gt=0, le=10)
    """How far ahead the pursued point lies, in time."""
    lookahead_least_m: float = Field(default=3.0, gt=0, le=100)
    delay_s: float = Field(default=0.25, ge=0, le=2)
    """From a picture to the vehicle's answer: the robot is steered from where it will be then."""


def steer(
    line: CentreLine,
    confidence: float,
    speed_mps: float,
    yaw_rate_radps: float,
    options: SteeringOptions,
) -> Velocity:
    """Return the velocity that brings a robot onto `line` and keeps it there.

    `speed_mps` and `yaw_rate_radps` are what the robot is doing now. The lookahead point of pure
    pursuit (Coulter 1992: curvature = 2 y / L^2) lies `lookahead_s` ahead of where the robot will
    be after `delay_s`.
    """
    speed_mps = max(speed_mps, 0.3 * options.speed_mps)
    advance_m, turn_rad = speed_mps * options.delay_s, yaw_rate_radps * options.delay_s
    drift_m = advance_m * turn_rad / 2
    reach_m = max(options.lookahead_least_m, speed_mps * options.lookahead_s)
    x = advance_m + reach_m
    y = float(line.y(np.array([x]))[0])
    ahead, aside = x - advance_m, y - drift_m
    along = ahead * math.cos(turn_rad) + aside * math.sin(turn_rad)
    across = aside * math.cos(turn_rad) - ahead * math.sin(turn_rad)
    curvature = 2.0 * across / max(along**2 + across**2, 1.0)
    target_mps = _speed(line, curvature, confidence, x, options)
    if options.minimum_radius_m > 0:
        tightest = 1.0 / options.minimum_radius_m
        curvature = min(max(curvature, -tightest), tightest)
    limit = options.yaw_rate_limit_radps
    yaw_rate = min(max(curvature * max(speed_mps, target_mps), -limit), limit)
    return Velocity(forward_mps=target_mps, yaw_rate_radps=yaw_rate)


def _speed(
    line: CentreLine, curvature: float, confidence: float, x_m: float, options: SteeringOptions
) -> float:
    """Return the speed [m/s] for the bend pursued, the heading error and the doubt."""
    bend = max(abs(curvature), abs(line.curvature_1pm + line.bend_1pm2 * x_m / 2), 1e-6)
    speed = min(options.speed_mps, math.sqrt(options.lateral_acceleration_mps2 / bend))
    speed *= min(1.0, max(0.3, 1.25 - abs(math.atan(line.heading))))
    speed *= min(1.0, 0.4 + confidence)
    return min(options.speed_mps, max(options.minimum_speed_mps, speed))
