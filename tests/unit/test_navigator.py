"""The navigator on simulated roads: counts, turns, kills. Tolerances are stated where asserted."""

import math

import pytest

from juncnet.camera import CameraGeometry
from juncnet.messages import Capabilities, EventKind, Mission, Phase, RoadCommand, Stamp, Turn
from juncnet_services.junction_navigation.config import NavigatorConfig
from roadsim import COPTER, ROVER, Flight, Plane, Road, crossroads

SILENT = COPTER.model_copy(update={"telemetry": False})
LEFT = Mission(turns=(Turn(at=1, turn="left"),), finish_after=1)
FIRST_TURN = (
    EventKind.APPROACHED,
    EventKind.ENTERED,
    EventKind.TURN_STARTED,
    EventKind.TURN_FINISHED,
    EventKind.LEFT,
    EventKind.MISSION_FINISHED,
)


def turning_error_m(flight: Flight) -> float:
    """How far from the junction's centre (the origin) the copter turned."""
    (x, y), _ = flight.at(EventKind.TURN_STARTED)
    return math.hypot(x, y)


def unseen(header: Stamp) -> RoadCommand:
    """What a follower says that sees no road."""
    return RoadCommand(header=header, source="road_following", velocity=None, confidence=0)


def config(height_m: float = 3.0, cruise_mps: float = 3.0) -> NavigatorConfig:
    return NavigatorConfig(camera=CameraGeometry(height_m=height_m), cruise_mps=cruise_mps)


@pytest.mark.parametrize(("turn", "sign"), [("left", 1), ("right", -1)])
def test_a_turn_ends_on_the_next_road(turn: str, sign: int) -> None:
    mission = Mission.model_validate({"turns": [{"at": 1, "turn": turn}], "finish_after": 1})
    flight = Flight(crossroads([0.0]), mission).run(60)
    assert tuple(flight.kinds) == FIRST_TURN
    assert turning_error_m(flight) < 0.5
    assert flight.y * sign > 5
    assert abs(flight.x) < 0.5
    assert [event.index for event in flight.events] == list(range(6))


def test_a_turn_by_angle() -> None:
    mission = Mission(turns=(Turn(at=1, angle_deg=-90),), finish_after=1)
    flight = Flight(crossroads([0.0]), mission).run(60)
    assert flight.y < -5
    assert flight.kinds.count(EventKind.TURN_FINISHED) == 1


def test_junctions_without_a_turn_are_crossed_and_counted() -> None:
    mission = Mission(turns=(Turn(at=3, turn="right"),), finish_after=3)
    flight = Flight(crossroads([0.0, 40.0, 75.0]), mission).run(90)
    assert [e.count for e in flight.events if e.kind is EventKind.APPROACHED] == [1, 2, 3]
    assert flight.kinds.count(EventKind.TURN_STARTED) == 1
    assert abs(flight.x - 75) < 0.5
    assert flight.y < -5
    on_the_way = [y for x, y in flight.path if x < 60]
    assert max(abs(y) for y in on_the_way) < 0.5


@pytest.mark.parametrize("height_m", [2.0, 3.0, 4.5])
def test_staggered_junctions_22_m_apart_are_two(height_m: float) -> None:
    mission = Mission(finish_after=3)
    flight = Flight(crossroads([0.0, 22.0, 60.0]), mission, config(height_m)).run(90)
    assert flight.kinds.count(EventKind.APPROACHED) == 3
    assert 60 < flight.x < 75


@pytest.mark.parametrize("rise_bias", [-0.4, 0.0])
@pytest.mark.parametrize(
    ("capabilities", "apart_m"),
    [(COPTER, 17.0), (COPTER, 20.0), (ROVER, 21.0), (ROVER, 22.0), (ROVER, 25.0)],
)
def test_a_junction_close_behind_a_turn_is_counted(
    capabilities: Capabilities, apart_m: float, rise_bias: float
) -> None:
    roads = (
        Road((-200.0, 0.0), (200.0, 0.0)),
        Road((0.0, -200.0), (0.0, 200.0)),
        Road((-200.0, apart_m), (200.0, apart_m)),
    )
    plane = Plane(roads, ((0.0, 0.0), (0.0, apart_m)))
    mission = Mission(turns=(Turn(at=1, turn="left"), Turn(at=2, turn="right")), finish_after=2)
    flight = Flight(plane, mission, capabilities=capabilities, rise_bias=rise_bias).run(90)
    assert tuple(flight.kinds) == (*FIRST_TURN[:-1], *FIRST_TURN)
    assert abs(flight.y - apart_m) < 1.5
    assert flight.x > 5


@pytest.mark.parametrize("height_m", [2.0, 3.0, 4.5])
@pytest.mark.parametrize("cruise_mps", [1.5, 3.0, 4.5])
def test_other_heights_and_speeds_turn_within_a_metre(height_m: float, cruise_mps: float) -> None:
    flight = Flight(crossroads([0.0]), LEFT, config(height_m, cruise_mps)).run(80)
    assert tuple(flight.kinds) == FIRST_TURN
    assert turning_error_m(flight) < 1.0
    assert abs(flight.x) < 1.0


@pytest.mark.parametrize("speed_error", [-0.2, 0.2])
@pytest.mark.parametrize("capabilities", [COPTER, SILENT], ids=["telemetry", "none"])
def test_a_speed_error_of_a_fifth_turns_near_the_centre(
    speed_error: float, capabilities: Capabilities
) -> None:
    flight = Flight(
        crossroads([0.0]), LEFT, speed_error=speed_error, capabilities=capabilities
    ).run(80)
    assert tuple(flight.kinds) == FIRST_TURN
    assert turning_error_m(flight) < 1.75
    assert abs(flight.x) < 1.0


@pytest.mark.parametrize("rise_bias", [-0.15, 0.15])
@pytest.mark.parametrize("fall_bias", [-0.15, 0.15])
def test_a_biased_classifier_turns_near_the_centre(rise_bias: float, fall_bias: float) -> None:
    flight = Flight(crossroads([0.0]), LEFT, rise_bias=rise_bias, fall_bias=fall_bias).run(80)
    assert tuple(flight.kinds) == FIRST_TURN
    assert turning_error_m(flight) < 1.75
    assert abs(flight.x) < 1.0


@pytest.mark.parametrize("seed", range(4))
def test_flicker_and_dropped_frames_count_nothing_twice(seed: int) -> None:
    mission = Mission(turns=(Turn(at=2, turn="left"),), finish_after=2)
    flight = Flight(crossroads([0.0, 45.0]), mission, flicker=0.08, drop=0.25, seed=seed).run(90)
    assert [e.count for e in flight.events if e.kind is EventKind.APPROACHED] == [1, 2]
    assert abs(flight.x - 45) < 1.0
    assert flight.y > 5


def test_a_score_that_never_falls_goes_by_its_rise() -> None:
    flight = Flight(crossroads([0.0]), LEFT, stuck=True).run(80)
    assert tuple(flight.kinds) == FIRST_TURN
    assert turning_error_m(flight) < 2.5


@pytest.mark.parametrize("skew_deg", [55.0, 125.0])
def test_a_skewed_arm_is_found_and_aligned_with(skew_deg: float) -> None:
    flight = Flight(crossroads([0.0], skew_deg), LEFT).run(80)
    assert tuple(flight.kinds) == FIRST_TURN
    _, yaw = flight.at(EventKind.LEFT)
    assert abs(math.degrees(yaw) - skew_deg) < 8
    along = math.radians(skew_deg)
    assert abs(flight.x * math.sin(along) - flight.y * math.cos(along)) < 1.5


def test_a_follower_that_tells_no_road_is_aligned_by_its_yaw_rate() -> None:
    flight = Flight(crossroads([0.0]), LEFT, with_road=False).run(80)
    assert tuple(flight.kinds) == FIRST_TURN
    assert abs(flight.x) < 1.0


@pytest.mark.parametrize("skew_deg", [90.0, 60.0, 120.0])
def test_a_rover_turns_on_an_arc(skew_deg: float) -> None:
    low = CameraGeometry(height_m=1.5, pitch_rad=math.radians(12))
    options = NavigatorConfig(camera=low, cruise_mps=2.0)
    flight = Flight(crossroads([0.0], skew_deg), LEFT, options, ROVER)
    while EventKind.LEFT not in flight.kinds and flight.t < 80:
        flight.tick()
        velocity = flight.command
        turning = abs(velocity.yaw_rate_radps)
        assert turning <= velocity.forward_mps / ROVER.minimum_radius_m + 1e-9
    along = math.radians(skew_deg)
    beside = abs(flight.x * math.sin(along) - flight.y * math.cos(along))
    assert tuple(flight.kinds[:5]) == FIRST_TURN[:5]
    assert beside < 1.5


@pytest.mark.parametrize("kind", FIRST_TURN[:5])
@pytest.mark.parametrize("capabilities", [COPTER, SILENT], ids=["telemetry", "none"])
@pytest.mark.parametrize("later_s", [0.0, 0.8])
def test_a_kill_in_any_phase_counts_exactly(
    kind: EventKind, capabilities: Capabilities, later_s: float
) -> None:
    mission = Mission(turns=(Turn(at=1, turn="left"),), finish_after=2)
    plane = crossroads([0.0])
    plane = Plane((*plane.roads, Road((-300.0, 45.0), (300.0, 45.0))), ((0.0, 0.0), (0.0, 45.0)))
    flight = Flight(plane, mission, capabilities=capabilities)
    while kind not in flight.kinds:
        flight.tick()
    end = flight.t + later_s
    while flight.t < end:
        flight.tick()
    flight.kill()
    flight.run(90)
    assert [e.count for e in flight.events if e.kind is EventKind.APPROACHED] == [1, 2]
    assert flight.kinds.count(EventKind.TURN_FINISHED) == 1
    assert flight.kinds[-1] is EventKind.MISSION_FINISHED
    assert abs(flight.x) < 1.5
    assert 50 < flight.y < 62


def test_kills_every_two_seconds_end_with_the_exact_count() -> None:
    mission = Mission(turns=(Turn(at=2, turn="left"),), finish_after=2)
    flight = Flight(crossroads([0.0, 45.0]), mission)
    for _ in range(40):
        flight.run(2.0)
        if flight.kinds[-1:] == [EventKind.MISSION_FINISHED]:
            break
        flight.kill(0.5)
    assert [e.count for e in flight.events if e.kind is EventKind.APPROACHED] == [1, 2]
    assert flight.kinds[-1] is EventKind.MISSION_FINISHED
    assert [event.index for event in flight.events] == list(range(len(flight.events)))
    assert abs(flight.x - 45) < 1.5


def test_a_finished_mission_holds() -> None:
    flight = Flight(crossroads([0.0]), LEFT).run(60)
    flight.tick()
    assert flight.decision is not None
    assert flight.decision.state.phase is Phase.FINISHED
    assert flight.decision.velocity.forward_mps == 0.0
    assert flight.decision.state.next_turn is None


def test_no_road_after_the_turn_holds_with_a_reason() -> None:
    plane = Plane((Road((-200.0, 0.0), (300.0, 0.0)),), ((0.0, 0.0),))
    flight = Flight(plane, LEFT).run(60)
    assert flight.decision is not None
    assert flight.decision.state.phase is Phase.ALIGNING
    assert "no road" in flight.decision.state.reason
    assert flight.decision.velocity.yaw_rate_radps == 0.0


def test_a_turn_in_place_that_sees_its_road_early_does_not_swing_past_it() -> None:
    flight = Flight(crossroads([0.0], 45.0), LEFT)
    while EventKind.TURN_FINISHED not in flight.kinds and flight.t < 60:
        flight.tick()
    assert EventKind.TURN_FINISHED in flight.kinds
    assert abs(flight.w) <= NavigatorConfig().turn.settled_radps


def test_a_road_lost_behind_the_turn_is_searched_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    flight = Flight(crossroads([0.0]), LEFT)
    while EventKind.TURN_FINISHED not in flight.kinds and flight.t < 60:
        flight.tick()

    with monkeypatch.context() as patched:
        patched.setattr(flight, "follow", unseen)
        flight.run(NavigatorConfig().turn.lost_s + 0.5)
    assert flight.navigator.progress.phase is Phase.ALIGNING
    flight.run(60)
    again = (EventKind.TURN_STARTED, EventKind.TURN_FINISHED)
    assert tuple(flight.kinds) == (*FIRST_TURN[:4], *again, *FIRST_TURN[4:])
    assert flight.y > 5


def test_a_rover_that_never_sees_its_road_again_stops_soon(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    flight = Flight(crossroads([0.0]), LEFT, NavigatorConfig(cruise_mps=2.0), ROVER)
    while EventKind.TURN_FINISHED not in flight.kinds and flight.t < 60:
        flight.tick()
    x, y = flight.x, flight.y
    monkeypatch.setattr(flight, "follow", unseen)
    flight.run(60)
    config = NavigatorConfig().turn
    assert math.hypot(flight.x - x, flight.y - y) < config.align_m + 2.5
    assert flight.command.forward_mps == 0
