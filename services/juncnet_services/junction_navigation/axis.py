"""The direction of the robot's road: what it holds where the follower is not obeyed."""

import math

from juncnet.messages import Phase, RoadCommand
from juncnet_services.junction_navigation.config import NavigatorConfig
from juncnet_services.junction_navigation.inputs import Inputs
from juncnet_services.junction_navigation.plan import JunctionPlan
from juncnet_services.junction_navigation.progress import Progress

AXIS_S, AXIS_STEP_S = 0.4, 0.1
"""Time constant of the mean direction, and the longest time that one view stands for."""
WIDTH_WEIGHT = 0.2
"""Of a view's width, relative to that of its direction."""
SIDE_ARM_RAD = 0.35
"""A road that leads so far aside, before a junction, is a side arm of it; and so far aside of its
road a robot that follows it looks at most."""


class RoadAxis:
    """Learns `axis_rad` of a `Progress`, and the plan's width, from a follower's views."""

    def __init__(
        self, config: NavigatorConfig, progress: Progress, plan: JunctionPlan, inputs: Inputs
    ) -> None:
        self._config, self._progress = config, progress
        self._plan, self._inputs = plan, inputs

    def see(self, road: RoadCommand, yaw: float, elapsed_s: float) -> None:
        """Take a view of the road into its mean direction; a pause makes no view weigh more.

        One far off is of a side arm before a junction, elsewhere of another road. Nothing is
        learned where a side arm may mislead the follower. A mean lags behind: on a bend, every view
        stands for where the robot will be when the mean has followed. A robot that follows its road
        looks along it, whatever line was taken for the road for a while.
        """
        if not self._steered:
            return
        self._learn(road, yaw, elapsed_s)
        axis = self._progress.axis_rad
        if axis is not None and self._progress.phase is Phase.FOLLOWING:
            self._progress.axis_rad = min(max(axis, yaw - SIDE_ARM_RAD), yaw + SIDE_ARM_RAD)

    def _learn(self, road: RoadCommand, yaw: float, elapsed_s: float) -> None:
        direction = yaw
        if road.road is not None:
            lag_m = max(self._progress.speed_mps, 0.0) * AXIS_S
            direction += road.road.heading_rad + lag_m * road.road.curvature_1pm
        axis, approaching = self._progress.axis_rad, self._progress.phase is Phase.APPROACHING
        if axis is None or abs(direction - axis) > (SIDE_ARM_RAD if approaching else math.pi / 4):
            self._progress.axis_rad = axis if axis is not None and approaching else direction
            return
        weight = 1 - math.exp(-min(max(elapsed_s, 0.0), AXIS_STEP_S) / AXIS_S)
        if approaching:
            weight *= self._inputs.road_trust
        self._progress.axis_rad = axis + weight * (direction - axis)
        if road.road is not None:
            self._plan.learn_width(road.road.width_m, WIDTH_WEIGHT * weight)

    @property
    def _steered(self) -> bool:
        """Whether the follower steers and no side arm misleads it."""
        if self._progress.phase is Phase.APPROACHING:
            config = self._config
            least_m = config.axis_before_m if self._plan.straight else config.hold_before_m
            return self._plan.mouth_ahead_m > least_m and not self._inputs.road_aside
        return self._progress.phase is Phase.FOLLOWING
