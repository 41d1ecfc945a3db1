"""How the simulated vehicles move: a copter and an Ackermann rover, as steps of their state."""

import math
from dataclasses import dataclass, replace

from juncnet.messages import Velocity


@dataclass(frozen=True)
class Motion:
    """Pose and velocity of a vehicle; lengths metres, angles radians, counter-clockwise."""

    x_m: float
    y_m: float
    z_m: float
    yaw_rad: float
    """Unwrapped."""
    forward_mps: float = 0.0
    lateral_mps: float = 0.0
    vertical_mps: float = 0.0
    yaw_rate_radps: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    """Nose down positive."""
    time_s: float = 0.0
    """Since the start; drives the drift."""


@dataclass(frozen=True)
class Drift:
    """Slow disturbance that the vehicle does not measure: wind or slip, and a gyroscope's bias.

    Two sines with periods of some ten seconds each way, their phases from `seed`.
    """

    speed_mps: float = 0.1
    """Largest speed at which the vehicle drifts."""
    yaw_rate_radps: float = math.radians(0.5)
    seed: int = 0

    def at(self, time_s: float) -> tuple[float, float, float]:
        """Return drift along world x and y [m/s] and in yaw [rad/s] at `time_s`."""
        # Golden-ratio steps spread the phases of neighbouring seeds over the circle.
        phase = 2 * math.pi * ((self.seed * 0.6180339887) % 1.0)
        x = math.sin(2 * math.pi * time_s / 37.0 + phase)
        y = math.sin(2 * math.pi * time_s / 29.0 + 2.3 * phase + 1.0)
        yaw = math.sin(2 * math.pi * time_s / 53.0 + 1.7 * phase + 2.0)
        scale = self.speed_mps / math.sqrt(2)
        return scale * x, scale * y, self.yaw_rate_radps * yaw


CALM = Drift(0.0, 0.0)


@dataclass(frozen=True)
class Copter:
    """A multicopter that holds its altitude: velocities lag, yaw has inertia, all is limited."""

    speed_error: float = 1.0
    """Its real speed is this times what it is told and believes."""
    drift: Drift = CALM
    max_speed_mps: float = 12.0
    max_acceleration_mps2: float = 4.0
    max_yaw_rate_radps: float = 2.0
    max_yaw_acceleration_radps2: float = 8.0
    lag_s: float = 0.35
    yaw_lag_s: float = 0.2
    tilt_rad_per_mps2: float = 1 / 9.81 / 4
    """Tilt that its camera's gimbal leaves, per acceleration."""

    def step(self, state: Motion, setpoint: Velocity, dt_s: float, brake: bool = False) -> Motion:
        """Return the state `dt_s` later; `brake` wants zero velocity whatever the setpoint says."""
        wanted = Velocity() if brake else setpoint
        limit, rate = self.max_speed_mps, self.max_acceleration_mps2
        forward = _lagged(state.forward_mps, wanted.forward_mps, limit, self.lag_s, rate, dt_s)
        lateral = _lagged(state.lateral_mps, wanted.lateral_mps, limit, self.lag_s, rate, dt_s)
        vertical = _lagged(state.vertical_mps, wanted.vertical_mps, 2.0, self.lag_s, rate, dt_s)
        yaw_rate = _lagged(
            state.yaw_rate_radps,
            wanted.yaw_rate_radps,
            self.max_yaw_rate_radps,
            self.yaw_lag_s,
            self.max_yaw_acceleration_radps2,
            dt_s,
        )
        tilt = self.tilt_rad_per_mps2 / dt_s
        moved = replace(
            state,
            z_m=max(0.0, state.z_m + vertical * dt_s),
            forward_mps=forward,
            lateral_mps=lateral,
            vertical_mps=vertical,
            yaw_rate_radps=yaw_rate,
            roll_rad=-tilt * (lateral - state.lateral_mps),
            pitch_rad=tilt * (forward - state.forward_mps),
        )
        drift = CALM if brake else self.drift  # a copter told to hold keeps its position
        return _displaced(moved, self.speed_error, drift, dt_s)


@dataclass(frozen=True)
class Rover:
    """A car-like rover (bicycle model): turns only while it rolls, `min_radius_m` at least."""

    speed_error: float = 1.0
    """Its real speed is this times what it is told and believes."""
    drift: Drift = CALM
    max_speed_mps: float = 5.0
    max_acceleration_mps2: float = 1.5
    max_braking_mps2: float = 4.0
    min_radius_m: float = 2.5
    lag_s: float = 0.3
    steering_lag_s: float = 0.2

    def step(self, state: Motion, setpoint: Velocity, dt_s: float, brake: bool = False) -> Motion:
        """Return the state `dt_s` later; `brake` brakes to standstill as hard as it can."""
        target = 0.0 if brake else setpoint.forward_mps
        speed = self._speed(state.forward_mps, target, dt_s, brake)
        # Steering is the curvature that the wheels are set to; at standstill it keeps its place.
        largest = 1.0 / self.min_radius_m
        old = state.yaw_rate_radps / state.forward_mps if abs(state.forward_mps) > 0.05 else 0.0
        wanted = old
        if not brake and abs(setpoint.forward_mps) > 0.05:
            wanted = setpoint.yaw_rate_radps / setpoint.forward_mps
        wanted = min(max(wanted, -largest), largest)
        share = 1.0 - math.exp(-dt_s / self.steering_lag_s)
        curvature = min(max(old + (wanted - old) * share, -largest), largest)
        moved = replace(
            state,
            forward_mps=speed,
            lateral_mps=0.0,
            vertical_mps=0.0,
            yaw_rate_radps=speed * curvature,
        )
        if abs(speed) < 1e-3:
            return replace(moved, time_s=state.time_s + dt_s)
        return _displaced(moved, self.speed_error, self.drift, dt_s, arc=True)

    def _speed(self, speed: float, target: float, dt_s: float, brake: bool) -> float:
        slows = abs(target) < abs(speed) or target * speed < 0
        rate = self.max_braking_mps2 if slows else self.max_acceleration_mps2
        if brake:
            return math.copysign(max(abs(speed) - rate * dt_s, 0.0), speed)
        new = _lagged(speed, target, self.max_speed_mps, self.lag_s, rate, dt_s)
        return 0.0 if target == 0.0 and abs(new) < 0.02 else new


Vehicle = Copter | Rover


def _lagged(
    value: float, target: float, limit: float, lag_s: float, rate: float, dt_s: float
) -> float:
    """Return `value` after `dt_s` of a first-order lag towards the limited target, rate-limited."""
    target = min(max(target, -limit), limit)
    change = (target - value) * (1.0 - math.exp(-dt_s / lag_s))
    return value + min(max(change, -rate * dt_s), rate * dt_s)


def _displaced(
    state: Motion, speed_error: float, drift: Drift, dt_s: float, arc: bool = False
) -> Motion:
    """Return `state` moved by its velocity for `dt_s`; on an arc the yaw goes with the distance."""
    drift_x, drift_y, drift_yaw = drift.at(state.time_s)
    turned = state.yaw_rate_radps * (speed_error if arc else 1.0) + drift_yaw
    yaw = state.yaw_rad + turned * dt_s
    middle = (yaw + state.yaw_rad) / 2
    c, s = math.cos(middle), math.sin(middle)
    forward, lateral = speed_error * state.forward_mps, speed_error * state.lateral_mps
    return replace(
        state,
        x_m=state.x_m + (c * forward - s * lateral + drift_x) * dt_s,
        y_m=state.y_m + (s * forward + c * lateral + drift_y) * dt_s,
        yaw_rad=yaw,
        time_s=state.time_s + dt_s,
    )
