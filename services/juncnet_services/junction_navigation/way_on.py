"""The way straight on behind a junction: whether the road that a follower sees is it, or none."""

import math

from juncnet_services.junction_navigation import turning
from juncnet_services.junction_navigation.config import NavigatorConfig
from juncnet_services.junction_navigation.inputs import Inputs
from juncnet_services.junction_navigation.plan import JunctionPlan
from juncnet_services.junction_navigation.progress import Progress, SeenWay

AHEAD_RAD = math.radians(20)
"""How far off its heading a robot that crosses a junction may first see the way on, and how far off
that the way may lead there: what leads farther aside is bent towards another arm."""
FARTHEST_RAD = math.radians(35)
"""How far off its heading it may see it where the surface ahead was seen to end, and how far off
the road that it came by where that is known to end at the junction."""
LIKELY = 0.45
"""Confidence of a view that is taken there though it is not certain."""


def sees_way_on(
    state: Progress, inputs: Inputs, plan: JunctionPlan, config: NavigatorConfig
) -> bool:
    """Return whether the follower's road is the way on, behind the middle of a junction.

    It must have been sure once of a road that lies and leads ahead, or of one anywhere where the
    surface ahead ends. The way straight on may bend, though not faster than roads do: that is
    another arm. The heading held from then on, while it is not seen, is the newest. Where the
    surface is known to end straight ahead, it surely does, and a likely view of it is taken as long
    as none has been certain.
    """
    junction = state.junction
    if junction is None:
        return False
    towards_rad = inputs.road_towards_rad(state.yaw_rad)
    leads_rad = state.yaw_rad + inputs.road_heading_rad
    seen = SeenWay(leads_rad=leads_rad, at_m=state.odometer_m)
    if plan.ends_here and junction.axis_rad is not None:
        near = abs(towards_rad - junction.axis_rad) <= FARTHEST_RAD and not inputs.road_bent
        if near and inputs.road_certain:
            junction.way = junction.way or seen
        likely = inputs.road_confidence >= LIKELY and junction.way is None
        return near and (inputs.road_certain or likely)
    if plan.mouth_ahead_m > -0.5 * plan.reach_m:
        return False
    if junction.way is None and inputs.road_certain:
        ends_m = inputs.road_ends_m
        only = ends_m is not None and ends_m <= config.crossing_width_m
        leads_on = abs(leads_rad - state.heading_rad) <= AHEAD_RAD
        farthest_rad = AHEAD_RAD if math.isinf(plan.end_ahead_m) else FARTHEST_RAD
        if only or (leads_on and abs(towards_rad - state.heading_rad) <= farthest_rad):
            junction.way = seen
    if junction.way is None or not inputs.road_visible:
        return False
    driven_m = state.odometer_m - junction.way.at_m
    return abs(leads_rad - junction.way.leads_rad) <= turning.bent_rad(driven_m)


def nothing_ahead(state: Progress, plan: JunctionPlan, config: NavigatorConfig) -> bool:
    """Return whether the surface ends right ahead and no way on has been seen."""
    seen = state.junction is not None and state.junction.way is not None
    return plan.ends_here and plan.end_ahead_m <= config.end_before_m and not seen
