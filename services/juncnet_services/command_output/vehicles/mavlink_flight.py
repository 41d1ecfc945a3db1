"""PX4 in OFFBOARD and ArduPilot in GUIDED, copter and rover: what they are told. Pure.

Modes are asked for and motors armed only after `take_off`, an operator's order. A pilot who leaves
OFFBOARD or GUIDED afterwards keeps the vehicle until the next such order. While the autopilot's
failsafes would let a lost link fly on, no setpoint moves it: see `mavlink_failsafe`.
"""

import math
from enum import Enum, auto
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from juncnet.clocks import NS_PER_S
from juncnet.messages import Velocity
from juncnet_services.command_output.vehicles import Telemetry
from juncnet_services.command_output.vehicles import mavlink_wire as wire
from juncnet_services.command_output.vehicles.mavlink_failsafe import findings, needed, optional
from juncnet_services.command_output.vehicles.mavlink_seen import Seen
from juncnet_services.command_output.vehicles.mavlink_wire import Autopilot, Command, Wire
from juncnet_services.command_output.vehicles.pacing import Aim, Wish

LOST_S = 3.0
BLIND_S = 0.5
"""Without attitude and position newer than this the vehicle is told to stand still."""
ASK_S = 0.5
ASKS = 6
"""What is not answered after so many questions is refused."""
WARM_UP_S = 1.0
"""Setpoints before OFFBOARD is asked for: PX4 refuses it otherwise."""
SETTLE_S = 1.0
"""Zero velocity before a rover is disarmed: it kept circling otherwise."""
MAX_CLIMB_S = 30.0
ABORT_S = 3.0
"""For so long after a stop a vehicle that an earlier order arms on the ground is disarmed."""
REACHED_M = 0.4
FAILURE_SHOWN_S = 5.0
"""For so long a take-off that was refused is shown, and not tried again."""
HEIGHT_LEAD_M = 1.0
"""How far the height that is asked for may be ahead of the measured one."""
PX4_LANDING, PX4_HOLD, PX4_OFFBOARD = (4, 6), (4, 3), (6, 0)
ARDUPILOT_MODES = {
    "copter": {"guided": 4, "land": 9, "hold": 17},
    "rover": {"guided": 15, "land": 4, "hold": 4},
}
"""Copter: GUIDED, LAND, BRAKE. Rover: GUIDED, HOLD, HOLD."""


class Flight(BaseModel):
    """How the vehicle is flown."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    kind: Literal["copter", "rover"] = "copter"
    system: int = Field(default=0, ge=0, le=255)
    """MAVLink id of the autopilot; 0: the first that is heard."""
    own_system: int = Field(default=255, ge=1, le=255)
    """Our id; ArduPilot's failsafes watch that of its SYSID_MYGCS."""
    take_off_m: float = Field(default=3.0, ge=1, le=50)
    climb_mps: float = Field(default=0.7, gt=0, le=3)
    longest_fly_on_s: float = Field(default=1.5, gt=0, le=10)
    """Without setpoints the vehicle may go on for so long, by its own failsafe's parameters."""
    steering_s: float = Field(default=0.7, gt=0, le=5)
    """PX4 rover: how far ahead of its heading the course points, where RO_YAW_P is not known."""


class Phase(Enum):
    """How far a take-off is."""

    IDLE = auto()
    """Not taken off by us: setpoints are sent, and are for whoever switches to OFFBOARD."""
    WARMING_UP = auto()
    CHANGING_MODE = auto()
    ARMING = auto()
    CLIMBING = auto()
    ABORTING = auto()
    """Stopped: it stands still; what is armed on the ground, now or soon, is disarmed."""


class MavlinkCore:
    """Everything between bytes and wishes; see `juncnet_services...pacing.Core`."""

    def __init__(self, flight: Flight) -> None:
        self.lost = False
        self.flight = flight
        self.phase = Phase.IDLE
        self._wire = Wire(flight.own_system)
        self._guards_wire = Wire(flight.own_system, numbered=False)
        self.connected(0)

    def connected(self, now_ns: int) -> None:
        self.lost = False
        self.seen = Seen()
        self.phase = Phase.IDLE
        self._since_ns = self._connected_ns = now_ns
        self._asked: dict[str, tuple[int, int]] = {}
        self._failure = ""
        self._failed_ns = 0
        self._aim = Aim.FLY
        self._ground_m = 0.0
        self._height_down_m: float | None = None
        self._stepped_ns = self._beat_ns = self._landing_ns = 0
        self._ended = False

    @property
    def trouble(self) -> str:
        """Why it will not fly, and the remedy; empty when it will."""
        seen = self.seen
        if seen.system is None or seen.autopilot is None:
            return (
                "no heartbeat of a PX4 or ArduPilot yet: check the cable, the port, the baud rate"
            )
        if seen.kind != self.flight.kind:
            own = self.flight.kind
            return f"the autopilot flies a {seen.kind}, the layout a {own}: set options.kind"
        if self._reading:
            return "the autopilot's failsafe parameters are being read"
        found = findings(
            seen.autopilot, self.flight.kind, seen.parameters, self.flight.longest_fly_on_s
        )
        return "; ".join(found) or self._failure

    def heard(self, datagram: bytes, now_ns: int) -> list[bytes]:
        for message in self._wire.read(datagram):
            self.seen.take(message, self.flight.system, now_ns)
        return []

    def due(self, wish: Wish, now_ns: int) -> list[bytes]:
        seen, self._aim = self.seen, wish.aim
        if now_ns - self._failed_ns > FAILURE_SHOWN_S * NS_PER_S:
            self._failure = ""
        silent_ns = now_ns - max(seen.heard_ns, self._connected_ns)
        self.lost = seen.system is not None and silent_ns > LOST_S * NS_PER_S
        packets: list[bytes] = []
        if now_ns - self._beat_ns >= NS_PER_S:
            self._beat_ns = now_ns
            packets.append(self._wire.heartbeat())
        if seen.system is None or seen.autopilot is None:
            return packets
        packets += self._ask_for_messages(now_ns) + self._ask_for_parameters(now_ns)
        seconds = min(0.2, max(0.0, (now_ns - self._stepped_ns) / NS_PER_S))
        self._stepped_ns = now_ns
        if wish.aim is Aim.EMERGENCY:
            self.phase = Phase.IDLE
            return packets + self._cut(now_ns)
        if wish.aim is Aim.LAND:
            self.phase = Phase.IDLE
            packets += self._land(now_ns)
        else:
            self._landing_ns, self._ended = 0, False
        packets += self._take_off_further(now_ns)
        return packets + self._setpoint(wish, seconds, now_ns)

    def take_off(self, now_ns: int) -> None:
        """Begin: stream, ask for the mode, arm, climb; in the air, only the mode is asked for."""
        if self.phase in (Phase.IDLE, Phase.ABORTING) and not self.trouble:
            self._to(Phase.WARMING_UP, now_ns)

    def abort_take_off(self, now_ns: int) -> None:
        """Go no further: keep the present height, and disarm what has not left the ground."""
        match self.phase:
            case Phase.WARMING_UP | Phase.CHANGING_MODE:
                self._to(Phase.IDLE, now_ns)
            case Phase.ARMING | Phase.CLIMBING:
                if self.phase is Phase.ARMING:
                    self._ground_m = self.seen.down_m
                self._height_down_m = self.seen.down_m
                self._to(Phase.ABORTING, now_ns)
            case _:
                pass

    def telemetry(self, now_ns: int, max_age_s: float) -> Telemetry | None:
        return self.seen.telemetry() if self.seen.fresh(now_ns, max_age_s) else None

    def hold_packet(self) -> bytes:
        """Return a setpoint that stands still, for whoever sends it when this process cannot."""
        down_m = None if self._height_down_m is None else round(self._height_down_m, 1)
        return self._encoded(Velocity(), down_m, self._guards_wire)

    def ending(self) -> list[bytes]:
        """Return what leaves the vehicle in a hold of its own, unless it is landing."""
        if self._aim is not Aim.FLY or not self.controlled:
            return []
        return [self._mode("hold")]

    @property
    def controlled(self) -> bool:
        """Whether the autopilot is armed and obeys setpoints."""
        return self.seen.armed and self.seen.mode == self._own_mode

    @property
    def _own_mode(self) -> tuple[int, int]:
        if self.seen.autopilot is Autopilot.PX4:
            return PX4_OFFBOARD
        return ARDUPILOT_MODES[self.flight.kind]["guided"], 0

    @property
    def _reading(self) -> bool:
        """Whether needed parameters are still missing and may come."""
        if self.seen.autopilot is None:
            return True
        names = needed(self.seen.autopilot, self.flight.kind)
        return any(
            name not in self.seen.parameters and self._asked.get(name, (0, 0))[1] <= ASKS
            for name in names
        )

    def _to(self, phase: Phase, now_ns: int) -> None:
        self.phase, self._since_ns = phase, now_ns
        self._failure = ""
        self.seen.results.clear()
        for name in ("mode", "arm", "climb", "disarm"):
            self._asked.pop(name, None)

    def _ask(self, what: str, packet: bytes, now_ns: int, every_s: float = ASK_S) -> list[bytes]:
        """Return `packet` if it is time to ask (again) for `what`."""
        asked_ns, times = self._asked.get(what, (0, 0))
        if times and now_ns - asked_ns < every_s * NS_PER_S:
            return []
        self._asked[what] = (now_ns, times + 1)
        return [packet]

    def _ask_for_messages(self, now_ns: int) -> list[bytes]:
        """Have attitude and position come at 25 Hz, for as long as they do not."""
        if self.seen.fresh(now_ns, BLIND_S) and "messages" in self._asked:
            return []
        target, number = self.seen.target, Command.MESSAGE_INTERVAL
        rates = {
            wire.Stream.ATTITUDE: 40_000.0,
            wire.Stream.LOCAL_POSITION: 40_000.0,
            wire.Stream.STATE: 200_000.0,
            wire.Stream.GLOBAL_POSITION: 200_000.0,
        }
        if not self._ask("messages", b"", now_ns, 1.0):
            return []
        return [self._wire.command(target, number, s, us) for s, us in rates.items()]

    def _ask_for_parameters(self, now_ns: int) -> list[bytes]:
        pilot, packets = self.seen.autopilot, list[bytes]()
        if pilot is None:
            return []
        kind = self.flight.kind
        for name in needed(pilot, kind) + optional(pilot, kind):
            if name not in self.seen.parameters and self._asked.get(name, (0, 0))[1] <= ASKS:
                request = self._wire.read_parameter(self.seen.target, name)
                packets += self._ask(name, request, now_ns)
        return packets

    def _take_off_further(self, now_ns: int) -> list[bytes]:
        """Go through the phases of a take-off, each as soon as the one before is reached."""
        seen = self.seen
        waited_s = (now_ns - self._since_ns) / NS_PER_S
        match self.phase:
            case Phase.WARMING_UP if waited_s >= WARM_UP_S:
                self._to(Phase.CHANGING_MODE, now_ns)
            case Phase.CHANGING_MODE if seen.mode == self._own_mode:
                flies = seen.armed and seen.in_air and self.flight.kind == "copter"
                self._to(Phase.IDLE if flies else Phase.ARMING, now_ns)
            case Phase.CHANGING_MODE:
                return self._insist("mode", self._mode("guided"), Command.SET_MODE, now_ns)
            case Phase.ARMING if seen.armed:
                climbs = self.flight.kind == "copter"
                self._to(Phase.CLIMBING if climbs else Phase.IDLE, now_ns)
                self._ground_m = seen.down_m
            case Phase.ARMING:
                arm = self._wire.command(seen.target, Command.ARM, 1.0)
                return self._insist("arm", arm, Command.ARM, now_ns)
            case Phase.CLIMBING:
                return self._climb(waited_s, now_ns)
            case Phase.ABORTING if self.controlled and self._grounded(now_ns):
                return self._insist("disarm", self._disarm(), Command.ARM, now_ns)
            case Phase.ABORTING if waited_s > ABORT_S:
                self._to(Phase.IDLE, now_ns)
            case _:
                pass
        return []

    def _climb(self, waited_s: float, now_ns: int) -> list[bytes]:
        seen, top_m = self.seen, self._ground_m - self.flight.take_off_m
        if abs(seen.down_m - top_m) < REACHED_M or not seen.armed:
            self._height_down_m = top_m
            self._to(Phase.IDLE, now_ns)
        elif waited_s > MAX_CLIMB_S or seen.mode != self._own_mode:
            self._height_down_m = None
            self._to(Phase.IDLE, now_ns)
        elif seen.autopilot is Autopilot.ARDUPILOT:
            parameters = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, self.flight.take_off_m)
            up = self._wire.command(seen.target, Command.TAKE_OFF, *parameters)
            if seen.results.get(Command.TAKE_OFF) != 0:
                return self._insist("climb", up, Command.TAKE_OFF, now_ns)
        else:
            risen_m = self.flight.climb_mps * waited_s
            self._height_down_m = max(top_m, self._ground_m - risen_m)
        return []

    def _insist(self, what: str, packet: bytes, command: Command, now_ns: int) -> list[bytes]:
        """Ask again until it is so; give the take-off up when it will not be."""
        if self._asked.get(what, (0, 0))[1] <= ASKS:
            return self._ask(what, packet, now_ns)
        result = self.seen.results.get(command)
        self._to(Phase.IDLE, now_ns)
        answer = "no answer" if result is None else f"MAV_RESULT {result}"
        self._failed_ns = now_ns
        self._failure = (
            f"the autopilot refused at the take-off's step '{what}' ({answer}): its ground "
            "station names the check that failed"
        )
        return []

    def _land(self, now_ns: int) -> list[bytes]:
        """Land, and leave the landing to the autopilot once it has begun; a rover is disarmed."""
        seen = self.seen
        if not seen.armed or self._ended:
            return []
        self._landing_ns = self._landing_ns or now_ns
        if self.flight.kind == "rover":
            waited_s = (now_ns - self._landing_ns) / NS_PER_S
            if waited_s < SETTLE_S or not (seen.still or waited_s > 3 * SETTLE_S):
                return []
            return self._ask("disarm", self._disarm(), now_ns)
        if seen.mode == (PX4_LANDING if seen.autopilot is Autopilot.PX4 else (9, 0)):
            self._ended = True
            return []
        return self._ask("land", self._mode("land"), now_ns)

    def _grounded(self, now_ns: int) -> bool:
        return self.seen.fresh(now_ns, BLIND_S) and self.seen.grounded(self._ground_m)

    def _disarm(self) -> bytes:
        """Return the order to disarm, which an autopilot refuses in the air."""
        return self._wire.command(self.seen.target, Command.ARM, 0.0)

    def _cut(self, now_ns: int) -> list[bytes]:
        if not self.seen.armed:
            return []
        cut = self._wire.command(self.seen.target, Command.ARM, 0.0, wire.FORCE)
        return self._ask("cut", cut, now_ns, 0.2)

    def _mode(self, what: Literal["guided", "land", "hold"]) -> bytes:
        if self.seen.autopilot is Autopilot.PX4:
            main, sub = {"guided": PX4_OFFBOARD, "land": PX4_LANDING, "hold": PX4_HOLD}[what]
            return self._wire.command(self.seen.target, Command.SET_MODE, 1.0, main, sub)
        number = ARDUPILOT_MODES[self.flight.kind][what]
        return self._wire.command(self.seen.target, Command.SET_MODE, 1.0, number)

    def _setpoint(self, wish: Wish, seconds: float, now_ns: int) -> list[bytes]:
        """Return the setpoint; a standing one while there is trouble, and none that could start.

        Without trouble setpoints go out always: PX4 wants them before OFFBOARD. ArduPilot gives up
        a take-off at the first one.
        """
        ardupilot = self.seen.autopilot is Autopilot.ARDUPILOT
        if self.trouble and not self.controlled:
            return []
        if ardupilot and self.phase is Phase.CLIMBING:
            return []
        if not self.controlled and self.phase is Phase.IDLE:
            self._height_down_m = None
        still = wish.brake or wish.aim is not Aim.FLY or self.phase is not Phase.IDLE
        blind = not self.seen.fresh(now_ns, BLIND_S)
        velocity = Velocity() if still or blind or self.trouble else wish.velocity
        self._follow_height(velocity.vertical_mps * seconds)
        return [self._encoded(velocity, self._height_down_m, self._wire)]

    def _follow_height(self, risen_m: float) -> None:
        """Move the height that is held by `risen_m`, never far ahead of the measured one."""
        if self._height_down_m is None and self.seen.position_ns:
            self._height_down_m = self.seen.down_m
        if risen_m and self._height_down_m is not None:
            wanted, down_m = self._height_down_m - risen_m, self.seen.down_m
            self._height_down_m = max(down_m - HEIGHT_LEAD_M, min(down_m + HEIGHT_LEAD_M, wanted))

    def _encoded(self, velocity: Velocity, down_m: float | None, by: Wire) -> bytes:
        """Return the setpoint that this autopilot understands for a velocity in our axes."""
        forward, right = velocity.forward_mps, -velocity.lateral_mps
        turn, target = -velocity.yaw_rate_radps, self.seen.target
        yaw, rover = self.seen.yaw_rad, self.flight.kind == "rover"
        if self.seen.autopilot is Autopilot.ARDUPILOT:
            mask = wire.SPEED_TURN_RATE if rover else wire.VELOCITY_YAW_RATE
            speeds = (forward, right, -velocity.vertical_mps)
            return by.setpoint(target, wire.BODY_NED, mask, 0.0, speeds, turn)
        if rover:
            course = yaw + max(-1.0, min(1.0, turn * self._steering_s))
            speed = max(0.0, forward)
            speeds = (speed * math.cos(course), speed * math.sin(course), 0.0)
            return by.setpoint(target, wire.LOCAL_NED, wire.VELOCITY, 0.0, speeds, 0.0)
        cosine, sine = math.cos(yaw), math.sin(yaw)
        speeds = (forward * cosine - right * sine, forward * sine + right * cosine, 0.0)
        mask = wire.VELOCITY_YAW_RATE if down_m is None else wire.POSITION_Z_VELOCITY_YAW_RATE
        return by.setpoint(target, wire.LOCAL_NED, mask, down_m or 0.0, speeds, turn)

    @property
    def _steering_s(self) -> float:
        """Seconds by which the course leads: the rover turns at RO_YAW_P times the difference."""
        gain = self.seen.parameters.get("RO_YAW_P", 0.0)
        return 1.0 / gain if gain > 0.1 else self.flight.steering_s
