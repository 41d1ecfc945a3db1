"""What an autopilot has said of itself: the newest of each message, in MAVLink's axes. Pure."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from juncnet.clocks import NS_PER_S
from juncnet.messages import GeoPoint, Pose, Velocity
from juncnet_services.command_output.vehicles import Telemetry
from juncnet_services.command_output.vehicles.mavlink_wire import (
    COPTERS,
    ROVERS,
    Autopilot,
    Received,
    mode_of,
    parameter_value,
)

ARMED = 128
IN_AIR = (2, 3, 4)
"""`EXTENDED_SYS_STATE.landed_state`: in the air, taking off, landing."""
ON_GROUND = 1
LOW_M = 0.2
"""What has risen by less, and rises by less a second, has not left the ground."""
STILL_MPS = 0.1


@dataclass
class Seen:
    """An autopilot; `system` None until its first heartbeat."""

    system: int | None = None
    component: int = 1
    autopilot: Autopilot | None = None
    kind: str = ""
    armed: bool = False
    mode: tuple[int, int] = (0, 0)
    landed_state: int = 0
    heard_ns: int = 0
    attitude_ns: int = 0
    position_ns: int = 0
    attitude: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    """Roll, pitch, yaw in rad; yaw rate in rad/s, clockwise."""
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """North, east, down in m."""
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    battery: float | None = None
    gps: GeoPoint | None = None
    parameters: dict[str, float] = field(default_factory=dict[str, float])
    results: dict[int, int] = field(default_factory=dict[int, int])
    """The newest MAV_RESULT by command."""

    @property
    def target(self) -> tuple[int, int]:
        """System and component to address."""
        return (self.system or 0, self.component)

    @property
    def yaw_rad(self) -> float:
        """Clockwise from north."""
        return self.attitude[2]

    @property
    def down_m(self) -> float:
        """Position downwards, in the autopilot's local frame."""
        return self.position[2]

    @property
    def in_air(self) -> bool:
        """Whether it flies; armed counts while it does not say."""
        return self.armed if self.landed_state == 0 else self.landed_state in IN_AIR

    @property
    def still(self) -> bool:
        """Whether it stays in its place, as seen from above."""
        return math.hypot(*self.velocity[:2]) < STILL_MPS

    def grounded(self, ground_m: float) -> bool:
        """Return whether it stands on the ground: a copter where it says so, not above `ground_m`.

        `landed_state` comes seldom, so a copter that has just left still says that it stands.
        """
        if self.kind == "rover":
            return self.still
        low = abs(ground_m - self.down_m) < LOW_M and self.velocity[2] > -LOW_M
        return self.landed_state == ON_GROUND and low

    def fresh(self, now_ns: int, seconds: float) -> bool:
        """Return whether attitude and position are both newer than `seconds`."""
        return now_ns - min(self.attitude_ns, self.position_ns) <= seconds * NS_PER_S

    def take(self, message: Received, wanted_system: int, now_ns: int) -> bool:
        """Keep what `message` says; return whether it is this autopilot's."""
        kind = message.get_type()
        if self.system is None:
            if kind != "HEARTBEAT" or wanted_system not in (0, message.get_srcSystem()):
                return False
            if not self._introduced(message):
                return False
        if (message.get_srcSystem(), message.get_srcComponent()) != (self.system, self.component):
            return False
        fields = message.to_dict()
        if _finite(fields):
            self._keep(kind, fields, now_ns)
        self.heard_ns = now_ns
        return True

    def telemetry(self) -> Telemetry:
        """Return it in our axes: x north, y west, z up; yaw counter-clockwise."""
        roll, pitch, yaw, rate = self.attitude
        north, east, down = self.velocity
        cosine, sine = math.cos(yaw), math.sin(yaw)
        return Telemetry(
            yaw_rad=math.remainder(-yaw, math.tau),
            velocity=Velocity(
                forward_mps=_within(north * cosine + east * sine, 50),
                lateral_mps=_within(north * sine - east * cosine, 50),
                vertical_mps=_within(-down, 50),
                yaw_rate_radps=_within(-rate, 20),
            ),
            pose=Pose(
                x_m=_within(self.position[0], 1e7),
                y_m=_within(-self.position[1], 1e7),
                z_m=_within(-self.position[2], 1e7),
                roll_rad=_within(roll, 7),
                pitch_rad=_within(-pitch, 7),
                yaw_rad=math.remainder(-yaw, math.tau),
            ),
            gps=self.gps,
            battery=self.battery,
            flying=self.in_air if self.kind == "copter" else self.armed,
        )

    def _introduced(self, message: Received) -> bool:
        fields = message.to_dict()
        if fields["autopilot"] not in (pilot.value for pilot in Autopilot):
            return False
        self.system, self.component = message.get_srcSystem(), message.get_srcComponent()
        self.autopilot = Autopilot(fields["autopilot"])
        self.kind = "copter" if fields["type"] in COPTERS else "unknown"
        self.kind = "rover" if fields["type"] in ROVERS else self.kind
        return True

    def _keep(self, kind: str, fields: Mapping[str, Any], now_ns: int) -> None:
        assert self.autopilot is not None
        match kind:
            case "HEARTBEAT":
                self.armed = bool(fields["base_mode"] & ARMED)
                self.mode = mode_of(self.autopilot, fields["custom_mode"])
            case "ATTITUDE":
                self.attitude = (
                    fields["roll"],
                    fields["pitch"],
                    fields["yaw"],
                    fields["yawspeed"],
                )
                self.attitude_ns = now_ns
            case "LOCAL_POSITION_NED":
                self.position = (fields["x"], fields["y"], fields["z"])
                self.velocity = (fields["vx"], fields["vy"], fields["vz"])
                self.position_ns = now_ns
            case "GLOBAL_POSITION_INT":
                self.gps = _fix(fields)
            case "SYS_STATUS":
                left = fields["battery_remaining"]
                self.battery = left / 100 if 0 <= left <= 100 else None
            case "EXTENDED_SYS_STATE":
                self.landed_state = fields["landed_state"]
            case "PARAM_VALUE":
                value = parameter_value(self.autopilot, fields["param_type"], fields["param_value"])
                self.parameters[str(fields["param_id"]).rstrip("\0")] = value
            case "COMMAND_ACK":
                self.results[fields["command"]] = fields["result"]
            case _:
                pass


def _fix(fields: Mapping[str, Any]) -> GeoPoint | None:
    """Return the position of GLOBAL_POSITION_INT; None where there is none, which it says as 0."""
    latitude, longitude = fields["lat"] / 1e7, fields["lon"] / 1e7
    if (latitude, longitude) == (0, 0) or abs(latitude) > 90 or abs(longitude) > 180:
        return None
    altitude = max(-500.0, min(1e5, fields["alt"] / 1000))
    return GeoPoint(latitude_deg=latitude, longitude_deg=longitude, altitude_m=altitude)


def _finite(fields: Mapping[str, Any]) -> bool:
    """Return whether no number is NaN, infinite or beyond all measure (but a parameter's bytes)."""
    return all(
        not isinstance(value, float) or (math.isfinite(value) and abs(value) < 1e9)
        for name, value in fields.items()
        if name != "param_value"
    )


def _within(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))
