"""What the page is told, several times a second: pure, from what was heard to JSON."""

from typing import Any

from juncnet.clocks import NS_PER_S, Instant, age_s
from juncnet.messages import Health, NavigationState, VehicleState
from juncnet.topics import SERVICES
from juncnet_services.dashboard.robots import Robot, Robots

SILENT_S = 3.0
"""A process whose last report is older than this is silent."""


def snapshot(robots: Robots, after: int, now: Instant) -> dict[str, Any]:
    """Return the state of all robots, with those rows whose serial is higher than `after`."""
    return {
        "serial": robots.serial,
        "robots": {name: _robot(robot, after, now) for name, robot in sorted(robots.items())},
    }


def _robot(robot: Robot, after: int, now: Instant) -> dict[str, Any]:
    return {
        "flight": robot.flight,
        "silent_s": _since(robot.heard_ns, now),
        "navigation": _navigation(robot.navigation),
        "vehicle": _vehicle(robot, now),
        "processes": [
            _process(health, (now.ns - heard_ns) / NS_PER_S)
            for health, heard_ns in sorted(robot.health.values(), key=_in_data_order)
        ],
        "model": None if robot.model is None else robot.model.model.name,
        "follower": None if robot.follower is None else robot.follower.follower,
        "tally": robot.tally.as_json(),
        "scores": robot.scores.after(after),
        "smoothed": robot.smoothed.after(after),
        "path": robot.path.after(after),
        "events": [
            row | {"ago_s": _ago(robot, row["t"], row["heard_ns"], now)}
            for row in robot.events.after(after)
        ],
    }


def _navigation(state: NavigationState | None) -> dict[str, Any] | None:
    if state is None:
        return None
    fields = {"phase", "count", "smoothed", "reason", "thresholds"}
    return state.model_dump(mode="json", include=fields) | {
        "mission": state.mission.model_dump(mode="json", exclude_none=True),
        "next_turn": state.next_turn and state.next_turn.model_dump(exclude_none=True),
    }


def _vehicle(robot: Robot, now: Instant) -> dict[str, Any] | None:
    state: VehicleState | None = robot.vehicle
    if state is None:
        return None
    speed = (state.velocity or state.commanded).forward_mps
    pose = state.pose
    return {
        "kind": state.capabilities.kind,
        "output": state.output.value,
        "reason": state.output_reason,
        "flying": state.flying,
        "battery": state.battery,
        "speed_mps": round(speed, 2),
        "measured": state.velocity is not None,
        "place": robot.place,
        "yaw_rad": state.yaw_rad if pose is None else pose.yaw_rad,
        "height_m": None if pose is None else round(pose.z_m, 1),
        "silent_s": _since(robot.vehicle_ns, now),
    }


def _in_data_order(heard: tuple[Health, int]) -> tuple[int, str]:
    name = heard[0].service
    return (SERVICES.index(name) if name in SERVICES else len(SERVICES), name)


def _process(health: Health, silent_s: float) -> dict[str, Any]:
    return {
        "service": health.service,
        "rate_hz": round(health.rate_hz, 1),
        "age_ms": None if health.age_s is None else round(1e3 * health.age_s, 1),
        "p50_ms": _rounded(health.latency_p50_ms),
        "p99_ms": _rounded(health.latency_p99_ms),
        "drops": health.drops,
        "errors": health.errors,
        "last_error": health.last_error,
        "silent_s": round(silent_s, 1),
        "silent": silent_s > SILENT_S,
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 2)


def _since(then_ns: int | None, now: Instant) -> float | None:
    return None if then_ns is None else round((now.ns - then_ns) / NS_PER_S, 2)


def _ago(robot: Robot, then_s: float | None, heard_ns: int, now: Instant) -> float | None:
    """Return how long ago something happened by the robot's clock, else how long it was heard."""
    state = robot.vehicle
    if then_s is None or state is None:
        return _since(heard_ns, now)
    return age_s(Instant(round(then_s * NS_PER_S), state.at.clock), now)
