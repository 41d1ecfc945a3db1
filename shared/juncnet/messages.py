"""Every message that travels between processes: units per field, shape and dtype per array.

Conventions: SI units; x forward, y left, z up; yaw counter-clockwise positive (ROS REP 103).
Small messages are JSON. Messages with bulk data (`BulkMessage`) carry it as the raw payload with
their JSON beside it. `decode` raises `MessageError` that names the field for anything malformed:
wrong shape or dtype, NaN, out of range, unknown field.
"""

from enum import StrEnum
from typing import Annotated, Any, ClassVar, Literal, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    PrivateAttr,
    StringConstraints,
    ValidationError,
    field_validator,
    model_validator,
)

from juncnet.clocks import Instant

Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z0-9_.:+-]{1,128}$")]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Metres = Annotated[float, Field(ge=-1e7, le=1e7)]
Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]


class MessageError(ValueError):
    """A payload is not the message it should be; the text names the message, the field and why."""


class Message(BaseModel):
    """A message that travels as JSON. Frozen; unknown fields and NaN are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def schema_name(cls) -> str:
        """Name of the schema as it stands in the Zenoh encoding."""
        return f"juncnet.{cls.__name__}.v1"

    @classmethod
    def encoding(cls) -> str:
        """Zenoh encoding of the payload."""
        return f"application/json;{cls.schema_name()}"

    def encode(self) -> tuple[bytes, bytes | None]:
        """Return (payload, attachment) as `decode` takes them."""
        return self.model_dump_json().encode(), None

    @classmethod
    def decode(cls, payload: bytes, attachment: bytes | None = None) -> Self:
        """Return the message in `payload`.

        Raises:
            MessageError: it is not this message; the text names the field.
        """
        del attachment
        return _validated(cls, payload)


M = TypeVar("M", bound=Message)


def _validated(cls: type[M], text: bytes) -> M:
    try:
        return cls.model_validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "payload"
        raise MessageError(f"{cls.__name__}.{where}: {first['msg']}") from error


class BulkMessage(Message):
    """A message whose raw payload is bulk data and whose fields travel as JSON beside it."""

    media_type: ClassVar[str] = "application/octet-stream"
    _payload: bytes | memoryview = PrivateAttr(default=b"")

    @classmethod
    def encoding(cls) -> str:
        return f"{cls.media_type};{cls.schema_name()}"

    @property
    def payload(self) -> bytes | memoryview:
        """The bulk data, as it travels."""
        return self._payload

    @classmethod
    def of(cls, payload: bytes | memoryview, **fields: Any) -> Self:
        """Return the message with this bulk data and these fields, both checked."""
        message = cls(**fields)
        message._payload = payload
        message.check_payload()
        return message

    def check_payload(self) -> None:
        """Raise `MessageError` when the bulk data does not fit the fields."""
        if len(self._payload) == 0:
            raise MessageError(f"{type(self).__name__}.payload: empty")

    def encode(self) -> tuple[bytes, bytes | None]:
        return bytes(self._payload), self.model_dump_json().encode()

    @classmethod
    def decode(cls, payload: bytes, attachment: bytes | None = None) -> Self:
        if attachment is None:
            raise MessageError(f"{cls.__name__}.attachment: missing, the fields travel in it")
        message = _validated(cls, attachment)
        message._payload = payload
        message.check_payload()
        return message


class Stamp(Message):
    """Who made something, as which in a row, and when: source epoch, sequence, time and its clock.

    A frame's stamp says when it was captured and travels unchanged, as `header`, with all that
    follows from it. A command's stamp, `issued`, says when it was decided. The epoch is the wall
    clock in nanoseconds at the start of the source: a restarted source has a newer one.
    """

    epoch: int = Field(ge=0, lt=2**63)
    sequence: int = Field(ge=0, lt=2**63)
    time_ns: int = Field(ge=0, lt=2**63)
    """Monotonic nanoseconds on `clock`."""
    clock: Name
    uncertainty_ns: int = Field(default=0, ge=0, lt=2**62)

    @property
    def instant(self) -> Instant:
        """The time of this stamp as `juncnet.clocks` takes it."""
        return Instant(self.time_ns, self.clock, self.uncertainty_ns)


# --- pictures -----------------------------------------------------------------------------------


class PixelFormat(StrEnum):
    """Layout of a picture's bytes. I420: Y plane, then U, then V at half resolution; NV12: U and V
    interleaved; BGR8: three bytes a pixel; GRAY8: one."""

    I420 = "I420"
    NV12 = "NV12"
    BGR8 = "BGR8"
    GRAY8 = "GRAY8"


class JpegImage(BulkMessage):
    """A camera picture as JPEG (payload), for viewers and for followers in any language."""

    media_type: ClassVar[str] = "image/jpeg"
    header: Stamp
    width: int = Field(ge=1, le=16384)
    height: int = Field(ge=1, le=16384)

    def check_payload(self) -> None:
        if bytes(self.payload[:2]) != b"\xff\xd8":
            raise MessageError("JpegImage.payload: not a JPEG (it must begin with FF D8)")


class VideoPacket(BulkMessage):
    """One H.264 access unit in Annex B form (payload), as the camera gave it."""

    media_type: ClassVar[str] = "video/h264"
    header: Stamp
    key_frame: bool
    """Whether decoding can start here; parameter sets are in the payload then."""
    lost_before: int = Field(default=0, ge=0)
    """Packets known to be lost since the access unit before this one."""


# --- features and scores --------------------------------------------------------------------------


class Features(BulkMessage):
    """Network input: payload is a little-endian float32 array of `shape` (C, H, W), all finite."""

    header: Stamp
    preprocessing: Sha256
    """Hash of the preprocessing that made them (`juncnet.features.Preprocessing.hash`)."""
    shape: tuple[int, int, int]
    dtype: Literal["<f4"] = "<f4"

    @classmethod
    def from_array(cls, array: NDArray[np.float32], header: Stamp, preprocessing: str) -> Self:
        """Return the message of a float32 (C, H, W) array."""
        if array.dtype != np.float32 or array.ndim != 3:
            raise MessageError(
                f"Features.array: needs float32 (C, H, W), got {array.dtype} {array.shape}"
            )
        data = np.ascontiguousarray(array, dtype="<f4")
        return cls.of(
            data.view(np.uint8).reshape(-1).data,
            header=header,
            preprocessing=preprocessing,
            shape=tuple(array.shape),
        )

    @property
    def array(self) -> NDArray[np.float32]:
        """The features, float32 (C, H, W); a view of the payload."""
        return np.frombuffer(self.payload, dtype="<f4").reshape(self.shape)

    def check_payload(self) -> None:
        if any(not 1 <= n <= 4096 for n in self.shape):
            raise MessageError(f"Features.shape: {self.shape} has an axis outside 1..4096")
        expected = 4 * int(np.prod(self.shape, dtype=np.int64))
        if len(self.payload) != expected:
            raise MessageError(
                f"Features.payload: {len(self.payload)} bytes, {self.shape} needs {expected}"
            )
        if not np.isfinite(self.array).all():
            raise MessageError("Features.payload: contains NaN or infinity")


class ModelIdentity(Message):
    """Which model answered."""

    name: Name
    sha256: Sha256
    """Of the ONNX file."""


class JunctionScore(Message):
    """A probability per class for the frame of `header`."""

    header: Stamp
    model: ModelIdentity
    probabilities: dict[Name, Probability] = Field(min_length=2, max_length=1000)
    """By class; they sum to 1 within 1e-3. The class `none` is plain road."""

    @field_validator("probabilities")
    @classmethod
    def _sums_to_one(cls, value: dict[str, float]) -> dict[str, float]:
        if abs(sum(value.values()) - 1.0) > 1e-3:
            raise ValueError(f"probabilities sum to {sum(value.values()):.4f}, not 1")
        if "none" not in value:
            raise ValueError("there is no class 'none'")
        return value

    @property
    def junction(self) -> float:
        """Probability that the frame is a junction, of whichever class."""
        return 1.0 - self.probabilities["none"]

    @property
    def label(self) -> str:
        """The likeliest class other than `none`."""
        return max((p, c) for c, p in self.probabilities.items() if c != "none")[1]


class ActiveModel(Message):
    """What is served now: its identity, its classes and the preprocessing that it asks for."""

    model: ModelIdentity
    classes: tuple[Name, ...] = Field(min_length=2)
    preprocessing: str
    """The preprocessing as JSON (`juncnet.features.Preprocessing`)."""
    preprocessing_hash: Sha256


class LoadModel(Message):
    """Asks the inference to swap its model for the ONNX file at `path` on its host."""

    path: str = Field(min_length=1, max_length=4096)


class Reply(Message):
    """The answer to a request."""

    accepted: bool
    reason: str = Field(default="", max_length=4000)
    """Why not, and what to do about it."""


# --- motion ---------------------------------------------------------------------------------------


class Velocity(Message):
    """A velocity of the robot's body."""

    forward_mps: float = Field(default=0.0, ge=-50, le=50)
    lateral_mps: float = Field(default=0.0, ge=-50, le=50)
    """Left positive."""
    vertical_mps: float = Field(default=0.0, ge=-50, le=50)
    """Up positive."""
    yaw_rate_radps: float = Field(default=0.0, ge=-20, le=20)
    """Counter-clockwise positive."""


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


class RoadCommand(Message):
    """A follower's proposal for the frame of `header`; `velocity` None: it sees no road."""

    header: Stamp
    source: Name
    velocity: Velocity | None
    confidence: Probability
    road: RoadSeen | None = None


class VelocityCommand(Message):
    """What the robot shall do now, because of the frame of `header`."""

    header: Stamp
    issued: Stamp
    velocity: Velocity


class OverrideKind(StrEnum):
    """What an operator may order. `emergency` cuts the motors; it is never a stop."""

    HOLD = "hold"
    LAND = "land"
    MANUAL = "manual"
    RESUME = "resume"
    EMERGENCY = "emergency"


class Override(Message):
    """An operator's order: wins over everything that the pipeline wants."""

    issued: Stamp
    kind: OverrideKind
    velocity: Velocity | None = None
    """With `manual` only; a manual velocity lives as long as any other command."""
    operator: Name = "operator"

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


# --- junctions ------------------------------------------------------------------------------------


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
    reason: str = ""
    """Why the robot waits, if it does."""


class SetMission(Message):
    """Asks for a new mission; the count starts at 0."""

    mission: Mission


# --- vehicle and processes ----------------------------------------------------------------------


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


# --- simulation ---------------------------------------------------------------------------------


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
