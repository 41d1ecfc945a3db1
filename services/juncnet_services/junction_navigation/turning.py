"""Turns: where they begin, how fast to yaw, and whether the next road is in sight."""

import math

from juncnet.messages import Capabilities, RoadCommand, RoadSeen, Turn
from juncnet_services.junction_navigation.arms import Sector
from juncnet_services.junction_navigation.config import TurnConfig
from juncnet_services.junction_navigation.progress import TurnProgress

NOMINAL_RAD = {"left": math.pi / 2, "right": -math.pi / 2, "straight": 0.0}
NAMED_RAD = 0.7
"""How far off a right angle the road of a turn that says no angle is looked for first."""
LONGEST_TANGENT_RAD = math.radians(120)
STRAIGHT_RAD = math.radians(15)
ASTRAY_RAD = 0.25
"""How far behind a turn its road may lie outside of where it was searched, and the way straight on
from where it was seen;"""
BEND_RADIUS_M = 15.0
"""and the farther the robot has gone, the more the road may have bent."""
HELD_BACK_RAD = 0.5
"""How far aside a road leads at least that an arc may lead onto that was held back."""
ANGLE_RAD, ASIDE_RAD, BACK_RAD = (math.radians(angle) for angle in (55, 20, 155))
"""How far off an angle that is said an arm may be; how far aside one that is left or right leads at
least and at most."""
LEAST_ASIDE_RAD = math.radians(-10)
"""How far aside at least where an arc was held back: the robot's road may have bent before."""
ARM_RAD = 0.45
"""A line on an arm may lie so far off the arm's bearing, which was taken from beside the arm's axis
perhaps."""
LONGER_M = 1.2
"""How much longer an arc may be than one that turns the robot as far."""


def angle_rad(turn: Turn) -> float:
    """Return the angle of a turn, left positive."""
    if turn.angle_deg is not None:
        return math.radians(turn.angle_deg)
    return NOMINAL_RAD[turn.turn or "straight"]


def side(turn: Turn) -> str | None:
    """Return on which side of the robot's road a turn leads: left or right; None: straight on."""
    if is_straight(turn):
        return None
    return "left" if angle_rad(turn) > 0 else "right"


def is_straight(turn: Turn) -> bool:
    """Return whether a turn is none: the robot crosses on its heading."""
    return abs(angle_rad(turn)) < STRAIGHT_RAD


def arc_radius_m(config: TurnConfig, capabilities: Capabilities) -> float:
    """Return the radius of the vehicle's arcs; 0: it turns in place."""
    if capabilities.turns_in_place:
        return 0.0
    return max(config.radius_m, 1.1 * capabilities.minimum_radius_m)


def tangent_m(radius_m: float, angle: float) -> float:
    """Return how far before the corner an arc begins that ends on the next road's axis."""
    return radius_m * math.tan(min(abs(angle), LONGEST_TANGENT_RAD) / 2)


def yaw_rate_radps(error_rad: float, config: TurnConfig) -> float:
    """Return the yaw rate that brings `error_rad` (target minus yaw) to zero without overshoot."""
    rate = config.yaw_gain_per_s * error_rad
    return min(max(rate, -config.yaw_rate_radps), config.yaw_rate_radps)


def search_arc(
    turn: Turn, aligning_s: float, config: TurnConfig, held_back: bool = False
) -> tuple[float, float]:
    """Return (middle from the nominal angle on, half width) of where a turn's road may lie.

    What is nearer to straight on than to an angle that is said is the way straight on; `left` and
    `right` say none, but a road that leads little aside is not looked for first. Once all that was
    searched in vain, the arc widens to the other side, and at last to both: the road by which the
    robot came may have bent unseen. An arc that was held back leads onto a road less far aside.
    """
    far = config.search_rad
    if is_straight(turn):
        return 0.0, far
    angle = angle_rad(turn)
    near = min(far, NAMED_RAD if turn.angle_deg is None else abs(angle) / 2)
    if held_back:
        nearest = min(abs(angle) - near, HELD_BACK_RAD)
        within = (abs(angle) + near - nearest) / 2
        return math.copysign(within - near, -angle), within
    aside = (far + near) / 2
    swept_rad = max(aligning_s - config.settle_s, 0.0) * config.sweep_radps
    if swept_rad <= 4 * near:
        return 0.0, near
    if swept_rad <= 4 * (near + aside):
        return math.copysign((far - near) / 2, angle), aside
    return 0.0, far


def is_held_back(turn: TurnProgress, at_m: float, yaw: float) -> bool:
    """Return whether an arc, at an odometer reading and a yaw, is longer than it turned the robot.

    The surface then leaves no room for it: the road of the turn leads less aside than was thought.
    """
    angle = angle_rad(turn.turn)
    turned_rad = math.copysign(1.0, angle) * (yaw - turn.nominal_rad) + abs(angle)
    arc_m = turned_rad * turn.radius_m
    return not turn.in_place and at_m - turn.started_m > arc_m + LONGER_M


def leads_rad(seen: RoadSeen, in_place: bool) -> float:
    """Return the direction of a seen road against the robot's own.

    A robot that turns in place stands before its road, not on it: there it is the direction of the
    part in view, for where the line would lead beside the robot is a guess, and another one at
    every yaw.
    """
    if not in_place or len(seen.centre) < 2:
        return seen.heading_rad
    (near_x_m, near_y_m), (far_x_m, far_y_m) = seen.centre[0], seen.centre[-1]
    return math.atan2(far_y_m - near_y_m, far_x_m - near_x_m)


def seen_heading_rad(road: RoadCommand, in_place: bool) -> float | None:
    """Return the direction of a follower's road against the robot's own; None: it gives none.

    A follower that gives no road is taken to yaw by one radian a second per radian of error.
    """
    if road.road is not None:
        return leads_rad(road.road, in_place)
    return None if road.velocity is None else road.velocity.yaw_rate_radps


def bearing_rad(seen: RoadSeen) -> float:
    """Return where from the robot the middle of the part in view of a seen road lies."""
    if not seen.centre:
        return seen.heading_rad
    x_m, y_m = seen.centre[len(seen.centre) // 2]
    return math.atan2(y_m, x_m)


def sector(turn: Turn, in_place: bool = True, held_back: bool = False) -> Sector:
    """Return where, from the direction of the robot's road, the arm of a turn is looked for.

    `left` and `right` mean the nearest to a right angle of what leads neither on nor back; where an
    arc was held back, there was none, and what leads on may be meant. A robot on an arc cannot look
    around: it does not wait for what may lie beyond the turn's angle.
    """
    angle = angle_rad(turn)
    if turn.angle_deg is not None or is_straight(turn):
        return Sector(angle, angle - ANGLE_RAD, angle + ANGLE_RAD, in_place)
    sign, aside_rad = math.copysign(1.0, angle), LEAST_ASIDE_RAD if held_back else ASIDE_RAD
    least, most = sorted((sign * aside_rad, sign * BACK_RAD))
    return Sector(angle, least, most, in_place)


def bent_rad(driven_m: float) -> float:
    """Return how far a road may lead off where it was known to lead so many metres before."""
    return ASTRAY_RAD + driven_m / BEND_RADIUS_M


def is_astray(
    road: RoadCommand, at_m: float, yaw: float, turn: TurnProgress, config: TurnConfig
) -> bool:
    """Return whether a follower's road, seen from `yaw` behind a turn, is no road of that turn.

    `at_m` is the odometer reading there.
    """
    if road.road is None:
        return False
    driven_m = 0.0 if turn.ended_m is None else at_m - turn.ended_m
    if turn.arm_rad is not None:
        apart_rad = yaw + bearing_rad(road.road) - turn.arm_rad
        return abs(apart_rad) > ARM_RAD + bent_rad(driven_m)
    middle, within = search_arc(turn.turn, turn.aligning_s, config, turn.held_back)
    direction = yaw + leads_rad(road.road, turn.in_place)
    return abs(direction - turn.nominal_rad - middle) > within + bent_rad(driven_m)


def sweep_rad(seconds: float, sign: float, limit: float, config: TurnConfig) -> float:
    """Return where to look for the road `seconds` after the nominal angle, and relative to it.

    First stay, then go on turning (`sign`) up to `limit`, then to the other side, and so on.
    """
    path = max(seconds - config.settle_s, 0.0) * config.sweep_radps
    if limit == 0:
        return 0.0
    there = math.remainder(path, 4 * limit)
    return sign * (math.copysign(2 * limit, there) - there if abs(there) > limit else there)
