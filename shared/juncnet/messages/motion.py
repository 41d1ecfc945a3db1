"""Velocities, the road that a follower saw, and an operator's orders."""

import json
from enum import StrEnum
from functools import cached_property
from typing import Annotated, Any, ClassVar, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, StringConstraints, field_validator, model_validator

from juncnet.messages.base import Message, Metres, Name, Probability
from juncnet.messages.stamp import Stamp


class Velocity(Message):
    """A velocity of the robot's body."""

    forward_mps: float = Field(default=0.0, ge=-50, le=50)
    lateral_mps: float = Field(default=0.0, ge=-50, le=50)
    """Left positive."""
    vertical_mps: float = Field(default=0.0, ge=-50, le=50)
    """Up positive."""
    yaw_rate_radps: float = Field(default=0.0, ge=-20, le=20)
    """Counter-clockwise positive."""


class RoadOpening(Message):
    """Where the road's surface goes on beyond one of its edges: the mouth of another road."""

    side: Literal["left", "right"]
    near_m: float | None = Field(default=None, ge=0, le=200)
    """Ahead of the robot, where the edge ends; None: nearer than it can be seen."""
    far_m: float | None = Field(default=None, ge=0, le=200)
    """Where it begins anew; None: not in sight."""


class RoadSeen(Message):
    """The road ahead as a follower saw it, on the ground in the robot's frame."""

    offset_m: float = Field(ge=-100, le=100)
    """Of the road's centre line beside the robot: left positive (0.5: the robot is 0.5 m right)."""
    heading_rad: float = Field(ge=-3.2, le=3.2)
    """Of the road's centre line near the robot against the robot's own: left positive."""
    width_m: float = Field(gt=0, le=200)
    curvature_1pm: float = Field(default=0.0, ge=-2, le=2)
    """Left positive."""
    centre: tuple[tuple[Metres, Metres], ...] = Field(default=(), max_length=64)
    """Points (x forward, y left) of the centre line, near to far."""
    openings: tuple[RoadOpening, ...] = Field(default=(), max_length=8)
    """The nearest of either side, where the follower looks for them."""
    ends_m: float | None = Field(default=None, ge=0, le=200)
    """Straight ahead of the robot, where the road's surface ends; None: no end in sight."""


class RoadSurface(Message):
    """Where the surface of roads is around the robot: a map of square cells in its frame.

    Every row is a text of one character a cell, from left to right: `#` road, `.` not, ` ` not
    seen. Rows from rear to front.
    """

    UNSEEN: ClassVar[int] = 0
    OFF_ROAD: ClassVar[int] = 1
    ROAD: ClassVar[int] = 2
    """What it says of a point."""

    x_m: float = Field(ge=-100, le=100)
    """Of the middles of the first row's cells, forward."""
    y_m: float = Field(ge=-100, le=100)
    """Of the middle of each row's first cell, left positive."""
    cell_m: float = Field(gt=0.01, le=10)
    rows: tuple[Annotated[str, StringConstraints(pattern=r"^[#. ]{1,200}$")], ...] = Field(
        min_length=1, max_length=200
    )

    @model_validator(mode="after")
    def _rectangular(self) -> Self:
        if len({len(row) for row in self.rows}) != 1:
            raise ValueError("rows are of different lengths")
        return self

    @cached_property
    def _classes(self) -> NDArray[np.int8]:
        cells = np.frombuffer("".join(self.rows).encode(), np.uint8)
        classes = np.full(cells.size, self.UNSEEN, np.int8)
        classes[cells == ord("#")] = self.ROAD
        classes[cells == ord(".")] = self.OFF_ROAD
        return classes.reshape(len(self.rows), -1)

    def classes(self, x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> NDArray[np.int8]:
        """Return ROAD, OFF_ROAD or UNSEEN for points (x forward, y left, metres)."""
        rows, columns = self._classes.shape
        i = np.rint((x_m - self.x_m) / self.cell_m).astype(np.intp)
        j = np.rint((self.y_m - y_m) / self.cell_m).astype(np.intp)
        inside = (i >= 0) & (i < rows) & (j >= 0) & (j < columns)
        found = self._classes[np.clip(i, 0, rows - 1), np.clip(j, 0, columns - 1)]
        return np.where(inside, found, np.int8(self.UNSEEN))

    def off_road(self, x_m: NDArray[np.float64], y_m: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return which of some points (x forward, y left, metres) are seen to be no road."""
        return self.classes(x_m, y_m) == self.OFF_ROAD


class RoadCommand(Message):
    """A follower's proposal for the frame of `header`; `velocity` None: it sees no road."""

    header: Stamp
    source: Name
    velocity: Velocity | None
    confidence: Probability
    road: RoadSeen | None = None
    surface: RoadSurface | None = None
    """Of followers that tell it: where a junction's arms lead, and where arcs may."""


class LoadFollower(Message):
    """Asks road following to swap its follower, until its process ends."""

    follower: str = Field(min_length=1, max_length=256)
    """Its class as `package.module:Class`, on the Python path of that process."""
    options: dict[str, Any] = Field(default_factory=dict)
    """The follower's own; none for the configured follower: those of its configuration."""

    @field_validator("options")
    @classmethod
    def _finite(cls, options: dict[str, Any]) -> dict[str, Any]:
        json.dumps(options, allow_nan=False)  # pydantic lets NaN and infinity pass within Any
        return options


class ActiveFollower(Message):
    """Which follower proposes now."""

    follower: str = Field(max_length=256)
    """Its class as `package.module:Class`."""


class VelocityCommand(Message):
    """What the robot shall do now, because of the frame of `header`."""

    header: Stamp
    issued: Stamp
    velocity: Velocity


class OverrideKind(StrEnum):
    """What an operator may order. `emergency` cuts the motors; it is never a stop.

    `take_off` arms as well, and ends in the air, stopped; a vehicle on wheels is armed only.
    """

    HOLD = "hold"
    LAND = "land"
    MANUAL = "manual"
    RESUME = "resume"
    EMERGENCY = "emergency"
    TAKE_OFF = "take_off"


class Override(Message):
    """An operator's order: wins over everything that the pipeline wants."""

    issued: Stamp
    kind: OverrideKind
    velocity: Velocity | None = None
    """With `manual` only; a manual velocity lives as long as any other command."""
    operator: Name = "operator"
    first_issued: Stamp | None = None
    """With an order that is repeated until it is answered: when it was first given."""

    @model_validator(mode="after")
    def _velocity_with_manual(self) -> Self:
        if (self.kind is OverrideKind.MANUAL) != (self.velocity is not None):
            raise ValueError("velocity goes with kind manual, and with no other")
        return self


class Ack(Message):
    """The vehicle side's confirmation of an override, as a vehicle stamps it."""

    override: Stamp
    """The `issued` stamp of the override."""
    kind: OverrideKind
    accepted: bool
    reason: str = ""
    at: Stamp
