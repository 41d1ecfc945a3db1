"""MAVLink 2 as bytes, by pymavlink; and which numbers the two autopilots give to things.

Names and units are those of MAVLink's `common.xml`: NED axes, yaw clockwise.
"""

import struct
from enum import Enum, IntEnum
from typing import Any, Protocol, cast

from juncnet.extras import install_command

try:
    from pymavlink.dialects.v20 import common as dialect
except ImportError as error:
    raise ImportError(f"it needs pymavlink: {install_command('mavlink')}") from error

GROUND_STATION = 190
"""Component that we are."""
FORCE = 21196.0
"""Disarms in the air: the motors stop."""
POSITION_Z_VELOCITY_YAW_RATE = 1475
"""Type mask 0x5C3: horizontal velocity, height, yaw rate. PX4 holds its height within 0.1 m; with
1479 and a vertical velocity of 0 it drifts by metres."""
VELOCITY_YAW_RATE = 1479
"""0x5C7: ArduPilot Copter, and PX4 until its height has been told."""
SPEED_TURN_RATE = 1511
"""0x5E7: ArduPilot Rover."""
VELOCITY = 3527
"""0xDC7: PX4 Rover, which takes the course from the vector and ignores the yaw rate."""
LOCAL_NED, BODY_NED = 1, 8
COPTERS = frozenset({2, 3, 4, 13, 14, 15, 20, 21, 29, 35})
ROVERS = frozenset({10})


class Autopilot(Enum):
    """Whose firmware it is, by `HEARTBEAT.autopilot`."""

    PX4 = 12
    ARDUPILOT = 3


class Command(IntEnum):
    """MAV_CMD."""

    LAND = 21
    TAKE_OFF = 22
    SET_MODE = 176
    ARM = 400
    MESSAGE_INTERVAL = 511


class Stream(IntEnum):
    """Messages that are asked for."""

    ATTITUDE = 30
    LOCAL_POSITION = 32
    GLOBAL_POSITION = 33
    STATE = 245


class Received(Protocol):
    """What is used of a message of pymavlink; its fields are attributes."""

    def get_type(self) -> str: ...
    def get_srcSystem(self) -> int: ...  # noqa: N802  # pymavlink's name
    def get_srcComponent(self) -> int: ...  # noqa: N802  # pymavlink's name
    def to_dict(self) -> dict[str, Any]: ...


class Wire:
    """Makes and reads messages as one system; numbers what it sends, if `numbered`."""

    def __init__(self, system: int, *, numbered: bool = True) -> None:
        self._step = 1 if numbered else 0
        self._mav: Any = dialect.MAVLink(None, system, GROUND_STATION)
        self._mav.robust_parsing = True

    def read(self, data: bytes) -> list[Received]:
        """Return the messages that `data` completes; what is malformed is passed over."""
        try:
            found: Any = self._mav.parse_buffer(data)
        except (dialect.MAVError, struct.error, ValueError, UnicodeDecodeError):
            return []
        messages = cast("list[Received]", found or [])
        return [message for message in messages if message.get_type() != "BAD_DATA"]

    def _pack(self, message: Any) -> bytes:
        packet = bytes(message.pack(self._mav))
        self._mav.seq = (self._mav.seq + self._step) % 256
        return packet

    def heartbeat(self) -> bytes:
        """Return our sign of life: a ground station's, so that its loss is one's too."""
        return self._pack(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))

    def command(self, target: tuple[int, int], number: Command, *parameters: float) -> bytes:
        """Return COMMAND_LONG with up to seven parameters, the rest 0."""
        seven = (*parameters, *[0.0] * (7 - len(parameters)))
        return self._pack(dialect.MAVLink_command_long_message(*target, number, 0, *seven))

    def read_parameter(self, target: tuple[int, int], name: str) -> bytes:
        """Return a request for one parameter."""
        encoded = name.encode()
        return self._pack(dialect.MAVLink_param_request_read_message(*target, encoded, -1))

    def setpoint(
        self,
        target: tuple[int, int],
        frame: int,
        mask: int,
        z_m: float,
        velocity: tuple[float, float, float],
        yaw_rate: float,
    ) -> bytes:
        """Return SET_POSITION_TARGET_LOCAL_NED: height (down), velocity, clockwise yaw rate."""
        message = dialect.MAVLink_set_position_target_local_ned_message(
            0, *target, frame, mask, 0.0, 0.0, z_m, *velocity, 0.0, 0.0, 0.0, 0.0, yaw_rate
        )
        return self._pack(message)


def parameter_value(autopilot: Autopilot, kind: int, value: float) -> float:
    """Return a parameter's value: PX4 puts an integer's bytes into the float, ArduPilot casts."""
    if autopilot is Autopilot.PX4 and kind in (5, 6):
        return float(struct.unpack("<i" if kind == 6 else "<I", struct.pack("<f", value))[0])
    return value


def mode_of(autopilot: Autopilot, custom_mode: int) -> tuple[int, int]:
    """Return (main, sub) of `HEARTBEAT.custom_mode`; ArduPilot has no sub."""
    if autopilot is Autopilot.PX4:
        return custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    return custom_mode, 0
