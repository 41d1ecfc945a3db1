"""Velocities that a vehicle can follow, and speeds that fit what lies ahead."""

import math

from juncnet.messages import Capabilities, Velocity

CRAWL_MPS = 0.3
NO_MOTION = Velocity()


def scaled(proposal: Velocity, limit_mps: float) -> Velocity:
    """Return the proposal slowed to `limit_mps` along the same path (same curvature)."""
    if proposal.forward_mps <= limit_mps:
        return proposal
    part = limit_mps / proposal.forward_mps
    return Velocity(
        forward_mps=limit_mps,
        lateral_mps=proposal.lateral_mps * part,
        vertical_mps=proposal.vertical_mps,
        yaw_rate_radps=proposal.yaw_rate_radps * part,
    )


def feasible(wanted: Velocity, capabilities: Capabilities, yaw_limit_radps: float) -> Velocity:
    """Return the part of `wanted` that the vehicle can do; it never raises the speed."""
    limit = yaw_limit_radps
    if not capabilities.turns_in_place and capabilities.minimum_radius_m > 0:
        limit = min(limit, abs(wanted.forward_mps) / capabilities.minimum_radius_m)
    return Velocity(
        forward_mps=wanted.forward_mps,
        lateral_mps=wanted.lateral_mps if capabilities.lateral else 0.0,
        vertical_mps=wanted.vertical_mps if capabilities.vertical else 0.0,
        yaw_rate_radps=min(max(wanted.yaw_rate_radps, -limit), limit),
    )


def braking_mps(remaining_m: float, speed_mps: float, deceleration: float, lag_s: float) -> float:
    """Return the highest speed from which the robot still stands `remaining_m` ahead.

    `lag_s` is the delay of the vehicle: what it travels meanwhile is not left for braking. The last
    metres are crept, so that the point is reached.
    """
    left_m = remaining_m - speed_mps * lag_s
    if remaining_m <= 0:
        return 0.0
    return max(math.sqrt(2 * deceleration * max(left_m, 0.0)), CRAWL_MPS)


def blended(first: float, second: float, share: float) -> float:
    """Return `first` for a share of 0 and below, `second` for 1 and above, between in between."""
    share = min(max(share, 0.0), 1.0)
    return (1 - share) * first + share * second
