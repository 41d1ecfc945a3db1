"""Where the junction ahead is, where its turn begins, and how fast to get there."""

import math
from collections.abc import Iterator

from juncnet.messages import Capabilities, Turn
from juncnet_services.junction_navigation import turning
from juncnet_services.junction_navigation.config import NavigatorConfig
from juncnet_services.junction_navigation.place import (
    MOUTH_BEFORE_M,
    mouth_m,
    odometer_scale,
)
from juncnet_services.junction_navigation.progress import Progress, Sighting
from juncnet_services.junction_navigation.speed import braking_mps

NARROWEST_M, WIDEST_M = 3.0, 12.0
SHORTEST_OPENING_M, LONGEST_OPENING_M = 2.5, 15.0
END_BEYOND_M = 2.0
"""Distance behind a junction's far side up to which the surface's end is the junction's."""
BESIDE_M = 1.2
"""An opening is seen this far beyond the edge of the robot's road."""


class JunctionPlan:
    """Distances (metres, ahead positive, by the odometer) and speeds for the counted junction."""

    def __init__(self, config: NavigatorConfig, progress: Progress) -> None:
        self._config, self._progress = config, progress
        self._band = config.camera.band
        self.capabilities = Capabilities()
        self._width_m = config.crossing_width_m

    def learn_width(self, width_m: float, weight: float) -> None:
        """Take the width of the robot's road as a guess of the crossing one's; `weight` 0..1."""
        measured = min(max(width_m, NARROWEST_M), WIDEST_M)
        self._width_m += weight * (measured - self._width_m)

    @property
    def turn(self) -> Turn:
        """What to do at the counted junction."""
        return self._progress.turn_here

    @property
    def straight(self) -> bool:
        """Whether the robot crosses the counted junction on its heading."""
        return turning.is_straight(self.turn)

    @property
    def axis_rad(self) -> float:
        """Direction of the road by which the robot entered the counted junction, or is on."""
        junction = self._progress.junction
        entered = None if junction is None else junction.axis_rad
        return self._progress.heading_rad if entered is None else entered

    @property
    def radius_m(self) -> float:
        """Of the vehicle's arcs; 0: it turns in place."""
        return turning.arc_radius_m(self._config.turn, self.capabilities)

    @property
    def reach_m(self) -> float:
        """Between a junction's mouth and its centre: half the crossing road and the corner."""
        true_m = self._width_m / 2 + self._config.corner_m
        junction = self._progress.junction
        if junction is None:
            return true_m
        return true_m * odometer_scale(junction, self._band)

    @property
    def mouth_ahead_m(self) -> float:
        """Distance to the mouth; infinite without a junction."""
        state = self._progress
        if state.junction is None:
            return math.inf
        mouth = mouth_m(state.junction, self._band, state.odometer_m)
        return mouth - state.odometer_m

    @property
    def start_ahead_m(self) -> float:
        """Distance to where the planned turn is begun; infinite when none is planned.

        An arc that is asked for begins as much later as the vehicle answers.
        """
        if self.straight:
            return math.inf
        if self.radius_m == 0:
            return self.centre_ahead_m
        tangent_m = turning.tangent_m(self.radius_m, turning.angle_rad(self.turn))
        answers_m = max(self._progress.speed_mps, 0.0) * self._config.velocity_lag_s
        return self.centre_ahead_m - tangent_m - answers_m

    @property
    def centre_ahead_m(self) -> float:
        """Distance to where the centre lines of the robot's road and of the next one meet.

        Where the robot's road ends at the crossing one, they meet half a width before its far edge.
        """
        centre_m = self._crossing_ahead_m()
        before_end_m = self.end_ahead_m - self._width_m / 2
        return min(centre_m, max(before_end_m, self.mouth_ahead_m + self._config.corner_m))

    def _crossing_ahead_m(self) -> float:
        """Return the distance to the middle of the crossing road, as the opening to turn into says.

        If only the one across was seen, a turn of no certain angle is made no nearer. A road that
        leaves at another angle than 90 degrees crosses the edge before or behind; where openings
        were seen left and right, their mean is not shifted. The middle lies behind the corners,
        whatever a slight turn's angle makes of its opening.
        """
        junction = self._progress.junction
        seen = [] if junction is None else junction.sightings
        into = next((s for s in seen if s.side == turning.side(self.turn)), None)
        if into is None:
            across_m = _half_length_m(seen[0]) if seen and self.turn.angle_deg is None else None
            behind_mouth_m = max(self.reach_m, MOUTH_BEFORE_M + (across_m or 0.0))
            return self.mouth_ahead_m + behind_mouth_m
        half_m = _half_length_m(into)
        behind_mouth_m = self.reach_m if half_m is None else MOUTH_BEFORE_M + half_m
        if self.turn.angle_deg is not None and len(seen) == 1:
            behind_mouth_m = self._slanted_m(behind_mouth_m)
        return self.mouth_ahead_m + max(behind_mouth_m, self._config.corner_m)

    def _slanted_m(self, behind_mouth_m: float) -> float:
        """Return how far behind the mouth the middle is, by the middle of a slanted road's opening.

        Where the robot's road ends it is before that end: two roads of one side may share the only
        opening there.
        """
        angle_rad = abs(turning.angle_rad(self.turn))
        if self.ends_here:
            before_end_m = self._width_m / 2 / math.sin(angle_rad)
            return self.end_ahead_m - before_end_m - self.mouth_ahead_m
        return behind_mouth_m - (self._width_m / 2 + BESIDE_M) / math.tan(angle_rad)

    @property
    def end_ahead_m(self) -> float:
        """Distance to where the robot's road ends beyond the junction; infinite: not known to."""
        junction = self._progress.junction
        if junction is None or not junction.end.sure:
            return math.inf
        return junction.end.at_m - self._progress.odometer_m

    @property
    def ends_here(self) -> bool:
        """Whether the robot's road is known to end at the junction, not somewhere beyond it."""
        behind_mouth_m = self.end_ahead_m - self.mouth_ahead_m
        return behind_mouth_m <= 2 * self.reach_m + END_BEYOND_M

    @property
    def past_m(self) -> float:
        """How far the robot is behind the junction's far side, which a straight crossing leaves.

        That is as far behind its middle as the mouth is before it, or where an opening was seen to
        end, whichever is farther: the crossing road may be wider than the robot's.
        """
        mouth_m = self._progress.odometer_m + self.mouth_ahead_m
        across_m = max([2 * self.reach_m, *(end_m - mouth_m for end_m in self._far_ends_m())])
        return -self.mouth_ahead_m - across_m - self.exit_margin_m

    @property
    def exit_margin_m(self) -> float:
        """Distance behind the counted junction at which it has been left.

        Behind the mission's last one, where the robot stops, it is twice what it is elsewhere:
        nothing is lost by stopping late, and the far side may be farther away than is known.
        """
        return (2 if self._progress.at_last_junction else 1) * self._config.exit_margin_m

    def _far_ends_m(self) -> Iterator[float]:
        """Yield where the counted junction ends on its far side, by each edge that begins there."""
        junction = self._progress.junction
        if junction is None:
            return
        for opening in junction.sightings:
            if opening.far_m is not None and _half_length_m(opening) is not None:
                yield opening.far_m + MOUTH_BEFORE_M
        if junction.far.sure:
            end_m = junction.far.at_m + MOUTH_BEFORE_M
            if end_m - self._progress.odometer_m - self.mouth_ahead_m <= LONGEST_OPENING_M:
                yield end_m

    @property
    def speed_limit_mps(self) -> float:
        """Highest speed towards the counted junction."""
        config = self._config
        if self.straight:
            return config.cruise_mps
        ahead_m, speed = self.start_ahead_m, self._progress.speed_mps
        far_m = max(ahead_m - config.approach_m, 0.0)
        slowing = math.sqrt(config.approach_mps**2 + 2 * config.deceleration_mps2 * far_m)
        limit = braking_mps(ahead_m, speed, config.deceleration_mps2, config.velocity_lag_s)
        if self.radius_m > 0:
            limit = max(limit, config.turn.speed_mps)
        return min(limit, slowing, config.cruise_mps)


def _half_length_m(opening: Sighting) -> float | None:
    """Return half the length of an opening; None: its end was not seen, or not believed."""
    if opening.far_m is None:
        return None
    length_m = opening.far_m - opening.near_m
    return length_m / 2 if SHORTEST_OPENING_M <= length_m <= LONGEST_OPENING_M else None
