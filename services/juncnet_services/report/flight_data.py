"""What a report needs of a recording, as arrays and rows; times in seconds since its beginning."""

from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from juncnet.clocks import NS_PER_S
from juncnet.messages import (
    ActiveModel,
    EventKind,
    Health,
    JunctionEvent,
    JunctionScore,
    NavigationState,
    RoadCommand,
    RoadSurface,
    SimulatorTruth,
    Stamp,
    VehicleState,
    VelocityCommand,
)
from juncnet.recording.reader import Recorded, Recording

F64 = NDArray[np.float64]
Series = list[tuple[float, float]]


@dataclass(frozen=True)
class Incident:
    """Something that a process told of its health."""

    time_s: float
    process: str
    text: str


@dataclass(frozen=True)
class Marked:
    """A junction event, when it came and where the vehicle was (None: unknown)."""

    time_s: float
    event: JunctionEvent
    place: tuple[float, float] | None
    surface: RoadSurface | None = None
    """The follower's newest map of the road's surface."""


@dataclass
class FlightData:
    """A flight as a report shows it."""

    probability: Series = field(default_factory=list[tuple[float, float]])
    smoothed: Series = field(default_factory=list[tuple[float, float]])
    phases: list[tuple[float, str]] = field(default_factory=list[tuple[float, str]])
    events: list[Marked] = field(default_factory=list[Marked])
    path: list[tuple[float, float, float]] = field(default_factory=list[tuple[float, float, float]])
    """(s, x m, y m) in the vehicle's frame."""
    fixes: list[tuple[float, float, float]] = field(
        default_factory=list[tuple[float, float, float]]
    )
    """(s, latitude, longitude) where there is GPS."""
    truths: list[tuple[float, SimulatorTruth]] = field(
        default_factory=list[tuple[float, SimulatorTruth]]
    )
    latency_ms: list[float] = field(default_factory=list[float])
    """From a picture's capture to the command that follows from it, where one clock told both."""
    rates: dict[str, Series] = field(default_factory=lambda: defaultdict(list))
    incidents: list[Incident] = field(default_factory=list[Incident])
    restarts: Counter[str] = field(default_factory=Counter[str])
    model: ActiveModel | None = None
    navigation: NavigationState | None = None
    thresholds: tuple[float, float] | None = None
    """(enter, leave) of the smoothed probability."""
    duration_s: float = 0.0

    @property
    def counted(self) -> int:
        """Junctions counted."""
        return max((m.event.count for m in self.events), default=0)

    @property
    def turns(self) -> list[Marked]:
        """The turns that were finished."""
        return [m for m in self.events if m.event.kind is EventKind.TURN_FINISHED]


class Collector:
    """Takes recorded messages in order and keeps what a report shows."""

    def __init__(self) -> None:
        self.data = FlightData()
        self._first_ns: int | None = None
        self._pids: dict[str, int] = {}
        self._errors: dict[str, str] = {}
        self._seen: set[tuple[str, int]] = set()
        self._surface: RoadSurface | None = None

    def take(self, item: Recorded) -> None:
        """Take the next message."""
        self._first_ns = item.time_ns if self._first_ns is None else self._first_ns
        now_s = (item.time_ns - self._first_ns) / NS_PER_S
        data, message = self.data, item.message
        data.duration_s = now_s
        match message:
            case JunctionScore():
                data.probability.append((now_s, message.junction))
            case NavigationState():
                self._navigation(now_s, message)
            case JunctionEvent():
                self._event(now_s, message)
            case RoadCommand():
                self._surface = message.surface
            case VehicleState():
                self._vehicle(now_s, message)
            case SimulatorTruth():
                data.truths.append((now_s, message))
            case VelocityCommand():
                self._command(message.header, message.issued)
            case Health():
                self._health(now_s, message)
            case ActiveModel():
                data.model = message
            case _:
                pass

    def _navigation(self, now_s: float, state: NavigationState) -> None:
        data = self.data
        data.navigation = state
        data.smoothed.append((now_s, state.smoothed))
        if state.thresholds is not None:
            data.thresholds = (state.thresholds.enter, state.thresholds.leave)
        if not data.phases or data.phases[-1][1] != state.phase:
            data.phases.append((now_s, str(state.phase)))

    def _event(self, now_s: float, event: JunctionEvent) -> None:
        if (event.flight, event.index) in self._seen:
            return
        self._seen.add((event.flight, event.index))
        place = self.data.path[-1][1:] if self.data.path else None
        self.data.events.append(Marked(now_s, event, place, self._surface))

    def _vehicle(self, now_s: float, state: VehicleState) -> None:
        if state.pose is not None:
            self.data.path.append((now_s, state.pose.x_m, state.pose.y_m))
        if state.gps is not None:
            self.data.fixes.append((now_s, state.gps.latitude_deg, state.gps.longitude_deg))

    def _command(self, header: Stamp, issued: Stamp) -> None:
        if header.clock == issued.clock:
            self.data.latency_ms.append((issued.time_ns - header.time_ns) / 1e6)

    def _health(self, now_s: float, health: Health) -> None:
        data, name = self.data, health.service
        data.rates[name].append((now_s, health.rate_hz))
        if self._pids.setdefault(name, health.pid) != health.pid:
            self._pids[name] = health.pid
            data.restarts[name] += 1
            data.incidents.append(Incident(now_s, name, "started again"))
        if health.last_error and self._errors.get(name) != health.last_error:
            self._errors[name] = health.last_error
            data.incidents.append(Incident(now_s, name, health.last_error))


def collect(recording: Recording) -> FlightData:
    """Return what a report shows of a recording."""
    collector = Collector()
    for item in recording.messages(_wanted()):
        collector.take(item)
    return collector.data


def _wanted() -> Iterable[str]:
    from juncnet.topics import CAMERA_VIDEO, SERVICES, TOPICS, Topic, health_topic

    keys = [t.key for t in TOPICS if isinstance(t, Topic) and t is not CAMERA_VIDEO]
    return [*keys, *(health_topic(name).key for name in (*SERVICES, "simulator"))]
