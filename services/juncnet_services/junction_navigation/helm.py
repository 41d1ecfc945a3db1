"""Velocities that bring a robot onto a heading: on a road, in place, or on arcs that stay on it."""

from juncnet.messages import Velocity
from juncnet_services.junction_navigation import turning
from juncnet_services.junction_navigation.arcs import Arcs
from juncnet_services.junction_navigation.config import NavigatorConfig
from juncnet_services.junction_navigation.inputs import Inputs
from juncnet_services.junction_navigation.plan import JunctionPlan
from juncnet_services.junction_navigation.progress import Progress, TurnProgress

HOLD_YAW_RADPS = 0.5
HELD_RAD = 0.35
"""How far off the held heading a robot that cannot turn in place evades what is no road."""
KNOWN_RAD = 0.2
"""How well the direction of an arm is known that a map of the surface shows."""
LIKELIER = 0.7
"""Part of the angles that a turn may have, around its own, that is waited for: towards the others
the way straight on may lead."""


class Helm:
    """Steers by the yaw of a `Progress`, and by the surface that a follower told."""

    def __init__(
        self, config: NavigatorConfig, progress: Progress, plan: JunctionPlan, inputs: Inputs
    ) -> None:
        self._config, self._progress = config, progress
        self._plan, self._inputs = plan, inputs

    def hold_heading(self, speed_mps: float) -> Velocity:
        """Return the velocity on the direction of the robot's road."""
        state = self._progress
        rate = turning.yaw_rate_radps(state.heading_rad - state.yaw_rad, self._config.turn)
        rate = min(max(rate, -HOLD_YAW_RADPS), HOLD_YAW_RADPS)
        return Velocity(forward_mps=speed_mps, yaw_rate_radps=rate)

    def cross(self, speed_mps: float) -> Velocity:
        """Return the same over a junction's surface, which arcs do not leave."""
        held = self.hold_heading(speed_mps)
        if self._plan.radius_m == 0:
            return held
        error = self._progress.heading_rad - self._progress.yaw_rad
        arc = self._arcs.on_road(held.yaw_rate_radps / speed_mps, error, HELD_RAD)
        return Velocity(forward_mps=speed_mps, yaw_rate_radps=arc * speed_mps)

    def yaw_towards(self, target_rad: float, turn: TurnProgress) -> Velocity:
        """Return the velocity of a turn that shall end at an unwrapped yaw."""
        config, error = self._config.turn, target_rad - self._progress.yaw_rad
        rate = turning.yaw_rate_radps(error, config)
        if turn.in_place:
            return Velocity(yaw_rate_radps=rate)
        speed_mps = min(config.speed_mps, self._config.cruise_mps)
        limit = 1 / turn.radius_m
        wanted = min(max(rate / speed_mps, -limit), limit)
        known = turn.arm_rad is not None
        within = KNOWN_RAD if known else turning.search_arc(turn.turn, 0.0, config)[1]
        arc = self._arcs.on_road(wanted, error, within)
        return Velocity(forward_mps=speed_mps, yaw_rate_radps=arc * speed_mps)

    @property
    def last_chance(self) -> bool:
        """Whether the arc of the planned turn must begin now to lead onto the road that is seen."""
        turn, radius_m = self._plan.turn, self._plan.radius_m
        if radius_m == 0:
            return False
        within = LIKELIER * turning.search_arc(turn, 0.0, self._config.turn)[1]
        return self._arcs.last_chance(turning.angle_rad(turn), within, radius_m)

    @property
    def off_road(self) -> bool:
        """Whether a vehicle that cannot turn in place has left the road and must not go on."""
        return self._plan.radius_m > 0 and self._arcs.off_road

    @property
    def _arcs(self) -> Arcs:
        tightest_m = self._plan.capabilities.minimum_radius_m or self._plan.radius_m
        return Arcs(self._inputs.surface, self._config.turn.half_width_m, 1 / tightest_m)
