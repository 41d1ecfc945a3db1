"""Parrot's ARSDK3, protocol version 1, as bytes: frames, commands, events, discovery. Pure.

A UDP datagram holds one or more frames, each `<BBBI`: type, buffer, sequence (per buffer), size
with this header. A command is `<BBH` project, class, number, then its arguments, little-endian.
Source: Parrot's `ardrone3.xml` and `common.xml`, and its open libarsdk.
"""

import json
import math
import struct
from dataclasses import dataclass
from enum import IntEnum

DISCOVERY_PORT = 44444
CONTROL_PORT = 54321
"""Where the drone listens unless its discovery answer says otherwise."""
VIDEO_PORT = 55004
HEADER = struct.Struct("<BBBI")
ACK_OFFSET = 128
"""The answer to a frame of buffer b goes to buffer b + 128."""


class FrameType(IntEnum):
    """What a frame is."""

    ACK = 1
    DATA = 2
    LOW_LATENCY = 3
    DATA_WITH_ACK = 4


_KINDS = frozenset(int(kind) for kind in FrameType)


class Buffer(IntEnum):
    """Which queue a frame belongs to: controller to drone (10..12), drone to controller (126..)."""

    PING = 0
    PONG = 1
    NO_ACK = 10
    WITH_ACK = 11
    HIGH_PRIORITY = 12
    EVENTS_WITH_ACK = 126
    EVENTS = 127


class FlyingState(IntEnum):
    """What the drone says that it is doing."""

    LANDED = 0
    TAKING_OFF = 1
    HOVERING = 2
    FLYING = 3
    LANDING = 4
    EMERGENCY = 5
    USER_TAKE_OFF = 6
    MOTOR_RAMPING = 7
    EMERGENCY_LANDING = 8


AIRBORNE = (FlyingState.HOVERING, FlyingState.FLYING)


class ArsdkError(ValueError):
    """Bytes from the drone are not what they should be, or it refuses; the text says what to do."""


@dataclass(frozen=True)
class Frame:
    """One frame: `sequence` is 0..255, per `buffer`."""

    kind: FrameType
    buffer: int
    sequence: int
    payload: bytes


@dataclass(frozen=True)
class Speed:
    """Measured velocity, m/s: north, east, down (5 Hz)."""

    north_mps: float
    east_mps: float
    down_mps: float


@dataclass(frozen=True)
class Attitude:
    """Measured attitude: yaw clockwise from north."""

    roll_rad: float
    pitch_rad: float
    yaw_rad: float


@dataclass(frozen=True)
class Altitude:
    """Above the point of take-off."""

    altitude_m: float


@dataclass(frozen=True)
class Position:
    """A GPS fix."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


@dataclass(frozen=True)
class Battery:
    """0..1."""

    level: float


@dataclass(frozen=True)
class Ranges:
    """A setting in force: what 100 % of a PCMD means."""

    setting: tuple[int, int, int]
    current: float


Event = FlyingState | Speed | Attitude | Altitude | Position | Battery | Ranges
MAX_TILT = (1, 6, 1)
"""Degrees."""
MAX_VERTICAL = (1, 12, 0)
"""m/s."""
MAX_ROTATION = (1, 12, 1)
"""Degrees a second."""
NO_FIX_DEG = 500.0
"""Latitude and longitude of a drone without a GPS fix."""


def encode(frame: Frame) -> bytes:
    """Return the bytes of `frame`."""
    size = HEADER.size + len(frame.payload)
    return HEADER.pack(frame.kind, frame.buffer, frame.sequence, size) + frame.payload


def decode(datagram: bytes) -> tuple[list[Frame], bytes]:
    """Return the frames of a datagram and the rest of it, empty unless it is malformed.

    Never raises: what comes before the first malformed frame is whole and is returned.
    """
    frames: list[Frame] = []
    at = 0
    while len(datagram) - at >= HEADER.size:
        kind, buffer, sequence, size = HEADER.unpack_from(datagram, at)
        if kind not in _KINDS or not HEADER.size <= size <= len(datagram) - at:
            break
        payload = datagram[at + HEADER.size : at + size]
        frames.append(Frame(FrameType(kind), buffer, sequence, payload))
        at += size
    return frames, datagram[at:]


def command(project: int, group: int, number: int, layout: str = "", *values: float) -> bytes:
    """Return the payload of a command; `layout` as `struct` takes it."""
    return struct.pack("<BBH" + layout, project, group, number, *values)


TAKE_OFF = command(1, 0, 1)
LANDING = command(1, 0, 3)
EMERGENCY = command(1, 0, 4)
"""Cuts the motors: what flies falls. Never a stop."""
ALL_SETTINGS = command(0, 2, 0)
ALL_STATES = command(0, 4, 0)
VIDEO_ON = command(1, 21, 0, "B", 1)
LOW_LATENCY = command(1, 21, 1, "I", 0)


def pcmd(roll: int = 0, pitch: int = 0, yaw: int = 0, gaz: int = 0, *, tilt: bool = False) -> bytes:
    """Return a piloting command, percent of each maximum: + is right, forward, clockwise, up.

    `tilt` False: roll and pitch do not count, the drone holds its place. The timestamp is 0, as it
    is in Parrot's ROS driver and in pyparrot: so all PCMDs can be made before they are needed.
    """
    return command(1, 0, 2, "BbbbbI", tilt, roll, pitch, yaw, gaz, 0)


def camera_orientation(tilt_deg: int) -> bytes:
    """Return the command that points the picture up (+) or down (-) against the horizon."""
    return command(1, 1, 0, "bb", tilt_deg, 0)


def video_resolutions(stream_720: bool) -> bytes:
    """Return the command for 1280x720, or for 856x480 with 1080p recorded on board."""
    return command(1, 19, 9, "I", int(stream_720))


def maximum(setting: tuple[int, int, int], value: float) -> bytes:
    """Return the command that asks for a setting, named by the event that will report it."""
    project, group, number = setting
    return command(project, group - {6: 4, 12: 1}[group], number, "f", value)


_EVENTS = {
    (0, 5, 1): "B",
    (1, 4, 1): "I",
    (1, 4, 4): "ddd",
    (1, 4, 5): "fff",
    (1, 4, 6): "fff",
    (1, 4, 8): "d",
    MAX_TILT: "fff",
    MAX_VERTICAL: "fff",
    MAX_ROTATION: "fff",
}


def event(payload: bytes) -> Event | None:
    """Return the event in the payload of a frame; None for one that is of no interest here.

    Raises:
        ArsdkError: it is cut short, not finite or out of range.
    """
    if len(payload) < 4:
        raise ArsdkError(f"event of {len(payload)} bytes: shorter than its number")
    key = struct.unpack_from("<BBH", payload)
    layout = _EVENTS.get(key)
    if layout is None:
        return None
    try:
        values: tuple[float, ...] = struct.unpack_from("<" + layout, payload, 4)
        return _made(key, values)
    except (struct.error, ValueError) as error:
        raise ArsdkError(f"event {key}: {error}") from error


def _made(key: tuple[int, int, int], values: tuple[float, ...]) -> Event | None:
    if not all(math.isfinite(v) and abs(v) < 1e6 for v in values):
        raise ValueError(f"{values} is not finite")
    match key:
        case (0, 5, 1):
            return Battery(min(1.0, values[0] / 100))
        case (1, 4, 1):
            return FlyingState(int(values[0]))
        case (1, 4, 4):
            fix = abs(values[0]) <= 90 and abs(values[1]) <= 180
            return Position(*values) if fix else None
        case (1, 4, 5):
            return Speed(*values)
        case (1, 4, 6):
            return Attitude(*values)
        case (1, 4, 8):
            return Altitude(*values)
        case _:
            if values[0] <= 0:
                raise ValueError(f"a maximum of {values[0]:g}")
            return Ranges(key, values[0])


def discovery_request(events_port: int, video_port: int) -> bytes:
    """Return what is sent to TCP port 44444: who asks, and where it listens."""
    return json.dumps(
        {
            "d2c_port": events_port,
            "controller_type": "computer",
            "controller_name": "juncnet",
            "arstream2_client_stream_port": video_port,
            "arstream2_client_control_port": video_port + 1,
        }
    ).encode()


def control_port(answer: bytes) -> int:
    """Return the UDP port for commands from the drone's discovery answer (JSON, trailing NULs).

    Raises:
        ArsdkError: the drone refuses, or the answer is malformed.
    """
    text = answer.rstrip(b"\0")
    if not text:
        raise ArsdkError("the drone closed the connection without an answer: restart it")
    try:
        fields: object = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ArsdkError(f"discovery answer is not JSON: {error}") from error
    if not isinstance(fields, dict):
        raise ArsdkError("discovery answer is not a JSON object")
    status: object = fields.get("status")  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]  # JSON
    port: object = fields.get("c2d_port", CONTROL_PORT)  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]  # JSON
    if status != 0:
        raise ArsdkError(
            f"the drone refuses the connection (status {status!r:.40}): another controller has it; "
            "close the phone's app or switch the SkyController off, then wait 10 s"
        )
    if isinstance(port, bool) or not isinstance(port, int) or not 0 < port < 65536:
        raise ArsdkError(f"discovery answer: c2d_port is {port!r:.40}")
    return port
