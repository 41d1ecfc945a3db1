"""The judge calls a flight right only when every one of its conditions holds."""

from typing import Any

import pytest

from juncnet.messages import (
    Ack,
    EventKind,
    JunctionEvent,
    OverrideKind,
    Pose,
    SimulatorTruth,
    Velocity,
)
from juncnet_services.cli.demo import summary_text
from juncnet_services.cli.judge import Judge, Plan, Summary
from scenes import score, stamp


def truth(second: float, **changes: Any) -> SimulatorTruth:
    fields: dict[str, Any] = {
        "at": stamp(second),
        "header": None,
        "pose": Pose(x_m=0, y_m=0),
        "velocity": Velocity(forward_mps=3.0),
        "road_offset_m": 0.1,
        "off_road_m": 0.0,
        "collided": False,
        "junction_id": None,
        "junctions_passed": 2,
        "path": (1, 2, 3),
        "label": "none",
        "mouth_m": None,
        "real_time_factor": 1.0,
        "simulated_s": second,
    }
    return SimulatorTruth(**(fields | changes))


def happened(kind: EventKind, second: float, count: int = 0) -> JunctionEvent:
    return JunctionEvent(
        header=stamp(second), flight="f", index=0, kind=kind, count=count, probability=0.1
    )


def fly(count: int = 2, finished: bool = True, **changes: Any) -> Summary:
    """Return the summary of a right flight of 50 s in which, in the middle, something changes."""
    judge = Judge(Plan((1, 2, 3), ideal_s=45.0), "world", "copter")
    for second in range(50):
        last = second == 49
        lasting = {k: v for k, v in changes.items() if k in ("path", "junctions_passed")}
        judge.truth(truth(second, **(changes if second == 25 else lasting if last else {})))
        judge.score(score(second))
    kind = EventKind.MISSION_FINISHED if finished else EventKind.LEFT
    judge.event(happened(kind, 49.0, count))
    return judge.summary()


def test_a_right_flight_is_flown_right() -> None:
    summary = fly()
    assert summary.flown_right
    assert summary.reasons == ()
    assert summary.turns_taken == summary.turns_planned == 2
    assert summary.fps == pytest.approx(1.0)
    assert summary.time_s == pytest.approx(49.0)
    assert summary.course == ()


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"count": 3}, "counted 3 junctions, passed 2"),
        ({"finished": False}, "not finished"),
        ({"off_road_m": 0.6}, "0.60 m off the road"),
        ({"off_road_m": 0.1}, "98.0 % of the time"),
        ({"collided": True}, "1 collisions"),
        ({"path": (1, 2, 4)}, "1 of 2 turns"),
        ({"junctions_passed": 3}, "passed 3"),
    ],
)
def test_one_fault_fails_it_and_is_named(changes: dict[str, Any], reason: str) -> None:
    summary = fly(**changes)
    assert summary.verdict == "failed"
    assert any(reason in text for text in summary.reasons), summary.reasons


def test_of_a_failed_flight_is_told_what_happened_where() -> None:
    summary = fly(path=(1, 2, 4), pose=Pose(x_m=7, y_m=8))
    assert (summary.roads_planned, summary.roads_driven) == ((1, 2, 3), (1, 2, 4))
    (finish,) = summary.course
    assert (finish.time_s, finish.kind, finish.count) == (49.0, EventKind.MISSION_FINISHED, 2)
    assert (finish.x_m, finish.y_m) == (0.0, 0.0)


def test_a_slow_flight_fails() -> None:
    judge = Judge(Plan((1,), ideal_s=10.0), "world", "copter")
    for second in range(20):
        judge.truth(truth(second, path=(1,), junctions_passed=0))
    judge.event(happened(EventKind.MISSION_FINISHED, 19.0))
    assert judge.summary().reasons == ("took 19 s, ideal 10 s",)


def test_a_slow_simulation_voids_the_flight() -> None:
    judge = Judge(Plan((1,), ideal_s=45.0), "world", "copter")
    for second in range(50):
        judge.truth(truth(second, path=(1,), real_time_factor=0.94))
    summary = judge.summary()
    assert summary.verdict == "void"
    assert not summary.flown_right
    assert summary.real_time_factor == pytest.approx(0.94)
    assert "--set simulator.width" in summary_text(summary)


@pytest.mark.parametrize(
    ("kind", "accepted", "verdict"),
    [
        (OverrideKind.HOLD, True, "void"),
        (OverrideKind.LAND, True, "void"),
        (OverrideKind.LAND, False, "failed"),
        (OverrideKind.RESUME, True, "failed"),
    ],
)
def test_a_flight_that_an_operator_kept_from_its_mission_is_void(
    kind: OverrideKind, accepted: bool, verdict: str
) -> None:
    judge = Judge(Plan((1, 2), ideal_s=45.0), "world", "copter")
    judge.truth(truth(0, path=(1,)))
    judge.answer(Ack(override=stamp(1.0), kind=kind, accepted=accepted, at=stamp(1.0)))
    summary = judge.summary()
    assert summary.verdict == verdict
    assert (f"an operator ordered {kind}" in summary.reasons) == (verdict == "void")
    assert "--set simulator.width" not in summary_text(summary)


def test_a_flight_that_went_on_rightly_after_a_stop_is_flown_right() -> None:
    judge = Judge(Plan((1,), ideal_s=45.0), "world", "copter")
    for second in range(50):
        judge.truth(truth(second, path=(1,), junctions_passed=0))
    judge.answer(Ack(override=stamp(20.0), kind=OverrideKind.HOLD, accepted=True, at=stamp(20.0)))
    judge.event(happened(EventKind.MISSION_FINISHED, 49.0))
    assert judge.summary().flown_right


def test_a_slow_second_is_told_and_voids_nothing() -> None:
    summary = fly(real_time_factor=0.5)
    assert summary.verdict == "flown_right"
    assert summary.real_time_factor == pytest.approx(0.99)
    assert summary.real_time_factor_lowest == 0.5


def test_nothing_seen_is_not_flown_right() -> None:
    assert not Judge(Plan((1, 2), 10.0), "world", "copter").summary().flown_right


def test_what_kept_the_robot_is_told_of_an_unfinished_mission_only() -> None:
    judge = Judge(Plan((1, 2), 10.0), "world", "copter")
    assert judge.summary("output stopped").reasons[-1] == "at the end: output stopped"
    judge.event(happened(EventKind.MISSION_FINISHED, 1.0))
    assert not any("at the end" in reason for reason in judge.summary("moving").reasons)
