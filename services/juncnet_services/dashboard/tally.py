"""What a flight comes to, for the page's summary: pure, fed with what was heard."""

import math
from dataclasses import dataclass

from juncnet.clocks import NS_PER_S
from juncnet.messages import EventKind, Health, JunctionEvent, Output, VehicleState


@dataclass
class Tally:
    """Counts of one flight of one robot, as heard; times are the robot's own."""

    moved_m: float = 0.0
    """Length of the path, where the vehicle tells its position."""
    turns: int = 0
    holds: int = 0
    """How often the pipeline's commands gave way to a hold or a stop."""
    oldest_picture_s: float = 0.0
    """Largest picture age with which the navigator commanded."""
    _began_ns: int | None = None
    _ended_ns: int | None = None
    _output: Output | None = None
    _place: tuple[float, float] | None = None

    def event(self, event: JunctionEvent) -> None:
        """Take a junction event, each once."""
        if event.kind is EventKind.TURN_FINISHED:
            self.turns += 1
        elif event.kind is EventKind.MISSION_FINISHED:
            self._ended_ns = event.header.time_ns

    def vehicle(self, state: VehicleState, place: tuple[float, float] | None) -> None:
        """Take the vehicle's state and where it is (x, y in metres; None: it does not tell)."""
        if self.finished:
            return
        if state.output is Output.PIPELINE and self._began_ns is None:
            self._began_ns = state.at.time_ns
        if self._output is Output.PIPELINE and state.output in (Output.HOLD, Output.STOPPED):
            self.holds += 1
        self._output = state.output
        if place is not None and self._place is not None:
            self.moved_m += math.dist(self._place, place)
        self._place = place

    def navigator(self, health: Health) -> None:
        """Take a report of the navigator."""
        if not self.finished and health.age_s is not None:
            self.oldest_picture_s = max(self.oldest_picture_s, health.age_s)

    @property
    def finished(self) -> bool:
        """Whether the mission is finished."""
        return self._ended_ns is not None

    @property
    def seconds(self) -> float | None:
        """From the first command to the end of the mission; None: not known (yet)."""
        if self._began_ns is None or self._ended_ns is None:
            return None
        return max(0.0, (self._ended_ns - self._began_ns) / NS_PER_S)

    def as_json(self) -> dict[str, float | bool | None]:
        """Return the tally as the page takes it."""
        return {
            "finished": self.finished,
            "seconds": self.seconds,
            "moved_m": round(self.moved_m, 1),
            "turns": self.turns,
            "holds": self.holds,
            "oldest_picture_ms": round(1e3 * self.oldest_picture_s, 1),
        }
