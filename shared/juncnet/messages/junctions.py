"""Missions, what happens at junctions, and where the mission stands."""

from enum import StrEnum
from typing import Literal, Self

from pydantic import Field, model_validator

from juncnet.messages.base import Message, Name, Probability
from juncnet.messages.stamp import Stamp


class Turn(Message):
    """What to do at the `at`-th junction: a direction, or an angle (left positive)."""

    at: int = Field(ge=1, le=100_000)
    turn: Literal["left", "right", "straight"] | None = None
    angle_deg: float | None = Field(default=None, ge=-180, le=180)

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if (self.turn is None) == (self.angle_deg is None):
            raise ValueError("give either turn or angle_deg")
        return self


class Mission(Message):
    """Which turns to take at which junctions; straight on where none is named."""

    name: Name = "unnamed"
    turns: tuple[Turn, ...] = ()
    finish_after: int | None = Field(default=None, ge=1)
    """Number of junctions after which the mission is finished; None: never."""

    @model_validator(mode="after")
    def _each_junction_once(self) -> Self:
        numbers = [turn.at for turn in self.turns]
        if len(set(numbers)) != len(numbers):
            raise ValueError("turns name a junction twice")
        if self.finish_after is not None and numbers and max(numbers) > self.finish_after:
            raise ValueError(f"turns name junction {max(numbers)}, after finish_after")
        return self

    def turn_at(self, count: int) -> Turn:
        """Return what to do at the `count`-th junction (from 1)."""
        return next((t for t in self.turns if t.at == count), Turn(at=count, turn="straight"))


class EventKind(StrEnum):
    """What happened at a junction, in the order in which it happens."""

    APPROACHED = "approached"
    ENTERED = "entered"
    TURN_STARTED = "turn_started"
    TURN_FINISHED = "turn_finished"
    LEFT = "left"
    MISSION_FINISHED = "mission_finished"


class JunctionEvent(Message):
    """What happened at a junction; subscribers tell repeats by the unique (`flight`, `index`)."""

    header: Stamp
    flight: Name
    index: int = Field(ge=0)
    kind: EventKind
    count: int = Field(ge=0)
    """Junctions so far, this one included once it is approached."""
    label: Name = "junction"
    """Class of the junction, as the model names it."""
    probability: Probability
    turn: Turn | None = None
    """The turn taken here, with the events of a turn."""


class Phase(StrEnum):
    """What the navigator is doing."""

    WAITING = "waiting"
    """For a picture, a road or a vehicle."""
    FOLLOWING = "following"
    APPROACHING = "approaching"
    """A junction is ahead; the follower still steers."""
    CROSSING = "crossing"
    """Straight through a junction on the held heading."""
    TURNING = "turning"
    ALIGNING = "aligning"
    """The turn is made, the next road is being found."""
    FINISHED = "finished"


class Thresholds(Message):
    """What the smoothed junction probability is compared with."""

    enter: Probability
    """Above it a junction may be ahead."""
    certain: Probability
    """The junction is counted only if this was reached."""
    leave: Probability
    """Below it there is none any more."""


class NavigationState(Message):
    """Where the mission stands."""

    header: Stamp | None
    """Of the newest frame used; None before the first."""
    flight: Name
    phase: Phase
    count: int = Field(ge=0)
    mission: Mission
    next_turn: Turn | None
    smoothed: Probability = 0.0
    """Smoothed junction probability: what the thresholds are compared with."""
    thresholds: Thresholds | None = None
    reason: str = ""
    """Why the robot waits, if it does."""


class SetMission(Message):
    """Asks for a new mission; the count starts at 0."""

    mission: Mission
