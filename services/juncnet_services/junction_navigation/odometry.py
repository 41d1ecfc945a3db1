"""Distance and direction: measured where there is telemetry, else from what was commanded."""

import math
from bisect import bisect_left
from collections import deque

from juncnet.messages import Output, VehicleState
from juncnet_services.junction_navigation.config import NavigatorConfig
from juncnet_services.junction_navigation.progress import Progress

HISTORY = 200
MAX_STEP_S = 0.25
YAW_RATE_NS = 100_000_000
OUTAGE_REACTION_S = 0.3
"""From what was known last to the hold of a robot whose pipeline was cut: at most 0.2 s each."""


def wrapped(angle_rad: float) -> float:
    """Return the angle in -pi..pi that points the same way."""
    return math.remainder(angle_rad, 2 * math.pi)


class Odometry:
    """Keeps `odometer_m`, `speed_mps`, `yaw_rad` and `position_m` of a `Progress` up to date.

    Without telemetry the vehicle is taken to do what it was last told, its forward speed with its
    lag. A restart, and what comes behind a silence of the vehicle's state, continues from the last
    readings: by the pose where there is one, else by the distance of a stop from the last speed,
    because a robot whose navigator or output is gone is held.
    """

    def __init__(self, config: NavigatorConfig, progress: Progress, resumed: bool) -> None:
        self._progress = progress
        self._deceleration = config.deceleration_mps2
        self._lag_s = config.velocity_lag_s
        self._silence_ns = config.vehicle_silence_s * 1e9
        self._resumed = resumed
        self._newest_ns: int | None = None
        self._heard: tuple[VehicleState, int, float] | None = None
        """The newest state of the vehicle, when it came, and the odometer reading then."""
        self._past: deque[tuple[int, float, float]] = deque(maxlen=HISTORY)

    def advance(self, now_ns: int, vehicle: VehicleState) -> float:
        """Move on to `now_ns` and return the seconds in which the pipeline moved the robot."""
        state, elapsed_s = self._progress, 0.0
        if self._newest_ns is None and not self._resumed:
            state.odometer_m, state.speed_mps = 0.0, 0.0
        elif self._newest_ns is None or self._heard is None:
            state.odometer_m += self._outage_m(vehicle)
        elif vehicle is not self._heard[0] and now_ns - self._heard[1] > self._silence_ns:
            state.odometer_m = self._heard[2] + self._outage_m(vehicle)
        else:
            elapsed_s = min(max(now_ns - self._newest_ns, 0) / 1e9, MAX_STEP_S)
        self._newest_ns = now_ns
        moving = vehicle.commanded
        if vehicle.capabilities.telemetry and vehicle.velocity is not None:
            moving = vehicle.velocity
            state.speed_mps = moving.forward_mps
        else:
            share = 1 - math.exp(-elapsed_s / max(self._lag_s, 1e-3))
            state.speed_mps += share * (moving.forward_mps - state.speed_mps)
        state.odometer_m += state.speed_mps * elapsed_s
        if vehicle.capabilities.telemetry and vehicle.yaw_rad is not None:
            state.yaw_rad += wrapped(vehicle.yaw_rad - state.yaw_rad)
        else:
            state.yaw_rad += moving.yaw_rate_radps * elapsed_s
        if vehicle.pose is not None:
            state.position_m = (vehicle.pose.x_m, vehicle.pose.y_m)
        if self._heard is None or self._heard[0] is not vehicle:
            self._heard = vehicle, now_ns, state.odometer_m
        self._past.append((now_ns, state.odometer_m, state.yaw_rad))
        return elapsed_s if vehicle.output is Output.PIPELINE else 0.0

    def at(self, time_ns: int) -> tuple[float, float]:
        """Return (odometer in metres, unwrapped yaw in radians) at a time of the last seconds."""
        if not self._past:
            return self._progress.odometer_m, self._progress.yaw_rad
        place = bisect_left(self._past, time_ns, key=lambda entry: entry[0])
        if place == 0 or place == len(self._past):
            return self._past[min(place, len(self._past) - 1)][1:]
        (t0, m0, y0), (t1, m1, y1) = self._past[place - 1], self._past[place]
        part = (time_ns - t0) / max(t1 - t0, 1)
        return m0 + part * (m1 - m0), y0 + part * (y1 - y0)

    @property
    def yaw_rate_radps(self) -> float:
        """Yaw rate over the last moments."""
        if not self._past:
            return 0.0
        now_ns, _, yaw = self._past[-1]
        then_ns = max(now_ns - YAW_RATE_NS, self._past[0][0])
        return (yaw - self.at(then_ns)[1]) * 1e9 / max(now_ns - then_ns, 1)

    def _outage_m(self, vehicle: VehicleState) -> float:
        """Return how far the robot has gone since it was heard of, before `vehicle`."""
        state = self._progress
        if vehicle.pose is not None and state.position_m is not None:
            return math.dist((vehicle.pose.x_m, vehicle.pose.y_m), state.position_m)
        speed = abs(state.speed_mps)
        return speed * OUTAGE_REACTION_S + speed**2 / 2 / self._deceleration
