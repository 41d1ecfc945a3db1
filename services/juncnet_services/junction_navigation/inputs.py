"""What the navigator has been told, what of it is fresh, and what it refuses to obey."""

import math
from collections.abc import Mapping

from juncnet.clocks import Instant, Offset, ReplayGate, age_s, is_stale, local_ns
from juncnet.messages import (
    JunctionScore,
    Output,
    RoadCommand,
    RoadSeen,
    RoadSurface,
    Stamp,
    VehicleState,
)
from juncnet.topics import JUNCTION_SCORE, ROAD_COMMAND
from juncnet_services.junction_navigation import turning
from juncnet_services.junction_navigation.config import NavigatorConfig

CERTAIN = 0.6
TRUSTED = 0.9
USUAL_SHARE = 0.01
"""Weight of a view in what a follower's confidence usually is."""


class Inputs:
    """The newest score, road command and vehicle state that were accepted.

    `offsets`: measured offsets of other hosts' clocks, by clock.
    """

    def __init__(
        self, config: NavigatorConfig, offsets: Mapping[str, Offset] | None = None
    ) -> None:
        self._config = config
        self._offsets: Mapping[str, Offset] = {} if offsets is None else offsets
        self._scores, self._roads, self._frames = ReplayGate(), ReplayGate(), ReplayGate()
        self._vehicle_ns = 0
        self._usual = TRUSTED
        self.score: JunctionScore | None = None
        self.road: RoadCommand | None = None
        self.vehicle: VehicleState | None = None
        self.header: Stamp | None = None
        """Of the newest frame."""
        self.refused: list[str] = []
        """What was not accepted, and why; for the caller to take."""

    def accept_score(self, now: Instant, score: JunctionScore) -> bool:
        """Return whether the score is news, and keep it then."""
        header = score.header
        if not self._newer(self._scores, header, now):
            self.refused.append(f"junction/score {header.epoch}/{header.sequence} is a replay")
            return False
        self.score = score
        self._see(header, now)
        return True

    def accept_road(self, now: Instant, road: RoadCommand) -> bool:
        """Return whether the road command is news from the configured source; keep it then."""
        header = road.header
        if road.source != self._config.road_source:
            wanted = self._config.road_source
            self.refused.append(f"road/command of {road.source}: only {wanted} is obeyed")
            return False
        if not self._newer(self._roads, header, now):
            self.refused.append(f"road/command {header.epoch}/{header.sequence} is a replay")
            return False
        self.road = road
        self._see(header, now)
        if self.road_visible:
            self._usual += USUAL_SHARE * (road.confidence - self._usual)
        return True

    def accept_vehicle(self, now: Instant, vehicle: VehicleState) -> None:
        """Keep a vehicle state; its age counts from its arrival, whatever clock stamped it."""
        if vehicle != self.vehicle:
            self.vehicle, self._vehicle_ns = vehicle, now.ns

    def live_vehicle(self, now: Instant) -> VehicleState | None:
        """Return the vehicle state, None when it has been silent for too long."""
        silence_s = (now.ns - self._vehicle_ns) / 1e9
        return self.vehicle if silence_s < self._config.vehicle_silence_s else None

    def captured_ns(self, header: Stamp, now: Instant) -> int:
        """Return when a frame was captured, on our clock; `now` where that is not known."""
        captured = local_ns(header.instant, now, self._offsets.get(header.clock))
        return now.ns if captured is None else captured

    def why_hold(self, now: Instant) -> str:
        """Return what is missing, for which the robot must hold; empty: nothing."""
        vehicle = self.live_vehicle(now)
        if vehicle is None:
            return "vehicle/state is silent"
        limit_s = self._config.picture_age_s
        for topic, newest in ((JUNCTION_SCORE, self.score), (ROAD_COMMAND, self.road)):
            if newest is None:
                return f"no {topic.key} yet"
            age = age_s(newest.header.instant, now, self._offsets.get(newest.header.clock))
            if age is None:
                return f"{topic.key} rests on a picture of unknown age"
            if is_stale(age, limit_s):
                return f"{topic.key} rests on a picture older than {limit_s} s"
        if vehicle.output in (Output.LANDING, Output.EMERGENCY):
            return f"the vehicle's output is {vehicle.output}"
        return ""

    @property
    def road_visible(self) -> bool:
        """Whether the follower sees a road and is sure enough of it."""
        road = self.road
        if road is None or road.velocity is None:
            return False
        return road.confidence >= self._config.confidence

    @property
    def road_certain(self) -> bool:
        """Whether the follower is sure enough to be believed on a junction's surface."""
        return self.road_confidence >= CERTAIN

    @property
    def road_confidence(self) -> float:
        """How sure the follower is of the road that it sees; 0: it sees none."""
        return 0.0 if self.road is None or not self.road_visible else self.road.confidence

    @property
    def road_trust(self) -> float:
        """How much of a follower's steering to take where side arms may mislead it, 0..1.

        A follower that is never very sure is measured by what it usually is.
        """
        usual = min(self._usual / TRUSTED, 1.0)
        confidence = self.road_confidence / usual
        return min(max((confidence - CERTAIN) / (TRUSTED - CERTAIN), 0.0), 1.0)

    @property
    def _seen(self) -> RoadSeen | None:
        return None if self.road is None else self.road.road

    @property
    def road_aside(self) -> bool:
        """Whether the robot is not on the road that the follower sees: a side arm, say."""
        seen = self._seen
        return seen is not None and abs(seen.offset_m) > seen.width_m / 2

    @property
    def surface(self) -> RoadSurface | None:
        """The road's surface around the robot; None: nobody tells."""
        return None if self.road is None else self.road.surface

    @property
    def road_heading_rad(self) -> float:
        """Direction of the seen road against the robot's own; 0 where nobody tells."""
        return 0.0 if self._seen is None else self._seen.heading_rad

    @property
    def road_ends_m(self) -> float | None:
        """Where the road's surface ends straight ahead; None: not in sight, or nobody tells."""
        return None if self._seen is None else self._seen.ends_m

    def road_towards_rad(self, yaw_rad: float) -> float:
        """Return where from a robot that looks along `yaw_rad` the middle of the seen road lies.

        Of a follower that tells no road: straight ahead.
        """
        if self._seen is None or not self._seen.centre:
            return yaw_rad
        return yaw_rad + turning.bearing_rad(self._seen)

    @property
    def road_bent(self) -> bool:
        """Whether the seen line bends faster than roads do, on its way to its middle.

        It begins on the robot's road then and ends in another arm of the junction.
        """
        if self._seen is None or len(self._seen.centre) < 2:
            return False
        centre = self._seen.centre
        before, middle = centre[len(centre) // 2 - 1 : len(centre) // 2 + 1]
        direction = math.atan2(middle[1] - before[1], middle[0] - before[0])
        return abs(direction - self._seen.heading_rad) > turning.bent_rad(math.hypot(*middle))

    def _see(self, header: Stamp, now: Instant) -> None:
        if self._newer(self._frames, header, now):
            self.header = header

    def _newer(self, gate: ReplayGate, header: Stamp, now: Instant) -> bool:
        return gate.accept(header, now, self._offsets.get(header.clock))
