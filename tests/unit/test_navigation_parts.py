"""The navigator's parts: detector, mouth estimate, inputs, store, missions."""

import math
from pathlib import Path

import pytest

from juncnet.camera import CameraGeometry
from juncnet.clocks import Instant
from juncnet.messages import (
    Capabilities,
    JunctionScore,
    Mission,
    ModelIdentity,
    Output,
    Phase,
    RoadCommand,
    RoadSeen,
    Stamp,
    Turn,
    VehicleState,
    Velocity,
)
from juncnet_services.junction_navigation.config import (
    DetectorConfig,
    NavigatorConfig,
)
from juncnet_services.junction_navigation.detector import JunctionDetector
from juncnet_services.junction_navigation.missions import load_mission
from juncnet_services.junction_navigation.navigator import Navigator
from juncnet_services.junction_navigation.place import mouth_m
from juncnet_services.junction_navigation.progress import Junction, Progress, TurnProgress
from juncnet_services.junction_navigation.speed import braking_mps, feasible, scaled
from juncnet_services.junction_navigation.store import FILE_NAME, Resumed, Store

BAND = CameraGeometry().band
FRAME_NS = 40_000_000
MISSION = Mission(turns=(Turn(at=1, turn="left"),), finish_after=2)
MODEL = ModelIdentity(name="m", sha256="0" * 64)
MEASURING = Capabilities(kind="copter", turns_in_place=True, telemetry=True)


def progress() -> Progress:
    return Progress(flight="f", configured=MISSION, mission=MISSION)


def stamp(time_ns: int, sequence: int = 1, epoch: int = 1, clock: str = "c") -> Stamp:
    return Stamp(epoch=epoch, sequence=sequence, time_ns=time_ns, clock=clock)


def vehicle(forward_mps: float = 0.0, **fields: object) -> VehicleState:
    values: dict[str, object] = {
        "at": stamp(1),
        "capabilities": MEASURING,
        "yaw_rad": 0.0,
        "velocity": Velocity(forward_mps=forward_mps),
        "output": Output.PIPELINE,
    }
    return VehicleState.model_validate(values | fields)


def road(sequence: int, time_ns: int, source: str = "road_following", confidence: float = 0.9):
    return RoadCommand(
        header=stamp(time_ns, sequence),
        source=source,
        velocity=Velocity(forward_mps=6.0, lateral_mps=0.5, yaw_rate_radps=0.4),
        confidence=confidence,
        road=RoadSeen(offset_m=0.0, heading_rad=0.0, width_m=6.0),
    )


def score(sequence: int, time_ns: int, p: float = 0.1) -> JunctionScore:
    header = stamp(time_ns, sequence)
    return JunctionScore(header=header, model=MODEL, probabilities={"none": 1 - p, "junction": p})


# --- detector ---


def test_smoothing_is_by_time_and_not_by_frames() -> None:
    reached: list[float] = []
    for step_ms in (10, 40, 80):
        state = progress()
        detector = JunctionDetector(DetectorConfig(), BAND, state)
        detector.smooth(0, 0.0)
        for t in range(step_ms, 241, step_ms):
            detector.smooth(t * 1_000_000, 1.0)
        reached.append(state.smoothed)
    assert reached == pytest.approx([1 - math.exp(-0.24 / 0.12)] * 3)


def test_one_bright_frame_does_not_rise() -> None:
    state = progress()
    detector = JunctionDetector(DetectorConfig(), BAND, state)
    edges = [detector.smooth(i * 40_000_000, float(i == 5)) for i in range(20)]
    assert edges == [None] * 20


def test_a_short_rise_is_no_junction_and_a_long_one_is() -> None:
    state = progress()
    detector = JunctionDetector(DetectorConfig(), BAND, state)
    detector.risen(0.0, "junction")
    detector.fallen(1.0)
    state.odometer_m = 8.0
    assert detector.next_junction() is None
    assert state.candidate is None
    state.candidate = Junction(rise_m=10.0, probability=0.99)
    state.odometer_m = 10.0 + detector.confirm_m + 0.1
    assert detector.next_junction() == Junction(rise_m=10.0, probability=0.99)


def test_a_long_rise_that_is_never_sure_is_no_junction() -> None:
    state = progress()
    detector = JunctionDetector(DetectorConfig(), BAND, state)
    state.candidate = Junction(rise_m=10.0, probability=0.9)
    state.odometer_m = 10.0 + 2 * detector.confirm_m
    assert detector.next_junction() is None
    state.candidate.probability = 0.95
    assert detector.next_junction() is not None


@pytest.mark.parametrize(("part", "counted"), [(0.5, False), (0.7, True)])
def test_a_score_that_lasts_is_a_junctions_though_it_is_never_certain(
    part: float, counted: bool
) -> None:
    state = progress()
    detector = JunctionDetector(DetectorConfig(), BAND, state)
    state.candidate = Junction(rise_m=10.0, probability=0.8)
    state.odometer_m = 10.0 + part * (BAND.d_far_m - BAND.d_near_m)
    assert (detector.next_junction() is not None) is counted


def test_nothing_is_counted_right_behind_a_junction() -> None:
    state = progress()
    detector = JunctionDetector(DetectorConfig(gap_m=3.0), BAND, state)
    state.left_m = 20.0
    state.candidate = Junction(rise_m=15.0, probability=1.0)
    state.odometer_m = 22.9
    assert detector.next_junction() is None
    state.odometer_m = 23.1
    assert detector.next_junction() is not None


def test_behind_a_turn_the_next_junction_may_follow_at_once() -> None:
    state = progress()
    detector = JunctionDetector(DetectorConfig(gap_m=3.0), BAND, state)
    state.left_m, state.left_turned, state.odometer_m = 20.0, True, 20.1
    ahead = Junction(rise_m=14.0, probability=1.0)
    state.candidate = ahead.model_copy()
    assert detector.next_junction() == ahead
    passed = Junction(rise_m=14.0, fall_m=19.9 - BAND.d_near_m, probability=1.0)
    state.candidate = passed
    assert detector.next_junction() is None
    assert state.candidate is None


def test_a_score_that_rises_right_behind_a_turn_is_no_dip_of_the_junction_turned_at() -> None:
    state = progress()
    detector = JunctionDetector(DetectorConfig(), BAND, state)
    state.junction = Junction(rise_m=0.0, fall_m=6.0)
    state.turned = TurnProgress(turn=Turn(at=1, turn="left"), nominal_rad=0.0)
    detector.risen(7.0, "junction")
    assert state.junction.fall_m == 6.0
    assert state.candidate == Junction(rise_m=7.0)


def test_a_dip_is_no_fall() -> None:
    state = progress()
    state.junction = Junction(rise_m=0.0)
    detector = JunctionDetector(DetectorConfig(), BAND, state)
    detector.fallen(6.0)
    detector.risen(7.0, "junction")
    assert state.junction.fall_m is None
    assert state.candidate is None


def test_the_mouth_comes_from_the_camera() -> None:
    exact = Junction(rise_m=100.0, fall_m=100.0 + BAND.d_far_m - BAND.d_near_m)
    assert mouth_m(exact, BAND, 112.0) == pytest.approx(100.0 + BAND.d_far_m)
    assert mouth_m(Junction(rise_m=100.0), BAND, 101.0) == pytest.approx(100.0 + BAND.d_far_m)
    lost = Junction(rise_m=100.0, fall_m=102.0)
    assert mouth_m(lost, BAND, 103.0) == pytest.approx(100.0 + BAND.d_far_m)
    unseen = Junction(rise_m=100.0, rise_seen=False, fall_m=102.0)
    assert mouth_m(unseen, BAND, 103.0) == pytest.approx(102.0 + BAND.d_near_m)


def test_a_late_fall_outweighs_the_rise_but_a_stuck_score_is_bounded() -> None:
    expected = 100.0 + BAND.d_far_m
    late = Junction(rise_m=100.0, fall_m=102.0 + BAND.d_far_m - BAND.d_near_m)
    assert expected + 1.5 < mouth_m(late, BAND, 0.0) < expected + 3.0
    assert mouth_m(Junction(rise_m=100.0), BAND, 500.0) <= expected + 0.1 * BAND.d_far_m + 1e-9


# --- turning and speeds ---


def test_speeds() -> None:
    fast = Velocity(forward_mps=6.0, lateral_mps=1.0, yaw_rate_radps=0.6)
    assert scaled(fast, 3.0) == Velocity(forward_mps=3.0, lateral_mps=0.5, yaw_rate_radps=0.3)
    rover = Capabilities(minimum_radius_m=3.0)
    turned = feasible(Velocity(forward_mps=1.5, lateral_mps=1.0, yaw_rate_radps=-2.0), rover, 1.0)
    assert turned == Velocity(forward_mps=1.5, yaw_rate_radps=-0.5)
    assert braking_mps(0.0, 1.0, 1.5, 0.3) == 0.0
    assert braking_mps(3.0, 0.0, 1.5, 0.3) == pytest.approx(3.0)
    assert 0 < braking_mps(0.1, 1.0, 1.5, 0.3) < 0.5


# --- navigator: what it refuses and when it holds ---

NOW = 10_000_000_000


def started() -> Navigator:
    navigator = Navigator(NavigatorConfig(), MISSION, "f")
    decision = navigator.step(Instant(NOW, "c"), score(1, NOW), road(1, NOW), vehicle(1.0))
    assert decision.state.reason == "the count starts at 0"
    assert decision.state.phase is Phase.FOLLOWING
    assert decision.velocity == Velocity(forward_mps=3.0, yaw_rate_radps=0.2)
    assert decision.header == stamp(NOW)
    return navigator


@pytest.mark.parametrize(
    ("aside_m", "ends_m", "followed"),
    [
        (0.5, None, True),
        (4.8, None, False),
        (-4.8, None, False),
        (4.8, 12.0, False),
        (4.8, 5.0, True),
    ],
)
def test_a_road_beside_is_the_way_straight_on_where_nothing_goes_on_ahead(
    aside_m: float, ends_m: float | None, followed: bool
) -> None:
    """`aside_m`: of the middle of the road seen, 6 m ahead of a robot that crosses a junction."""
    state = Progress(flight="f", configured=MISSION, mission=Mission(finish_after=5), count=2)
    band = CameraGeometry().band
    state.junction = Junction(rise_m=0.0, fall_m=band.d_far_m - band.d_near_m)
    state.phase, state.axis_rad, state.odometer_m = Phase.CROSSING, 0.0, band.d_far_m + 4.0
    navigator = Navigator(NavigatorConfig(), MISSION, "f", Resumed(state, ""))
    centre = ((2.0, 0.0), (6.0, aside_m), (9.0, 0.0))
    seen = RoadSeen(offset_m=0.0, heading_rad=0.0, width_m=6.0, centre=centre, ends_m=ends_m)
    command = road(1, NOW).model_copy(update={"road": seen})
    decision = navigator.step(Instant(NOW, "c"), score(1, NOW), command, vehicle(2.0))
    assert decision.state.phase is Phase.CROSSING
    assert (decision.velocity.yaw_rate_radps > 0.1) is followed
    assert decision.velocity.forward_mps == pytest.approx(2.0 if followed else 3.0)


def test_stale_pictures_hold_with_a_reason() -> None:
    navigator = started()
    later = NOW + 250_000_000
    decision = navigator.step(Instant(later, "c"), None, road(2, later), vehicle(1.0))
    assert decision.velocity == Velocity()
    assert "junction/score" in decision.state.reason
    decision = navigator.step(Instant(later, "c"), score(2, later), None, vehicle(1.0))
    assert decision.velocity.forward_mps == 3.0


def test_a_silent_vehicle_and_a_foreign_clock_hold() -> None:
    navigator = started()
    later = NOW + 600_000_000
    decision = navigator.step(Instant(later, "c"), score(2, later), road(2, later))
    assert "vehicle/state" in decision.state.reason
    decision = started().step(Instant(NOW, "other"))
    assert decision.velocity == Velocity()


def test_an_unsure_follower_holds_while_following() -> None:
    navigator = started()
    decision = navigator.step(Instant(NOW, "c"), None, road(2, NOW, confidence=0.1), vehicle())
    assert decision.state.phase is Phase.FOLLOWING
    assert decision.velocity == Velocity()
    assert "not sure" in decision.state.reason


def test_other_sources_and_replays_are_refused() -> None:
    navigator = started()
    now = Instant(NOW + 1, "c")
    decision = navigator.step(now, score(1, NOW), road(2, NOW, source="intruder"))
    assert len(decision.refused) == 2
    assert "intruder" in decision.refused[1]
    assert navigator.step(now, None, road(1, NOW)).refused != ()
    assert navigator.step(now, None, road(2, NOW)).refused == ()


def test_a_mission_is_set_between_junctions_only() -> None:
    navigator = started()
    navigator.progress.count = 3
    reply = navigator.set_mission(Mission(name="new"))
    assert reply.accepted
    assert "it was 3" in reply.reason
    assert navigator.progress.count == 0
    navigator.progress.phase = Phase.TURNING
    assert not navigator.set_mission(MISSION).accepted
    assert navigator.progress.mission.name == "new"


# --- store and missions ---


def test_progress_is_resumed_for_the_same_flight_and_mission_only(tmp_path: Path) -> None:
    store = Store(tmp_path)
    assert store.resume("f", MISSION).progress is None
    saved = progress()
    saved.count, saved.phase = 2, Phase.CROSSING
    store.save(saved)
    assert store.resume("f", MISSION).progress == saved
    other = store.resume("g", MISSION)
    assert other.progress is None
    assert "another flight" in other.note
    assert "another mission" in store.resume("f", Mission()).note


def test_unreadable_progress_holds_until_a_mission_is_set(tmp_path: Path) -> None:
    (tmp_path / FILE_NAME).write_text('{"flight": "f", "count"')
    found = Store(tmp_path).resume("f", MISSION)
    assert found.progress is None
    navigator = Navigator(NavigatorConfig(), MISSION, "f", found)
    inputs = (Instant(NOW, "c"), score(1, NOW), road(1, NOW), vehicle())
    decision = navigator.step(*inputs)
    assert decision.velocity == Velocity()
    assert "set a mission" in decision.state.reason
    assert navigator.set_mission(MISSION).accepted
    assert navigator.step(Instant(NOW, "c")).velocity.forward_mps > 0


def test_missions_that_come_with_the_product_are_valid() -> None:
    for name in ("left_right", "follow", "third_left"):
        assert load_mission(name).name == name
    assert load_mission(MISSION) is MISSION
    with pytest.raises(FileNotFoundError, match="left_right"):
        load_mission("no_such_mission")


def test_a_mission_may_be_json(tmp_path: Path) -> None:
    path = tmp_path / "own.json"
    path.write_text('{"name": "own", "turns": [{"at": 2, "turn": "left"}], "finish_after": 3}')
    assert load_mission(path).turns[0].at == 2


@pytest.mark.parametrize(
    ("scores", "fell_at"),
    [
        ([0.0, *[1.0] * 10, *[0.42] * 25, *[0.0] * 5], 10.5),
        ([0.0, *[1.0] * 10, *[0.7] * 20, *[0.0] * 5], 20.5),
    ],
    ids=["lingers below what it rises at", "sinks slowly"],
)
def test_a_score_that_lingers_fell_half_way_from_certain(
    scores: list[float], fell_at: float
) -> None:
    detector = JunctionDetector(DetectorConfig(smoothing_s=0.01), BAND, progress())
    falls: list[float] = []
    for number, probability in enumerate(scores):
        if detector.smooth(10**10 + number * FRAME_NS, probability) is False:
            falls.append(number * FRAME_NS / 1e9 - detector.fall_lag_s)
    assert falls == [pytest.approx(fell_at * FRAME_NS / 1e9, abs=0.02)]
