"""What was heard of each robot: pure. `now_ns` is this host's clock; what is kept is bounded."""

import math
from collections import OrderedDict
from collections.abc import Iterator
from typing import Any

from juncnet.clocks import NS_PER_S
from juncnet.messages import (
    Ack,
    ActiveFollower,
    ActiveModel,
    Features,
    Health,
    JpegImage,
    JunctionEvent,
    JunctionScore,
    NavigationState,
    RoadCommand,
    Stamp,
    VehicleState,
)
from juncnet_services.dashboard.journal import Journal
from juncnet_services.dashboard.tally import Tally

SCORES, SMOOTHED, PATH_POINTS, EVENTS = 1500, 1500, 20_000, 400
"""Rows kept: a minute at 25 Hz, 6 km, and more events than one reads."""
PATH_STEP_M = 0.3
RECENT = 32
"""Pictures whose score, road and features are kept for the picture to come."""
MAX_PROCESSES = 64
EARTH_M_PER_RAD = 6_371_000.0
Row = dict[str, Any]
Key = tuple[int, int]


def key_of(header: Stamp) -> Key:
    """Return what tells pictures of one robot apart, in order."""
    return (header.epoch, header.sequence)


class Recent(OrderedDict[Key, Any]):
    """The newest few things by the picture that they follow from."""

    def keep(self, header: Stamp, thing: Any) -> None:
        """Keep `thing` for the picture of `header`."""
        self[key_of(header)] = thing
        while len(self) > RECENT:
            self.popitem(last=False)

    def upto(self, header: Stamp) -> Any:
        """Return what follows from this picture, else from the newest before it; None: nothing."""
        wanted = key_of(header)
        return next((thing for key, thing in reversed(self.items()) if key <= wanted), None)


class Robot:
    """One robot, as heard."""

    def __init__(self, serials: Iterator[int]) -> None:
        self.navigation: NavigationState | None = None
        self.vehicle: VehicleState | None = None
        self.model: ActiveModel | None = None
        self.follower: ActiveFollower | None = None
        self.picture: JpegImage | None = None
        self.health: dict[str, tuple[Health, int]] = {}
        """The newest report of each process, and when it was heard."""
        self.heard_ns: int | None = None
        """When anything was last heard."""
        self.vehicle_ns: int | None = None
        self.place: tuple[float, float] | None = None
        """Where the robot is (x, y in metres), in a frame of its own."""
        self.roads, self.recent_scores, self.recent_features = Recent(), Recent(), Recent()
        self.scores: Journal[tuple[float, float]] = Journal(serials, SCORES)
        self.smoothed: Journal[tuple[float, float]] = Journal(serials, SMOOTHED)
        self.path: Journal[tuple[float, float]] = Journal(serials, PATH_POINTS)
        self.events: Journal[Row] = Journal(serials, EVENTS)
        self.tally = Tally()
        self._known: set[tuple[str, int]] = set()
        self._errors: dict[str, tuple[int, str]] = {}
        self._origin: tuple[float, float] | None = None

    @property
    def flight(self) -> str:
        """Id of the flight, empty while it is not known."""
        return "" if self.navigation is None else self.navigation.flight

    def take(self, message: Any, now_ns: int) -> None:
        """Take a message of this robot, heard at `now_ns`."""
        self.heard_ns = now_ns
        match message:
            case JunctionScore():
                self.scores.add((_seconds(message.header), round(message.junction, 4)))
                self.recent_scores.keep(message.header, message)
            case NavigationState():
                self._take_navigation(message)
            case VehicleState():
                self._take_vehicle(message, now_ns)
            case RoadCommand():
                self.roads.keep(message.header, message)
            case Features():
                self.recent_features.keep(message.header, message)
            case JpegImage():
                self.picture = message
            case JunctionEvent():
                self._take_event(message)
            case Health():
                self._take_health(message, now_ns)
            case Ack():
                self._take_ack(message)
            case ActiveModel():
                self._change("model", self.model and self.model.model.name, message.model.name)
                self.model = message
            case ActiveFollower():
                self._change("follower", self.follower and self.follower.follower, message.follower)
                self.follower = message
            case _:
                raise TypeError(f"a robot does not say {type(message).__name__}")

    def note(self, kind: str, text: str, at_s: float | None = None, **more: Any) -> None:
        """Add an event to the page's list; `at_s` is on the robot's clock, None: just now."""
        row = {"kind": kind, "text": text, "t": at_s, "heard_ns": self.heard_ns, **more}
        self.events.add(row)

    def _take_navigation(self, state: NavigationState) -> None:
        if self.flight and state.flight != self.flight:
            for journal in (self.scores, self.smoothed, self.path, self.events):
                journal.clear()
            self.tally = Tally()
            self._known.clear()
        self.navigation = state
        if state.header is not None:
            row = (_seconds(state.header), round(state.smoothed, 4))
            if self.smoothed.last is None or self.smoothed.last[0] != row[0]:
                self.smoothed.add(row)

    def _take_vehicle(self, state: VehicleState, now_ns: int) -> None:
        self.vehicle, self.vehicle_ns = state, now_ns
        self.place = self._place(state)
        self.tally.vehicle(state, self.place)
        last = self.path.last
        if self.place and (last is None or math.dist(last, self.place) > PATH_STEP_M):
            self.path.add((round(self.place[0], 2), round(self.place[1], 2)))

    def _place(self, state: VehicleState) -> tuple[float, float] | None:
        """Return x, y in metres: of the pose, else of GPS, east and north of its first fix."""
        if state.pose is not None:
            return (state.pose.x_m, state.pose.y_m)
        if state.gps is None:
            return None
        here = (math.radians(state.gps.longitude_deg), math.radians(state.gps.latitude_deg))
        self._origin = self._origin or here
        east = (here[0] - self._origin[0]) * math.cos(self._origin[1]) * EARTH_M_PER_RAD
        return (east, (here[1] - self._origin[1]) * EARTH_M_PER_RAD)

    def _take_event(self, event: JunctionEvent) -> None:
        known = (event.flight, event.index)
        if known in self._known:
            return
        self._known.add(known)
        self.tally.event(event)
        turn = None if event.turn is None else event.turn.model_dump(exclude_none=True)
        self.note(
            event.kind.value,
            event.label,
            _seconds(event.header),
            count=event.count,
            probability=event.probability,
            turn=turn,
            place=self.place,
        )

    def _take_health(self, health: Health, now_ns: int) -> None:
        if health.service not in self.health and len(self.health) >= MAX_PROCESSES:
            return
        before = self.health.get(health.service)
        self.health[health.service] = (health, now_ns)
        if health.service == "junction_navigation":
            self.tally.navigator(health)
        at_s = _seconds(health.at)
        if before is not None and before[0].pid != health.pid:
            self.note("restarted", health.service, at_s)
        if health.last_error and self._errors.get(health.service, (0, ""))[1] != health.last_error:
            self.note("error", f"{health.service}: {health.last_error}", at_s)
        self._errors[health.service] = (health.errors, health.last_error)

    def _take_ack(self, ack: Ack) -> None:
        verdict = "obeyed" if ack.accepted else "refused"
        self.note("order", f"{ack.kind.value} {verdict}: {ack.reason}", _seconds(ack.at))

    def _change(self, what: str, before: str | None, now: str) -> None:
        if before is not None and before != now:
            self.note("swapped", f"{what}: {now} instead of {before}")


class Robots(dict[str, Robot]):
    """All robots that were heard of, by name."""

    LIMIT = 64

    def __init__(self) -> None:
        super().__init__()
        self.serial = 0
        """Of the newest row of any robot."""
        self._serials = self._count()

    def _count(self) -> Iterator[int]:
        while True:
            self.serial += 1
            yield self.serial

    def take(self, name: str, message: Any, now_ns: int) -> None:
        """Take a message of the robot called `name`; more than `LIMIT` robots are not shown."""
        if name not in self:
            if len(self) >= self.LIMIT:
                return
            self[name] = Robot(self._serials)
        self[name].take(message, now_ns)


def _seconds(stamp: Stamp) -> float:
    return round(stamp.time_ns / NS_PER_S, 3)
