"""What the navigator knows of the flight so far: one record, which is also what is saved."""

from pydantic import BaseModel, ConfigDict, Field

from juncnet.messages import JunctionEvent, Mission, Name, Phase, Turn


class Junction(BaseModel):
    """A junction ahead or under the robot. Distances are odometer readings in metres."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    rise_m: float
    """Where the score rose."""
    rise_seen: bool = True
    """False when the score was already high: the junction may be nearer than `d_far` says."""
    fall_m: float | None = None
    """Where the score fell; None while it is high."""
    label: Name = "junction"
    probability: float = Field(default=0.0, ge=0, le=1)
    """Highest smoothed probability so far."""


class TurnProgress(BaseModel):
    """A turn under way. Angles are unwrapped yaws in radians."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    turn: Turn
    nominal_rad: float
    """Yaw that the mission asks for."""
    radius_m: float = Field(default=0.0, ge=0)
    """Of the arc; 0: in place."""
    elapsed_s: float = Field(default=0.0, ge=0)
    """Time under way, holds not counted."""
    aligning_s: float = Field(default=0.0, ge=0)
    """Time since the nominal angle was reached, holds not counted."""
    aligning_from_m: float | None = None
    """Odometer reading when it was reached."""


class Progress(BaseModel):
    """The state of the navigator. It is saved whole, and a restarted navigator goes on with it."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    flight: Name
    configured: Mission
    """The mission of the configuration: another one there means another mission here."""
    mission: Mission
    phase: Phase = Phase.WAITING
    count: int = Field(default=0, ge=0)
    index: int = Field(default=0, ge=0)
    """Of the next event."""
    events: tuple[JunctionEvent, ...] = ()
    """The latest events: published again after a restart, for they may not have left."""
    odometer_m: float = 0.0
    speed_mps: float = 0.0
    yaw_rad: float = 0.0
    """Unwrapped."""
    position_m: tuple[float, float] | None = None
    """Of the vehicle's pose, where it has one."""
    smoothed: float = Field(default=0.0, ge=0, le=1)
    high: bool = False
    candidate: Junction | None = None
    """A risen score that has not been counted."""
    junction: Junction | None = None
    """The junction that was counted last, until it is left."""
    axis_rad: float | None = None
    """Direction of the road that the robot is on."""
    turn: TurnProgress | None = None
    leave_m: float | None = None
    """Odometer reading at which a junction where the robot turned is left."""
    left_m: float | None = None
    """Odometer reading where the last junction was left."""
