"""Ground truth of the simulated world."""

from typing import Literal

from pydantic import Field

from juncnet.messages.base import Message
from juncnet.messages.motion import Velocity
from juncnet.messages.stamp import Stamp
from juncnet.messages.vehicle import Pose


class SimulatorTruth(Message):
    """Ground truth of the simulated world, for tests and reports only."""

    at: Stamp
    header: Stamp | None
    """Of the newest picture rendered."""
    pose: Pose
    velocity: Velocity
    road_offset_m: float = Field(ge=-1e6, le=1e6)
    """Of the robot's centre from the nearest road centre line, left positive."""
    off_road_m: float = Field(ge=0, le=1e6)
    """How far the robot's centre is off the road surface; 0: on it."""
    collided: bool
    junction_id: int | None
    """The junction whose surface the robot's centre is on."""
    junctions_passed: int = Field(ge=0)
    """Junctions entered and left (or turned in) since the start, each pass once."""
    path: tuple[int, ...] = Field(default=(), max_length=100_000)
    """Ids of the arms (directed road ids) driven so far, in order."""
    label: Literal["junction", "none", "transition"]
    mouth_m: float | None
    """Distance to the next junction's mouth along the road; None: none ahead."""
    real_time_factor: float = Field(ge=0)
    simulated_s: float = Field(ge=0)
