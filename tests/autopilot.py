"""An autopilot for tests: PX4 or ArduPilot, copter or rover, as far as a companion sees it.

It keeps its last setpoint until its own failsafe acts, obeys modes as its firmware does, and moves
by simple dynamics. Time is an argument; `flying` runs one over UDP.
"""

import math
import socket
import struct
import threading
import time
from collections.abc import Generator
from contextlib import contextmanager
from typing import Any, cast

from pymavlink.dialects.v20 import common as dialect

STRICT = {"COM_OBL_RC_ACT": 5, "COM_OF_LOSS_T": 1.0, "COM_RC_IN_MODE": 4, "NAV_RCL_ACT": 0}
FLIES_ON = STRICT | {"COM_OBL_RC_ACT": 0}
COPTER = {"GUID_TIMEOUT": 1.0, "FS_GCS_ENABLE": 1}
ROVER = {"FS_ACTION": 2, "FS_GCS_ENABLE": 1, "FS_TIMEOUT": 1.0}
WHOLE = {"COM_OBL_RC_ACT", "COM_RC_IN_MODE", "NAV_RCL_ACT"}
YAW_GAIN = 1.5


class Autopilot:
    """`px4`: else ArduPilot. `setpoints` and `commands` keep (time in s, message)."""

    def __init__(self, kind: str, parameters: dict[str, float], *, px4: bool) -> None:
        self.px4, self.kind = px4, kind
        self.parameters = dict(parameters)
        if px4 and kind == "rover":
            self.parameters["RO_YAW_P"] = YAW_GAIN
        self.mav: Any = dialect.MAVLink(None, 1, 1)
        self.mav.robust_parsing = True
        self.armed = False
        self.mode = (3, 0) if px4 else (0, 0)
        self.yaw = 0.4
        self.position = [0.0, 0.0, 0.0]
        self.velocity = [0.0, 0.0, 0.0]
        self.body_speed = 0.0
        self.setpoint: Any = None
        self.setpoints: list[tuple[float, Any]] = []
        self.commands: list[tuple[float, Any]] = []
        self.heartbeats = 0
        self.takes_off_to: float | None = None
        self.refuses: set[int] = set()
        self.told_s = self.at_s = -1.0

    @property
    def offboard(self) -> bool:
        guided = 4 if self.kind == "copter" else 15
        return self.mode == ((6, 0) if self.px4 else (guided, 0))

    @property
    def height_m(self) -> float:
        return -self.position[2]

    def rate_hz(self, since_s: float, until_s: float) -> float:
        """Return the setpoints a second between two times."""
        times = [t for t, _ in self.setpoints if since_s <= t < until_s]
        return len(times) / (until_s - since_s)

    def numbers(self) -> list[int]:
        """Return the MAV_CMDs received, in order."""
        return [message.command for _, message in self.commands]

    def pack(self, message: Any) -> bytes:
        data = bytes(message.pack(self.mav))
        self.mav.seq = (self.mav.seq + 1) % 256
        return data

    # What comes in

    def heard(self, data: bytes, now_s: float) -> list[bytes]:
        answers: list[bytes] = []
        messages: Any = self.mav.parse_buffer(data)
        for message in cast("list[Any]", messages or []):
            match message.get_type():
                case "HEARTBEAT":
                    self.heartbeats += 1
                case "SET_POSITION_TARGET_LOCAL_NED":
                    self.setpoints.append((now_s, message))
                    self.setpoint = message
                    self.takes_off_to = None
                case "COMMAND_LONG":
                    self.commands.append((now_s, message))
                    result = self.command(message, now_s)
                    answers.append(
                        self.pack(dialect.MAVLink_command_ack_message(message.command, result))
                    )
                case "PARAM_REQUEST_READ":
                    answers += self.parameter(message.param_id)
                case _:
                    raise AssertionError(f"unexpected {message}")
        return answers

    def parameter(self, name: str) -> list[bytes]:
        if name not in self.parameters:
            return []
        value, kind = self.parameters[name], 9
        if name in WHOLE and self.px4:
            value, kind = struct.unpack("<f", struct.pack("<i", int(value)))[0], 6
        return [self.pack(dialect.MAVLink_param_value_message(name.encode(), value, kind, 1, 0))]

    def command(self, message: Any, now_s: float) -> int:
        """Return the MAV_RESULT: 0 accepted, 1 temporarily rejected, 2 denied."""
        if message.command in self.refuses:
            return 2
        if message.command == 176:
            mode = (int(message.param2), int(message.param3))
            recent = [t for t, _ in self.setpoints if now_s - 1.2 <= t]
            streamed = len(recent) >= 3 and recent[-1] - recent[0] >= 0.9
            if self.px4 and mode == (6, 0) and not streamed:
                return 1
            self.mode = mode
        elif message.command == 400:
            forced = message.param2 == 21196
            if message.param1 == 0 and self.height_m > 0.2 and not forced:
                return 2
            self.armed = bool(message.param1)
        elif message.command == 22:
            if not self.armed or not self.offboard:
                return 2
            self.takes_off_to = message.param7
        return 0

    # How it moves

    def step(self, seconds: float, now_s: float) -> None:
        """Move on by `seconds`, and act on the loss of setpoints as the parameters say."""
        self._failsafe(now_s)
        wanted, turn = self._wanted()
        if not self.armed:
            wanted, turn = (0.0, 0.0, 3.0 if self.height_m > 0 else 0.0), 0.0
        part = min(1.0, seconds / 0.3)
        for axis in range(3):
            self.velocity[axis] += part * (wanted[axis] - self.velocity[axis])
            self.position[axis] += self.velocity[axis] * seconds
        self.position[2] = min(0.0, self.position[2])
        self.yaw = math.remainder(self.yaw + turn * seconds, math.tau)

    def _failsafe(self, now_s: float) -> None:
        if not self.offboard or not self.setpoints or self.takes_off_to is not None:
            return
        silent_s = now_s - self.setpoints[-1][0]
        if self.px4 and silent_s > self.parameters["COM_OF_LOSS_T"]:
            action = self.parameters["COM_OBL_RC_ACT"]
            if action in (4, 5):
                self.mode = (4, 6) if action == 4 else (4, 3)
        limit_s = self.parameters.get("GUID_TIMEOUT", self.parameters.get("FS_TIMEOUT", 3.0))
        if not self.px4 and silent_s > limit_s:
            self.setpoint = None

    def _wanted(self) -> tuple[tuple[float, float, float], float]:
        """Return the velocity (NED) and the clockwise turn that the mode asks for."""
        if self.takes_off_to is not None:
            left = self.takes_off_to - self.height_m
            return (0.0, 0.0, -max(-1.0, min(1.0, left))), 0.0
        landing = self.mode == ((4, 6) if self.px4 else (9, 0))
        if landing and self.kind == "copter":
            self.armed = self.armed and self.height_m > 0.05
            return (0.0, 0.0, 1.0), 0.0
        if not self.offboard or self.setpoint is None:
            return (0.0, 0.0, 0.0), 0.0
        return self._guided()

    def _guided(self) -> tuple[tuple[float, float, float], float]:
        told = self.setpoint
        north, east, down = told.vx, told.vy, told.vz
        if told.coordinate_frame == 8:
            cosine, sine = math.cos(self.yaw), math.sin(self.yaw)
            north, east = north * cosine - east * sine, north * sine + east * cosine
        turn = 0.0 if told.type_mask & 2048 else told.yaw_rate
        if self.kind == "rover":
            speed = math.hypot(north, east)
            if self.px4:
                course = math.atan2(east, north)
                turn = YAW_GAIN * math.remainder(course - self.yaw, math.tau) if speed else 0.0
            return (speed * math.cos(self.yaw), speed * math.sin(self.yaw), 0.0), turn
        if not told.type_mask & 4:
            down = max(-1.0, min(1.0, 1.5 * (told.z - self.position[2])))
        elif self.px4:
            down += 0.1  # what nobody holds drifts
        return (north, east, down), turn

    # What goes out

    def told(self, now_s: float) -> list[bytes]:
        """Return telemetry, 25 times a second when called so often; a heartbeat once a second."""
        out: list[bytes] = []
        if now_s - self.told_s >= 1.0:
            self.told_s = now_s
            main, sub = self.mode
            custom = main << 16 | sub << 24 if self.px4 else main
            base = 81 | (128 if self.armed else 0)
            vehicle = 2 if self.kind == "copter" else 10
            pilot = 12 if self.px4 else 3
            out.append(
                self.pack(dialect.MAVLink_heartbeat_message(vehicle, pilot, base, custom, 4, 3))
            )
            state = 2 if self.height_m > 0.1 else 1
            out.append(self.pack(dialect.MAVLink_extended_sys_state_message(0, state)))
            status = dialect.MAVLink_sys_status_message(0, 0, 0, 0, 0, 0, 77, 0, 0, 0, 0, 0, 0)
            out.append(self.pack(status))
        ms = int(now_s * 1000) & 0xFFFFFFFF
        turned = math.remainder(self.yaw, math.tau)
        attitude = dialect.MAVLink_attitude_message(ms, 0, 0, turned, 0, 0, 0)
        place = dialect.MAVLink_local_position_ned_message(ms, *self.position, *self.velocity)
        return [*out, self.pack(attitude), self.pack(place)]


@contextmanager
def flying(autopilot: Autopilot, port: int) -> Generator[Autopilot]:
    """Run `autopilot` over UDP against a driver that listens on `port` of this host."""
    ended = threading.Event()
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind(("127.0.0.1", 0))
    link.settimeout(0.01)

    def run() -> None:
        at_s = out_s = time.monotonic()
        while not ended.is_set():
            try:
                answers = autopilot.heard(link.recv(65_535), time.monotonic())
            except (TimeoutError, ConnectionRefusedError):
                answers = []
            now_s = time.monotonic()
            autopilot.step(now_s - at_s, now_s)
            at_s = now_s
            if now_s - out_s >= 0.04:
                out_s = now_s
                answers += autopilot.told(now_s)
            for answer in answers:
                link.sendto(answer, ("127.0.0.1", port))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    try:
        yield autopilot
    finally:
        ended.set()
        thread.join(2)
        link.close()
