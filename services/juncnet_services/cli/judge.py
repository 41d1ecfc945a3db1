"""Was a simulated flight flown right? Pure: what was seen is held against the truth."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from juncnet.clocks import NS_PER_S
from juncnet.messages import (
    Ack,
    EventKind,
    JunctionEvent,
    JunctionScore,
    OverrideKind,
    SimulatorTruth,
    VelocityCommand,
)

MAX_OFF_ROAD_M = 0.5
MIN_ON_ROAD = 0.99
MAX_TIME_RATIO = 1.5
MIN_REAL_TIME_FACTOR = 0.95


@dataclass(frozen=True)
class Plan:
    """What a flight should do: the directed roads to drive, and the time that takes at best."""

    path: tuple[int, ...]
    ideal_s: float

    @property
    def turns(self) -> int:
        """Number of junctions at which a way is to be taken (straight on included)."""
        return len(self.path) - 1


class Figures(BaseModel):
    """A flight in figures."""

    model_config = ConfigDict(frozen=True)

    world: str
    vehicle: str
    mission_finished: bool
    junctions_true: int
    junctions_counted: int
    turns_planned: int
    turns_taken: int
    """Of those, how many led into the right road, in order."""
    on_road: float
    """Fraction of the time with the robot's centre on the road."""
    off_road_max_m: float
    centre_rms_m: float
    """Of the distance from the centre line, junctions left out."""
    collisions: int
    time_s: float
    ideal_time_s: float
    fps: float
    """Pictures scored a second."""
    latency_p50_ms: float | None
    """From a picture's capture to the command that follows from it."""
    latency_p99_ms: float | None
    real_time_factor: float
    """Of the flight: simulated time per wall time, or pictures taken per pictures due if lower."""
    real_time_factor_lowest: float
    """The same of its worst second."""

    def faults(self) -> tuple[str, ...]:
        """Return what was not flown right; empty when all was."""
        checks = (
            (not self.mission_finished, "the mission was not finished"),
            (
                self.junctions_counted != self.junctions_true,
                f"counted {self.junctions_counted} junctions, passed {self.junctions_true}",
            ),
            (
                self.turns_taken != self.turns_planned,
                f"{self.turns_taken} of {self.turns_planned} turns led into the right road",
            ),
            (self.on_road < MIN_ON_ROAD, f"on the road {100 * self.on_road:.1f} % of the time"),
            (self.off_road_max_m > MAX_OFF_ROAD_M, f"{self.off_road_max_m:.2f} m off the road"),
            (self.collisions > 0, f"{self.collisions} collisions"),
            (
                self.time_s > MAX_TIME_RATIO * self.ideal_time_s,
                f"took {self.time_s:.0f} s, ideal {self.ideal_time_s:.0f} s",
            ),
        )
        return tuple(text for failed, text in checks if failed)


class Happening(BaseModel):
    """A junction event, and where the robot truly was."""

    model_config = ConfigDict(frozen=True)

    time_s: float
    """Since the first motion."""
    kind: EventKind
    count: int
    probability: float
    x_m: float
    y_m: float
    junction_id: int | None
    """The junction whose surface the robot was on."""
    mouth_m: float | None
    """Distance to the next junction's mouth; None: none ahead."""


class Summary(Figures):
    """The figures and what they amount to."""

    verdict: Literal["flown_right", "failed", "void"]
    """`void`: no verdict on the pipeline, for the simulation itself was too slow (a real-time
    factor under 0.95), or the flight failed and an operator had intervened."""
    flown_right: bool
    reasons: tuple[str, ...]
    """Why not."""
    roads_planned: tuple[int, ...] = ()
    """Ids of the directed roads; like the next two told only of a flight not flown right."""
    roads_driven: tuple[int, ...] = ()
    course: tuple[Happening, ...] = ()


@dataclass
class Judge:
    """Collects what was seen in a flight; `summary` judges it."""

    plan: Plan
    world: str
    vehicle: str
    _truths: list[SimulatorTruth] = field(default_factory=list[SimulatorTruth])
    _latencies_ms: list[float] = field(default_factory=list[float])
    _events: list[JunctionEvent] = field(default_factory=list[JunctionEvent])
    _intervention: str = ""
    _scores: int = 0
    _first_score_ns: int | None = None
    _last_score_ns: int = 0
    _finished_ns: int | None = None
    _moved_ns: int | None = None

    def truth(self, truth: SimulatorTruth) -> None:
        """Take a sample of the truth; the flight begins when the robot first moves."""
        if self._moved_ns is None and abs(truth.velocity.forward_mps) > 0.2:
            self._moved_ns = truth.at.time_ns
        over = self.finished and truth.at.time_ns > (self._finished_ns or 0) + NS_PER_S
        if self._moved_ns is not None and not over:
            self._truths.append(truth)

    def event(self, event: JunctionEvent) -> None:
        """Take a junction event."""
        self._events.append(event)
        if event.kind is EventKind.MISSION_FINISHED and self._finished_ns is None:
            self._finished_ns = event.header.time_ns

    def answer(self, ack: Ack) -> None:
        """Take an answer to an operator; what was obeyed and ends the mission is remembered."""
        harmless = (OverrideKind.RESUME, OverrideKind.TAKE_OFF)
        if ack.accepted and ack.kind not in harmless and not self.finished:
            self._intervention = self._intervention or f"an operator ordered {ack.kind}"

    def command(self, command: VelocityCommand) -> None:
        """Take a velocity command."""
        self._latencies_ms.append((command.issued.time_ns - command.header.time_ns) / 1e6)

    def score(self, score: JunctionScore) -> None:
        """Take a junction score."""
        if self._first_score_ns is None:
            self._first_score_ns = score.header.time_ns
        self._last_score_ns = score.header.time_ns
        self._scores += 1

    @property
    def truths(self) -> tuple[SimulatorTruth, ...]:
        """The truth from the first motion to the end."""
        return tuple(self._truths)

    @property
    def finished(self) -> bool:
        """Whether the mission has been reported finished."""
        return self._finished_ns is not None

    def _time_s(self) -> float:
        if self._moved_ns is None:
            return 0.0
        end = self._finished_ns or self._truths[-1].at.time_ns
        return (end - self._moved_ns) / NS_PER_S

    def _fps(self) -> float:
        if self._first_score_ns is None or self._scores < 2:
            return 0.0
        return (self._scores - 1) * NS_PER_S / (self._last_score_ns - self._first_score_ns)

    def summary(self, standing: str = "") -> Summary:
        """Return the figures and the verdict.

        `standing`: what kept the robot when the flight's time was up, if its mission was not
        finished then.
        """
        truths = self._truths
        off = np.array([t.off_road_m for t in truths] or [0.0])
        offsets = np.array([t.road_offset_m for t in truths if t.junction_id is None] or [0.0])
        latency, factors = self._latencies_ms, [t.real_time_factor for t in truths] or [0.0]
        figures = Figures(
            world=self.world,
            vehicle=self.vehicle,
            mission_finished=self.finished,
            junctions_true=truths[-1].junctions_passed if truths else 0,
            junctions_counted=max((event.count for event in self._events), default=0),
            turns_planned=self.plan.turns,
            turns_taken=ways_right(self.plan.path, truths[-1].path if truths else ()),
            on_road=float((off <= 0).mean()),
            off_road_max_m=float(off.max()),
            centre_rms_m=float(np.sqrt((offsets**2).mean())),
            collisions=_rising_edges([t.collided for t in truths]),
            time_s=self._time_s(),
            ideal_time_s=self.plan.ideal_s,
            fps=self._fps(),
            latency_p50_ms=float(np.percentile(latency, 50)) if latency else None,
            latency_p99_ms=float(np.percentile(latency, 99)) if latency else None,
            real_time_factor=float(np.mean(factors)),
            real_time_factor_lowest=min(factors),
        )
        reasons = figures.faults()
        verdict = "failed" if reasons else "flown_right"
        if figures.real_time_factor < MIN_REAL_TIME_FACTOR:
            verdict = "void"
            reasons = (f"real-time factor {figures.real_time_factor:.2f}", *reasons)
        elif reasons and self._intervention:
            verdict = "void"
            reasons = (self._intervention, *reasons)
        if standing and not self.finished:
            reasons = (*reasons, f"at the end: {standing}")
        told = bool(reasons and truths)
        return Summary(
            **figures.model_dump(),
            verdict=verdict,
            flown_right=verdict == "flown_right",
            reasons=reasons,
            roads_planned=self.plan.path if told else (),
            roads_driven=truths[-1].path if told else (),
            course=tuple(self._course()) if told else (),
        )

    def _course(self) -> Iterator[Happening]:
        times = np.array([truth.at.time_ns for truth in self._truths])
        for event in self._events:
            truth = self._truths[int(np.abs(times - event.header.time_ns).argmin())]
            yield Happening(
                time_s=(event.header.time_ns - int(times[0])) / NS_PER_S,
                kind=event.kind,
                count=event.count,
                probability=event.probability,
                x_m=truth.pose.x_m,
                y_m=truth.pose.y_m,
                junction_id=truth.junction_id,
                mouth_m=truth.mouth_m,
            )


def ways_right(planned: Sequence[int], driven: Sequence[int]) -> int:
    """Return how many junctions were left by the planned road, up to the first that was not."""
    right = 0
    for wanted, taken in zip(planned[1:], driven[1:], strict=False):
        if wanted != taken:
            break
        right += 1
    return right


def _rising_edges(flags: list[bool]) -> int:
    return sum(now and not before for before, now in zip([False, *flags], flags, strict=False))
