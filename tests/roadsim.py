"""A robot on a plane of straight roads, for tests of the navigator: kinematics, follower, score.

Everything is analytic: the score is a noisy function of the distance of the next junction's mouth,
the follower sees the road that lies best ahead, and both are late by the pipeline's delay.
"""

import math
import random
from collections import deque
from dataclasses import dataclass, field

from juncnet.clocks import Instant
from juncnet.messages import (
    Capabilities,
    EventKind,
    JunctionEvent,
    JunctionScore,
    Mission,
    ModelIdentity,
    Output,
    Pose,
    RoadCommand,
    RoadSeen,
    Stamp,
    VehicleState,
    Velocity,
)
from juncnet_services.junction_navigation.config import NavigatorConfig
from juncnet_services.junction_navigation.decision import Decision
from juncnet_services.junction_navigation.navigator import Navigator
from juncnet_services.junction_navigation.pace import Pace
from juncnet_services.junction_navigation.progress import Progress
from juncnet_services.junction_navigation.store import Resumed

CLOCK = "sim"
TICK_S = 0.02
FRAME_S = 0.04
LATENCY_S = 0.06
HALF_WIDTH_M = 3.0
CORNER_M = 3.0
MODEL = ModelIdentity(name="sim", sha256="0" * 64)
COPTER = Capabilities(
    kind="copter", lateral=True, vertical=True, turns_in_place=True, telemetry=True
)
ROVER = Capabilities(kind="rover", minimum_radius_m=2.5, telemetry=True)

Point = tuple[float, float]
Visit = tuple[EventKind, Point, float]


def wrap(angle: float) -> float:
    return math.remainder(angle, 2 * math.pi)


@dataclass(frozen=True)
class Road:
    a: Point
    b: Point

    def directed(self) -> list[tuple[Point, float, float]]:
        """(start, direction, length) both ways."""
        length, (ax, ay), (bx, by) = math.dist(self.a, self.b), self.a, self.b
        along = math.atan2(by - ay, bx - ax)
        return [(self.a, along, length), (self.b, along + math.pi, length)]


@dataclass(frozen=True)
class Plane:
    """Roads between points; `junctions` are the points where the score is to fire."""

    roads: tuple[Road, ...]
    junctions: tuple[Point, ...]
    setback_m: float = HALF_WIDTH_M + CORNER_M


def crossroads(at: list[float], skew_deg: float = 90.0) -> Plane:
    """A road along x with a crossing road at each of `at`, `skew_deg` against it."""
    c, s = math.cos(math.radians(skew_deg)), math.sin(math.radians(skew_deg))
    roads = [Road((-200.0, 0.0), (at[-1] + 300.0, 0.0))]
    roads += [Road((x - 300 * c, -300 * s), (x + 300 * c, 300 * s)) for x in at]
    widening = 1.8 if abs(skew_deg - 90) < 1 else 1.25
    setback = HALF_WIDTH_M * (1 + abs(c)) / s + widening if abs(c) > 0.1 else 6.0
    return Plane(tuple(roads), tuple((x, 0.0) for x in at), setback)


@dataclass
class Flight:
    """One run: options in, events and the path out."""

    plane: Plane
    mission: Mission
    config: NavigatorConfig = field(default_factory=NavigatorConfig)
    capabilities: Capabilities = COPTER
    start_m: float = -40.0
    speed_error: float = 0.0
    """Measured speed against the true one; without telemetry, the true one against the command."""
    rise_bias: float = 0.0
    fall_bias: float = 0.0
    drop: float = 0.0
    """Share of scores that never arrive."""
    flicker: float = 0.0
    """Share of scores that say the contrary."""
    stuck: bool = False
    """The score stays high once the first junction was seen."""
    pose: bool = True
    with_road: bool = True
    """Whether the follower tells the road that it saw."""
    seed: int = 1
    events: list[JunctionEvent] = field(default_factory=list[JunctionEvent])
    where: list[Visit] = field(default_factory=list[Visit])
    path: list[Point] = field(default_factory=list[Point])
    decision: Decision | None = None

    def __post_init__(self) -> None:
        self.random = random.Random(self.seed)
        self.x, self.y, self.yaw, self.v, self.w, self.t = self.start_m, 0.0, 0.0, 0.0, 0.0, 1.0
        self.side = 0.0
        self.command, self.command_t = Velocity(), 0.0
        self.sequence, self.next_frame, self.seen = 0, 1.0, False
        self.waiting: deque[tuple[float, JunctionScore, RoadCommand]] = deque()
        self.navigator = Navigator(self.config, self.mission, "flight-1")
        self.alive_at = 0.0
        self.pace, self.saved = Pace(), ""

    # --- senses ---

    def mouth_ahead(self) -> float | None:
        best = None
        for jx, jy in self.plane.junctions:
            c, s = math.cos(self.yaw), math.sin(self.yaw)
            ahead = (jx - self.x) * c + (jy - self.y) * s
            beside = -(jx - self.x) * s + (jy - self.y) * c
            mouth = ahead - self.plane.setback_m
            if mouth > 0 and abs(beside) < 4 and (best is None or mouth < best):
                best = mouth
        return best

    def probability(self) -> float:
        mouth, band = self.mouth_ahead(), self.config.camera.band
        high = False
        if mouth is not None:
            near, far = band.d_near_m * (1 + self.fall_bias), band.d_far_m * (1 + self.rise_bias)
            high = near <= mouth <= far
        self.seen = self.seen or high
        if self.stuck and self.seen:
            high = True
        if self.random.random() < self.flicker:
            high = not high
        return (0.97 if high else 0.03) + self.random.uniform(-0.03, 0.03)

    def follow(self, header: Stamp) -> RoadCommand:
        best = None
        for road in self.plane.roads:
            for (ax, ay), along, length in road.directed():
                heading = wrap(along - self.yaw)
                if abs(heading) > math.radians(50):
                    continue
                c, s = math.cos(along), math.sin(along)
                t = (self.x - ax) * c + (self.y - ay) * s
                offset = (self.x - ax) * s - (self.y - ay) * c
                beside = offset + 5 * math.sin(heading)
                if -5 < t < length - 5 and abs(beside) < 4.5:
                    cost = abs(heading) + 0.15 * abs(offset)
                    if best is None or cost < best[0]:
                        best = (cost, heading, offset)
        if best is None:
            return RoadCommand(
                header=header, source="road_following", velocity=None, confidence=0.0
            )
        _, heading, offset = best
        forward = 6.0
        rate = forward * (0.12 * offset + 0.6 * heading)
        seen = RoadSeen(offset_m=offset, heading_rad=heading, width_m=2 * HALF_WIDTH_M)
        return RoadCommand(
            header=header,
            source="road_following",
            velocity=Velocity(forward_mps=forward, yaw_rate_radps=max(min(rate, 4), -4)),
            confidence=0.9,
            road=seen if self.with_road else None,
        )

    def frame(self) -> None:
        self.sequence += 1
        header = self.stamp(self.sequence)
        p = self.probability()
        score = JunctionScore(
            header=header, model=MODEL, probabilities={"none": 1 - p, "junction": p}
        )
        self.waiting.append((self.t + LATENCY_S, score, self.follow(header)))

    def stamp(self, sequence: int) -> Stamp:
        return Stamp(epoch=1, sequence=sequence, time_ns=round(self.t * 1e9), clock=CLOCK)

    def vehicle(self) -> VehicleState:
        telemetry = self.capabilities.telemetry
        scale = 1 + self.speed_error
        velocity = Velocity(forward_mps=self.v * scale, yaw_rate_radps=self.w)
        pose = Pose(x_m=self.x, y_m=self.y, yaw_rad=wrap(self.yaw))
        return VehicleState(
            at=self.stamp(round(self.t * 1000)),
            capabilities=self.capabilities,
            yaw_rad=wrap(self.yaw) if telemetry else None,
            velocity=velocity if telemetry else None,
            pose=pose if telemetry and self.pose else None,
            output=Output.PIPELINE if self.holds_not else Output.HOLD,
            commanded=self.command if self.holds_not else Velocity(),
        )

    # --- the world ---

    @property
    def holds_not(self) -> bool:
        return self.t - self.command_t <= 0.2

    def move(self) -> None:
        wanted = self.command if self.holds_not else Velocity()
        scale = 1.0 if self.capabilities.telemetry else 1 + self.speed_error
        self.v += (wanted.forward_mps * scale - self.v) * min(TICK_S / 0.35, 1)
        self.side += (wanted.lateral_mps * scale - self.side) * min(TICK_S / 0.35, 1)
        self.w += (wanted.yaw_rate_radps - self.w) * min(TICK_S / 0.15, 1)
        self.yaw += self.w * TICK_S
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        self.x += (self.v * c - self.side * s) * TICK_S
        self.y += (self.v * s + self.side * c) * TICK_S
        self.t += TICK_S
        if self.t >= self.next_frame:
            self.next_frame += FRAME_S
            self.frame()
            self.path.append((self.x, self.y))

    def tick(self) -> None:
        self.move()
        if self.t < self.alive_at or not self.waiting or self.waiting[0][0] > self.t:
            return
        _, score, road = self.waiting.popleft()
        kept = score if self.random.random() >= self.drop else None
        now = Instant(round(self.t * 1e9), CLOCK)
        decision = self.navigator.step(now, kept, road, self.vehicle())
        self.decision, self.command, self.command_t = decision, decision.velocity, self.t
        if self.pace.save_due(now.ns, decision):
            self.saved = self.navigator.progress.model_dump_json()
        known = {event.index for event in self.events}
        for event in decision.events:
            if event.index not in known:
                self.events.append(event)
                self.where.append((event.kind, (self.x, self.y), self.yaw))

    def kill(self, outage_s: float = 1.0) -> None:
        """The navigator dies now and comes back from what it saved."""
        saved = Progress.model_validate_json(self.saved)
        self.alive_at = self.t + outage_s
        while self.t < self.alive_at:
            self.move()
        self.waiting.clear()
        self.navigator = Navigator(self.config, self.mission, "flight-1", Resumed(saved, "resumed"))

    def run(self, seconds: float) -> "Flight":
        """Fly until the mission is finished, or for `seconds`."""
        end = self.t + seconds
        while self.t < end and EventKind.MISSION_FINISHED not in self.kinds:
            self.tick()
        return self

    @property
    def kinds(self) -> list[EventKind]:
        return [event.kind for event in self.events]

    def at(self, kind: EventKind, number: int = 0) -> tuple[Point, float]:
        """Where the robot was, and its yaw, at the `number`-th event of a kind."""
        found = [(place, yaw) for k, place, yaw in self.where if k is kind]
        return found[number]
