"""A Bebop 2 in flight: what it is told and what it tells, pure.

Speeds are held by a loop of ours: a PCMD sets the tilt, in percent of a maximum, not the speed.
The loop is a PI controller with feed-forward on SpeedChanged (north and east, 5 Hz), turned into
the drone's frame by its yaw. Axes of the drone: + pitch forward, + roll right, + yaw clockwise;
ours: x forward, y left, yaw counter-clockwise. They are converted here and nowhere else.
"""

import math
from collections import deque
from dataclasses import dataclass, field

from pydantic import BaseModel, ConfigDict, Field

from juncnet.clocks import NS_PER_S
from juncnet.messages import GeoPoint, Velocity
from juncnet_services.command_output.vehicles import Telemetry, arsdk
from juncnet_services.command_output.vehicles.arsdk import Buffer, FlyingState, FrameType
from juncnet_services.command_output.vehicles.pacing import Aim, Wish

STEP_NS = 12_500_000
"""PCMD frames are numbered by the clock: the guard and a successor go on where another ended. The
drone refuses a number that is up to 10 below the last one (libarsdk, `should_process_data`)."""
RETRY_NS = 150_000_000
MAX_RETRIES = 20
REPEAT_NS = NS_PER_S
"""Until the drone does what it was told (landing, motor cut), it is told again."""
LOST_S = 3.0
BLIND_S = 0.6
"""Without a speed and an attitude newer than this the drone hovers; they come at 5 Hz at best."""
STILL_MPS = 0.1
"""Below this speed the drone holds its place by its own means."""


class Tuning(BaseModel):
    """The speed loop and the drone's own maxima, which it is asked to keep."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    max_tilt_deg: float = Field(default=15.0, ge=5, le=35)
    max_vertical_mps: float = Field(default=1.5, ge=0.5, le=6)
    max_rotation_degps: float = Field(default=100.0, ge=10, le=200)
    feed_forward_deg: float = Field(default=1.5, ge=0, le=10)
    """Tilt for 1 m/s of steady speed."""
    proportional_deg: float = Field(default=4.0, ge=0, le=20)
    """Tilt for 1 m/s of missing speed."""
    integral_deg: float = Field(default=1.0, ge=0, le=10)
    """Tilt that a second of 1 m/s missing speed adds."""


@dataclass
class SpeedLoop:
    """Tilt in degrees that reaches and keeps a speed along one axis."""

    tuning: Tuning
    _sum_deg: float = 0.0

    def step(
        self, wanted_mps: float, measured_mps: float, seconds: float, limit_deg: float
    ) -> float:
        """Return the tilt, within +-`limit_deg`; the integral does not grow at the limit."""
        error = wanted_mps - measured_mps
        tuning = self.tuning
        ahead = tuning.feed_forward_deg * wanted_mps + tuning.proportional_deg * error
        grown = self._sum_deg + tuning.integral_deg * error * seconds
        if abs(ahead + grown) <= limit_deg or abs(grown) < abs(self._sum_deg):
            self._sum_deg = max(-limit_deg, min(limit_deg, grown))
        return max(-limit_deg, min(limit_deg, ahead + self._sum_deg))

    def rest(self) -> None:
        """Forget what was learned about wind and drag."""
        self._sum_deg = 0.0


@dataclass
class Reliable:
    """Commands that the drone acknowledges: one at a time, repeated until it has."""

    buffer: Buffer
    waiting: deque[bytes] = field(default_factory=deque[bytes])
    _sequence: int = -1
    _sent_ns: int | None = None
    _tries: int = 0

    def put(self, payload: bytes) -> None:
        """Send `payload` in its turn, unless it waits already."""
        if payload not in self.waiting:
            self.waiting.append(payload)

    def acknowledged(self, sequence: int) -> None:
        """Go on to the next command, if it is this one that has arrived."""
        if self._sent_ns is not None and sequence == self._sequence & 0xFF:
            self._next()

    def due(self, now_ns: int) -> list[bytes]:
        """Return the frame to send now, if there is one."""
        if self._sent_ns is not None and now_ns - self._sent_ns < RETRY_NS:
            return []
        if self._tries > MAX_RETRIES:
            self._next()
        if not self.waiting:
            return []
        if self._sent_ns is None:
            self._sequence += 1
        self._sent_ns, self._tries = now_ns, self._tries + 1
        payload = self.waiting[0]
        kind = FrameType.DATA_WITH_ACK
        return [arsdk.encode(arsdk.Frame(kind, self.buffer, self._sequence & 0xFF, payload))]

    def drop(self, payload: bytes) -> None:
        """Send `payload` no more, if it waits."""
        if self.waiting and self.waiting[0] == payload:
            self._next()
        elif payload in self.waiting:
            self.waiting.remove(payload)

    def _next(self) -> None:
        self.waiting.popleft()
        self._sent_ns, self._tries = None, 0


@dataclass
class Measured:
    """The newest events, each with its time."""

    state: FlyingState | None = None
    speed: arsdk.Speed | None = None
    speed_ns: int = 0
    attitude: arsdk.Attitude | None = None
    attitude_ns: int = 0
    yaw_rate_radps: float = 0.0
    battery: float | None = None
    gps: GeoPoint | None = None
    maxima: dict[tuple[int, int, int], float] = field(
        default_factory=dict[tuple[int, int, int], float]
    )

    def take(self, event: arsdk.Event, now_ns: int) -> None:
        """Keep `event` as the newest of its kind."""
        match event:
            case FlyingState():
                self.state = event
            case arsdk.Speed():
                self.speed, self.speed_ns = event, now_ns
            case arsdk.Attitude():
                self._turn(event, now_ns)
            case arsdk.Battery():
                self.battery = event.level
            case arsdk.Position():
                altitude = max(-500.0, min(1e5, event.altitude_m))
                self.gps = GeoPoint(
                    latitude_deg=event.latitude_deg,
                    longitude_deg=event.longitude_deg,
                    altitude_m=altitude,
                )
            case arsdk.Ranges():
                self.maxima[event.setting] = event.current
            case arsdk.Altitude():
                pass

    def _turn(self, attitude: arsdk.Attitude, now_ns: int) -> None:
        seconds = (now_ns - self.attitude_ns) / NS_PER_S
        if self.attitude is not None and 0.02 < seconds < 1:
            turned = wrap(attitude.yaw_rad - self.attitude.yaw_rad)
            self.yaw_rate_radps = max(-20.0, min(20.0, -turned / seconds))
        self.attitude, self.attitude_ns = attitude, now_ns

    def velocity(self) -> Velocity | None:
        """Return the measured velocity of the drone's body; None before both are known."""
        if self.speed is None or self.attitude is None:
            return None
        cosine, sine = math.cos(self.attitude.yaw_rad), math.sin(self.attitude.yaw_rad)
        north, east = self.speed.north_mps, self.speed.east_mps
        return Velocity(
            forward_mps=_within(north * cosine + east * sine),
            lateral_mps=_within(north * sine - east * cosine),
            vertical_mps=_within(-self.speed.down_mps),
            yaw_rate_radps=self.yaw_rate_radps,
        )

    def oldest_ns(self) -> int:
        """Return when the older one of speed and attitude came."""
        return min(self.speed_ns, self.attitude_ns)


class BebopCore:
    """Everything between bytes and wishes; see `juncnet_services...pacing.Core`."""

    def __init__(self, tuning: Tuning, setup: tuple[bytes, ...], camera_tilt_deg: int) -> None:
        self.lost = False
        self.malformed = 0
        self._tuning = tuning
        self._setup = setup
        self._camera = arsdk.camera_orientation(camera_tilt_deg)
        self._begin(0)

    def _begin(self, now_ns: int) -> None:
        self._measured = Measured()
        self._queues = {b: Reliable(b) for b in (Buffer.HIGH_PRIORITY, Buffer.WITH_ACK)}
        self._forward, self._right = SpeedLoop(self._tuning), SpeedLoop(self._tuning)
        self._heard_ns = self._stepped_ns = self._repeated_ns = self._pointed_ns = now_ns
        self._number = 0
        self._answers = 0

    @property
    def trouble(self) -> str:
        """Why the drone will not fly; empty when it will."""
        if self._measured.state is None:
            return "the drone has not said yet whether it flies"
        if self._measured.state in (FlyingState.EMERGENCY, FlyingState.EMERGENCY_LANDING):
            return "the drone has cut its motors: put it on level ground and restart it"
        return ""

    def connected(self, now_ns: int) -> None:
        self.lost = False
        self._begin(now_ns)
        for payload in self._setup:
            self._queues[Buffer.WITH_ACK].put(payload)

    def heard(self, datagram: bytes, now_ns: int) -> list[bytes]:
        self._heard_ns = now_ns
        frames, rest = arsdk.decode(datagram)
        self.malformed += bool(rest)
        answers: list[bytes] = []
        for frame in frames:
            answers += self._take(frame, now_ns)
        return answers

    def due(self, wish: Wish, now_ns: int) -> list[bytes]:
        self.lost = now_ns - self._heard_ns > LOST_S * NS_PER_S
        self._insist(wish.aim, now_ns)
        packets = [self._pilot(wish, now_ns)]
        if now_ns - self._pointed_ns >= REPEAT_NS:
            self._pointed_ns = now_ns
            packets.append(self._numbered(self._camera, now_ns))
        for queue in self._queues.values():
            packets += queue.due(now_ns)
        return packets

    def take_off(self, now_ns: int) -> None:
        if self._measured.state is FlyingState.LANDED:
            self._queues[Buffer.WITH_ACK].put(arsdk.TAKE_OFF)

    def abort_take_off(self, now_ns: int) -> None:
        """Forget the order; a drone that has begun already ends in a hover of its own."""
        del now_ns
        self._queues[Buffer.WITH_ACK].drop(arsdk.TAKE_OFF)

    def ending(self) -> list[bytes]:
        return []

    def telemetry(self, now_ns: int, max_age_s: float) -> Telemetry | None:
        seen = self._measured
        limit_ns = max(max_age_s, BLIND_S) * NS_PER_S
        if seen.attitude is None or now_ns - seen.oldest_ns() > limit_ns:
            return None
        return Telemetry(
            yaw_rad=wrap(-seen.attitude.yaw_rad),
            velocity=seen.velocity(),
            gps=seen.gps,
            battery=seen.battery,
            flying=seen.state not in (FlyingState.LANDED, FlyingState.EMERGENCY, None),
        )

    def _take(self, frame: arsdk.Frame, now_ns: int) -> list[bytes]:
        if frame.kind is FrameType.ACK:
            queue = self._queues.get(_buffer(frame.buffer - arsdk.ACK_OFFSET))
            if queue is not None and frame.payload:
                queue.acknowledged(frame.payload[0])
            return []
        if frame.buffer == Buffer.PING:
            pong = arsdk.Frame(FrameType.DATA, Buffer.PONG, frame.sequence, frame.payload)
            return [arsdk.encode(pong)]
        if frame.buffer in (Buffer.EVENTS, Buffer.EVENTS_WITH_ACK):
            try:
                event = arsdk.event(frame.payload)
                if event is not None:
                    self._measured.take(event, now_ns)
            except arsdk.ArsdkError:
                self.malformed += 1
        if frame.kind is FrameType.DATA_WITH_ACK and frame.buffer < arsdk.ACK_OFFSET:
            return [self._acknowledgement(frame)]
        return []

    def _acknowledgement(self, frame: arsdk.Frame) -> bytes:
        self._answers += 1
        buffer = frame.buffer + arsdk.ACK_OFFSET
        answer = arsdk.Frame(FrameType.ACK, buffer, self._answers & 0xFF, bytes([frame.sequence]))
        return arsdk.encode(answer)

    def _insist(self, aim: Aim, now_ns: int) -> None:
        """Have the drone land or cut its motors; a take-off that waits is forgotten then."""
        if aim is Aim.FLY:
            return
        state, queue = self._measured.state, self._queues[Buffer.WITH_ACK]
        queue.drop(arsdk.TAKE_OFF)
        if now_ns - self._repeated_ns < REPEAT_NS:
            return
        self._repeated_ns = now_ns
        if aim is Aim.EMERGENCY and state is not FlyingState.LANDED:
            self._queues[Buffer.HIGH_PRIORITY].put(arsdk.EMERGENCY)
        elif aim is Aim.LAND and state not in (FlyingState.LANDED, FlyingState.LANDING):
            queue.put(arsdk.LANDING)

    def _pilot(self, wish: Wish, now_ns: int) -> bytes:
        """Return the PCMD frame for this moment."""
        seconds = min(0.2, max(0.0, (now_ns - self._stepped_ns) / NS_PER_S))
        self._stepped_ns = now_ns
        measured = self._measured.velocity()
        blind = now_ns - self._measured.oldest_ns() > BLIND_S * NS_PER_S
        flies = self._measured.state in arsdk.AIRBORNE
        if wish.brake or wish.aim is not Aim.FLY or measured is None or blind or not flies:
            self._forward.rest()
            self._right.rest()
            return self._numbered(arsdk.pcmd(), now_ns)
        want = wish.velocity
        yaw = -_percent(want.yaw_rate_radps, math.radians(self._maximum(arsdk.MAX_ROTATION)))
        gaz = _percent(want.vertical_mps, self._maximum(arsdk.MAX_VERTICAL))
        if math.hypot(want.forward_mps, want.lateral_mps) < STILL_MPS:
            self._forward.rest()
            self._right.rest()
            return self._numbered(arsdk.pcmd(yaw=yaw, gaz=gaz), now_ns)
        tilt = min(self._maximum(arsdk.MAX_TILT), self._tuning.max_tilt_deg)
        pitch = self._forward.step(want.forward_mps, measured.forward_mps, seconds, tilt)
        roll = self._right.step(-want.lateral_mps, -measured.lateral_mps, seconds, tilt)
        full = self._maximum(arsdk.MAX_TILT)
        payload = arsdk.pcmd(_percent(roll, full), _percent(pitch, full), yaw, gaz, tilt=True)
        return self._numbered(payload, now_ns)

    def _maximum(self, setting: tuple[int, int, int]) -> float:
        """Return what the drone says that 100 % is, and what it was asked for until it does."""
        asked: dict[tuple[int, int, int], float] = {
            arsdk.MAX_TILT: self._tuning.max_tilt_deg,
            arsdk.MAX_VERTICAL: self._tuning.max_vertical_mps,
            arsdk.MAX_ROTATION: self._tuning.max_rotation_degps,
        }
        return self._measured.maxima.get(setting, asked[setting])

    def _numbered(self, payload: bytes, now_ns: int) -> bytes:
        self._number = max(now_ns // STEP_NS, self._number + 1)
        frame = arsdk.Frame(FrameType.DATA, Buffer.NO_ACK, self._number & 0xFF, payload)
        return arsdk.encode(frame)


def hold_packets() -> tuple[bytes, ...]:
    """Return the hover command as a frame of each number."""
    return tuple(
        arsdk.encode(arsdk.Frame(FrameType.DATA, Buffer.NO_ACK, number, arsdk.pcmd()))
        for number in range(256)
    )


def wrap(angle_rad: float) -> float:
    """Return the angle within -pi..pi."""
    return math.remainder(angle_rad, math.tau)


def _percent(value: float, full: float) -> int:
    return round(max(-100.0, min(100.0, 100 * value / full)))


def _within(speed_mps: float) -> float:
    return max(-50.0, min(50.0, speed_mps))


def _buffer(number: int) -> Buffer:
    return Buffer(number) if number in (Buffer.WITH_ACK, Buffer.HIGH_PRIORITY) else Buffer.PING
