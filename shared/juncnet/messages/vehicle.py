"""What the vehicle is, measures and is told, and how the processes are doing."""

from enum import StrEnum
from typing import Literal

from pydantic import Field

from juncnet.messages.base import Message, Metres, Name, Probability
from juncnet.messages.motion import Velocity
from juncnet.messages.stamp import Stamp


class Capabilities(Message):
    """What a vehicle can do."""

    kind: Literal["copter", "rover", "unknown"] = "unknown"
    lateral: bool = False
    vertical: bool = False
    turns_in_place: bool = False
    minimum_radius_m: float = Field(default=0.0, ge=0, le=1000)
    telemetry: bool = False
    """Whether attitude and velocity in `VehicleState` are measured."""


class Pose(Message):
    """Position and attitude in the vehicle's local frame."""

    x_m: Metres
    y_m: Metres
    z_m: Metres = 0.0
    roll_rad: float = Field(default=0.0, ge=-7, le=7)
    pitch_rad: float = Field(default=0.0, ge=-7, le=7)
    yaw_rad: float = Field(default=0.0, ge=-7, le=7)


class GeoPoint(Message):
    """A GPS fix (WGS 84)."""

    latitude_deg: float = Field(ge=-90, le=90)
    longitude_deg: float = Field(ge=-180, le=180)
    altitude_m: float = Field(default=0.0, ge=-500, le=100_000)


class Output(StrEnum):
    """What the vehicle is being told."""

    PIPELINE = "pipeline"
    MANUAL = "manual"
    HOLD = "hold"
    STOPPED = "stopped"
    """Held by an operator, or by a loss that only an operator ends."""
    LANDING = "landing"
    EMERGENCY = "emergency"
    TAKING_OFF = "taking_off"
    """By an operator's order: the vehicle goes up by itself, no velocity is obeyed."""


class VehicleState(Message):
    """What the vehicle measures, where known, and what it is being told."""

    at: Stamp
    capabilities: Capabilities
    yaw_rad: float | None = Field(default=None, ge=-7, le=7)
    """In any fixed frame: differences are what counts."""
    velocity: Velocity | None = None
    """Measured."""
    pose: Pose | None = None
    gps: GeoPoint | None = None
    battery: Probability | None = None
    flying: bool = True
    output: Output
    output_reason: str = ""
    commanded: Velocity = Velocity()
    """What was last sent to the vehicle, after all limits."""


class RemoteClock(Message):
    """How far another host's clock runs ahead of the reporting process's; None: not known now."""

    offset_ns: int | None = Field(default=None, gt=-(2**63), lt=2**63)
    uncertainty_ns: int | None = Field(default=None, ge=0, lt=2**63)


class Health(Message):
    """How a process is doing, once a second."""

    service: Name
    at: Stamp
    flight: Name
    pid: int = Field(ge=0)
    rate_hz: float = Field(ge=0)
    """Main output messages a second since the last report."""
    age_s: float | None = Field(default=None, ge=0)
    """Largest picture age at output since the last report."""
    drops: int = Field(default=0, ge=0)
    """Inputs that were replaced by a newer one before they were used; since the start."""
    errors: int = Field(default=0, ge=0)
    """Malformed or refused inputs and failures survived; since the start."""
    latency_p50_ms: float | None = Field(default=None, ge=0)
    """From taking an input to publishing what follows from it."""
    latency_p99_ms: float | None = Field(default=None, ge=0)
    last_error: str = ""
    counters: dict[str, float] = Field(default_factory=dict)
    """What only this service counts: `lost`, `corrupt`, `frozen`, `reconnects` ..."""
    linked: bool | None = None
    """Whether the vehicle's router is reached from another host; None: no such link is needed."""
    clocks: dict[Name, RemoteClock] = Field(default_factory=dict)
    """Clocks of other hosts on which what this process receives depends."""
