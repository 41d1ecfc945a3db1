"""Which road is the way: straight on behind a junction, behind a turn, after a search in vain."""

import math

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
    Pose,
    RoadCommand,
    RoadSeen,
    RoadSurface,
    Stamp,
    Turn,
    VehicleState,
    Velocity,
)
from juncnet_services.junction_navigation import turning
from juncnet_services.junction_navigation.axis import RoadAxis
from juncnet_services.junction_navigation.config import (
    NavigatorConfig,
    TurnConfig,
)
from juncnet_services.junction_navigation.decision import Decision
from juncnet_services.junction_navigation.inputs import Inputs
from juncnet_services.junction_navigation.navigator import Navigator
from juncnet_services.junction_navigation.plan import JunctionPlan
from juncnet_services.junction_navigation.progress import Junction, Place, Progress, TurnProgress
from juncnet_services.junction_navigation.store import Resumed
from surfaces import roads, surface

BAND = CameraGeometry().band
NOW = 10_000_000_000
STEP = 40_000_000
MODEL = ModelIdentity(name="m", sha256="0" * 64)
STRAIGHT = Mission(finish_after=9)
LEFT = Mission(turns=(Turn(at=1, turn="left"),), finish_after=9)


def stamp(number: int) -> Stamp:
    return Stamp(epoch=1, sequence=number, time_ns=NOW + number * STEP, clock="c")


def vehicle(number: int, x_m: float = 0.0, yaw_rad: float = 0.0) -> VehicleState:
    return VehicleState(
        at=stamp(number),
        capabilities=Capabilities(turns_in_place=True, telemetry=True),
        yaw_rad=yaw_rad,
        velocity=Velocity(forward_mps=2.0),
        pose=Pose(x_m=x_m, y_m=0.0),
        output=Output.PIPELINE,
    )


def road(
    number: int, towards_rad: float, ends_m: float | None = None, confidence: float = 0.5
) -> RoadCommand:
    """A follower's road whose middle lies 6 m away at an angle; its steering is gentle."""
    ahead, aside = math.cos(towards_rad), math.sin(towards_rad)
    seen = RoadSeen(
        offset_m=0.0,
        heading_rad=towards_rad,
        width_m=6.0,
        centre=((2 * ahead, 2 * aside), (6 * ahead, 6 * aside), (9 * ahead, 9 * aside)),
        ends_m=ends_m,
    )
    return RoadCommand(
        header=stamp(number),
        source="road_following",
        velocity=Velocity(forward_mps=3.0, yaw_rate_radps=0.02),
        confidence=confidence,
        road=seen,
    )


def navigator(state: Progress) -> Navigator:
    return Navigator(NavigatorConfig(), state.mission, "f", Resumed(state, ""))


def decide(flown: Navigator, seen: RoadCommand, state: VehicleState) -> Decision:
    header = seen.header
    probabilities = {"none": 0.9, "junction": 0.1}
    scored = JunctionScore(header=header, model=MODEL, probabilities=probabilities)
    return flown.step(Instant(header.time_ns, "c"), scored, seen, state)


def step(flown: Navigator, number: int, seen: RoadCommand, yaw_rad: float = 0.0) -> Velocity:
    decision = decide(flown, seen, vehicle(number, yaw_rad=yaw_rad))
    assert decision.velocity is not None
    return decision.velocity


def crossing(mission: Mission = STRAIGHT) -> Progress:
    """A robot on a junction's surface, a metre behind its mouth."""
    junction = Junction(rise_m=0.0, fall_m=BAND.d_far_m - BAND.d_near_m, axis_rad=0.0)
    return Progress(
        flight="f",
        configured=mission,
        mission=mission,
        count=1,
        phase=Phase.CROSSING,
        junction=junction,
        axis_rad=0.0,
        odometer_m=BAND.d_far_m + 1.0,
    )


@pytest.mark.parametrize(
    ("towards_deg", "ends_m", "turned"),
    [(-30.0, 9.0, True), (-30.0, None, False), (-60.0, 9.0, False)],
)
def test_the_way_on_bends_where_the_surface_ends_ahead(
    towards_deg: float, ends_m: float | None, turned: bool
) -> None:
    """A road that the follower is not certain of is taken if there is no other way on."""
    flown, wanted = navigator(crossing()), Velocity()
    for number in range(1, 16):
        seen_at = None if ends_m is None else ends_m - 0.08 * number
        wanted = step(flown, number, road(number, math.radians(towards_deg), seen_at))
    assert flown.progress.phase is Phase.CROSSING
    assert (wanted.yaw_rate_radps < -0.3) is turned
    assert (wanted.yaw_rate_radps == pytest.approx(0.0)) is not turned


def test_a_junction_is_crossed_to_the_arm_that_the_map_shows() -> None:
    """Whatever line a follower is sure of: first of another arm, then of the one straight on."""
    flown, wanted = navigator(crossing()), Velocity()
    arms = surface(roads(180, 25, -60))
    for number in range(1, 16):
        line = road(number, math.radians(-60), confidence=1.0)
        wanted = step(flown, number, line.model_copy(update={"surface": arms}))
    assert wanted.yaw_rate_radps > 0.3
    assert flown.progress.axis_rad == pytest.approx(math.radians(25), abs=0.06)
    flown.progress.odometer_m += 6.0
    for number in range(16, 20):
        line = road(number, math.radians(25), confidence=1.0)
        wanted = step(flown, number, line.model_copy(update={"surface": arms}))
    assert 0 < wanted.yaw_rate_radps < 0.02, "the follower steers, slower"
    assert flown.progress.phase is Phase.CROSSING


@pytest.mark.parametrize(("leads_deg", "turned"), [(30.0, True), (-12.0, False)])
def test_a_line_that_bends_into_another_arm_is_no_way_on(leads_deg: float, turned: bool) -> None:
    """It begins on the robot's road and ends in an arm 60 degrees aside, its middle between."""
    flown, wanted = navigator(crossing()), Velocity()
    leads, line = math.radians(leads_deg), ((2.5, -0.2), (4.8, 0.8), (6.3, 2.3), (7.9, 4.7))
    for number in range(1, 16):
        seen = road(number, 0.0, 9.0 - 0.08 * number, confidence=0.7)
        assert seen.road is not None
        bent = seen.road.model_copy(update={"heading_rad": leads, "centre": line})
        wanted = step(flown, number, seen.model_copy(update={"road": bent}))
    assert flown.progress.phase is Phase.CROSSING
    assert (wanted.yaw_rate_radps > 0.3) is turned


@pytest.mark.parametrize(
    ("towards_deg", "leads_deg", "ends_m", "taken"),
    [
        (-15.0, -10.0, None, True),
        (-15.0, -29.0, None, False),
        (-29.0, -10.0, None, False),
        (-29.0, -10.0, 25.0, True),
    ],
)
def test_a_road_that_lies_or_leads_aside_is_an_arm(
    towards_deg: float, leads_deg: float, ends_m: float | None, taken: bool
) -> None:
    """Of two arms left and right of straight on, the line bends towards one; both are near."""
    state = crossing()
    state.odometer_m += 4.0
    if state.junction is not None and ends_m is not None:
        state.junction.end = Place(at_m=state.odometer_m + ends_m, weight=40.0)
    flown = navigator(state)
    for number in range(1, 8):
        seen = road(number, math.radians(towards_deg), confidence=0.8)
        assert seen.road is not None
        leads = seen.road.model_copy(update={"heading_rad": math.radians(leads_deg)})
        step(flown, number, seen.model_copy(update={"road": leads}))
    assert flown.progress.phase is Phase.CROSSING
    assert state.junction is not None
    assert (state.junction.way is not None) is taken


@pytest.mark.parametrize(("bends_deg", "followed"), [(12.0, True), (40.0, False)])
def test_the_way_on_does_not_bend_like_another_arm(bends_deg: float, followed: bool) -> None:
    """A line that was sure of the way straight on is drawn to an arm beside it as that nears."""
    state = crossing()
    state.odometer_m += 4.0
    flown = navigator(state)
    step(flown, 1, road(1, 0.0, confidence=0.8))
    wanted = Velocity()
    for number in range(2, 12):
        wanted = step(flown, number, road(number, math.radians(bends_deg), confidence=0.5))
    assert flown.progress.phase is Phase.CROSSING
    assert (wanted.yaw_rate_radps == pytest.approx(0.0)) is not followed


def test_a_robot_looks_around_before_it_leaves_the_surface() -> None:
    flown, ends_m = navigator(crossing()), 6.5
    for number in range(1, 40):
        ends_m = 6.5 - 0.08 * number
        step(flown, number, road(number, math.radians(70.0), ends_m, confidence=0.2))
        if flown.progress.phase is not Phase.CROSSING:
            break
    assert flown.progress.phase is Phase.ALIGNING
    assert ends_m >= NavigatorConfig().end_before_m - 0.6


def test_no_direction_is_learned_from_a_side_arm_of_a_junction_to_be_crossed() -> None:
    for mission, learned in ((STRAIGHT, False), (LEFT, True)):
        state = crossing(mission)
        state.phase, state.odometer_m = Phase.APPROACHING, BAND.d_far_m - 4.0
        flown = navigator(state)
        for number in range(1, 6):
            step(flown, number, road(number, 0.3, confidence=1.0))
        assert (abs(flown.progress.heading_rad) > 0.05) is learned


def turned(turn: Turn, aligning_s: float = 0.0) -> TurnProgress:
    nominal_rad = turning.angle_rad(turn)
    return TurnProgress(turn=turn, nominal_rad=nominal_rad, aligning_s=aligning_s)


@pytest.mark.parametrize(
    ("turn", "direction_deg", "astray"),
    [
        (Turn(at=1, turn="left"), 90.0, False),
        (Turn(at=1, turn="left"), 40.0, False),
        (Turn(at=1, turn="left"), 10.0, True),
        (Turn(at=1, angle_deg=-65.0), -25.0, False),
        (Turn(at=1, angle_deg=-65.0), 0.0, True),
    ],
)
def test_another_road_than_that_turned_into_is_told(
    turn: Turn, direction_deg: float, astray: bool
) -> None:
    seen = road(1, math.radians(direction_deg) - 0.5)
    assert turning.is_astray(seen, 0.0, 0.5, turned(turn), TurnConfig()) is astray


@pytest.mark.parametrize(("driven_m", "astray"), [(1.0, True), (8.0, False)])
def test_the_road_behind_a_turn_may_bend_as_the_robot_goes_on(
    driven_m: float, astray: bool
) -> None:
    turn = turned(LEFT.turns[0]).model_copy(update={"ended_m": 20.0})
    seen = road(1, math.radians(10.0) - 0.5)
    assert turning.is_astray(seen, 20.0 + driven_m, 0.5, turn, TurnConfig()) is astray


def test_a_robot_drawn_to_another_road_behind_its_turn_searches_its_own() -> None:
    state = crossing(LEFT)
    state.phase, state.turned = Phase.FOLLOWING, turned(LEFT.turns[0])
    state.axis_rad, state.leave_m = math.pi / 2, state.odometer_m + 9.0
    flown = navigator(state)
    assert step(flown, 1, road(1, 0.0, confidence=1.0), math.pi / 2).forward_mps > 0
    number, config = 2, NavigatorConfig().turn
    while flown.progress.phase is Phase.FOLLOWING and number < 100:
        assert step(flown, number, road(number, -1.5, confidence=1.0), math.pi / 2) == Velocity()
        number += 1
        if number * STEP / 1e9 > config.lost_s + 0.1:
            break
    step(flown, number, road(number, -1.5, confidence=1.0), math.pi / 2)
    assert flown.progress.phase is Phase.ALIGNING


@pytest.mark.parametrize(("offset_m", "learned"), [(1.0, True), (4.0, False)])
def test_a_road_that_the_robot_is_not_on_is_not_its_axis(offset_m: float, learned: bool) -> None:
    state = Progress(flight="f", configured=LEFT, mission=LEFT)
    state.phase, state.count, state.axis_rad = Phase.APPROACHING, 1, 0.0
    state.junction = Junction(rise_m=0.0)
    flown = navigator(state)
    seen = road(1, 0.3, confidence=1.0)
    assert seen.road is not None
    beside = seen.road.model_copy(update={"offset_m": offset_m})
    for number in range(1, 20):
        step(
            flown, number, road(number, 0.3).model_copy(update={"road": beside, "confidence": 1.0})
        )
    assert flown.progress.axis_rad is not None
    assert (flown.progress.axis_rad > 0.05) is learned


def test_the_axis_of_a_bend_does_not_lag_behind_it() -> None:
    """A robot drives 10 m of a bend: its held direction is the road's where it is then."""
    state = Progress(flight="f", configured=LEFT, mission=LEFT, phase=Phase.FOLLOWING)
    config = NavigatorConfig()
    inputs, plan = Inputs(config, None), JunctionPlan(config, state)
    axis, radius_m, speed_mps, step_s = RoadAxis(config, state, plan, inputs), 12.0, 2.0, 0.04
    state.speed_mps, yaw = speed_mps, 0.0
    for number in range(1, 126):
        yaw = speed_mps * number * step_s / radius_m
        seen = RoadSeen(offset_m=0.0, heading_rad=0.0, width_m=6.0, curvature_1pm=1 / radius_m)
        axis.see(road(number, 0.0).model_copy(update={"road": seen}), yaw, step_s)
    assert state.axis_rad == pytest.approx(yaw, abs=0.01)


def test_a_line_taken_for_the_road_before_a_junction_is_forgotten_on_the_way_to_it() -> None:
    """For 1.6 s it led 40 degrees aside; the robot went on along its road."""
    flown = navigator(Progress(flight="f", configured=LEFT, mission=LEFT, axis_rad=0.0))
    for number in range(1, 80):
        if number == 41:
            flown.progress.phase, flown.progress.count = Phase.APPROACHING, 1
            flown.progress.junction = Junction(rise_m=0.0)
        step(flown, number, road(number, 0.7 if number < 41 else 0.1, confidence=1.0))
    assert flown.progress.axis_rad == pytest.approx(0.1, abs=0.05)


@pytest.mark.parametrize(
    ("confidence", "towards_rad", "learned"),
    [(1.0, 0.3, True), (0.6, 0.3, False), (1.0, 0.45, False)],
)
def test_before_a_turn_the_road_is_learned_from_views_of_itself_that_are_sure(
    confidence: float, towards_rad: float, learned: bool
) -> None:
    state = crossing(LEFT)
    state.phase, state.odometer_m = Phase.APPROACHING, BAND.d_far_m - 6.0
    flown = navigator(state)
    for number in range(1, 6):
        step(flown, number, road(number, towards_rad, confidence=confidence))
    assert (abs(flown.progress.heading_rad) > 0.05) is learned


def test_a_follower_that_is_never_very_sure_steers_all_the_same() -> None:
    state = crossing(LEFT)
    state.phase, state.odometer_m = Phase.FOLLOWING, 0.0
    state.junction, state.turned = None, None
    flown = navigator(state)
    for number in range(1, 400):
        step(flown, number, road(number, 0.0, confidence=0.5))
    flown.progress.junction = Junction(rise_m=flown.progress.odometer_m)
    flown.progress.phase = Phase.APPROACHING
    wanted = step(flown, 400, road(400, 0.0, confidence=0.5))
    assert wanted.yaw_rate_radps == pytest.approx(0.02, abs=0.001)
    wanted = step(flown, 401, road(401, 0.0, confidence=0.31))
    assert wanted.yaw_rate_radps == pytest.approx(0.0, abs=0.001)


CAR = Capabilities(turns_in_place=False, telemetry=True, minimum_radius_m=2.5)


def turning_left(started_m: float) -> Progress:
    """A car on an arc to the left that began at an odometer reading, relative to where it is."""
    state = crossing(LEFT)
    state.phase = Phase.TURNING
    state.turn = TurnProgress(
        turn=LEFT.turns[0],
        nominal_rad=math.pi / 2,
        radius_m=3.0,
        started_m=state.odometer_m + started_m,
    )
    return state


def car(number: int, yaw_rad: float = 0.0) -> VehicleState:
    return vehicle(number, yaw_rad=yaw_rad).model_copy(update={"capabilities": CAR})


@pytest.mark.parametrize(
    ("started_m", "towards_rad", "taken"),
    [
        (-7.0, 0.6, True),
        (-7.0, 0.2, False),
        (-1.0, 0.6, False),
    ],
)
def test_a_car_whose_arc_is_held_back_takes_the_road_that_leads_less_aside(
    started_m: float, towards_rad: float, taken: bool
) -> None:
    """The surface keeps it on the road, whose follower is sure of it; it is no way straight on."""
    flown = navigator(turning_left(started_m))
    for number in range(1, 12):
        yaw_rad = towards_rad if number > 1 else 0.0
        decide(flown, road(number, 0.0, confidence=1.0), car(number, yaw_rad))
    assert (flown.progress.phase is Phase.FOLLOWING) is taken


def test_a_car_that_has_left_the_road_holds() -> None:
    flown = navigator(turning_left(0.0))
    bare = RoadSurface(x_m=-1, y_m=7, cell_m=0.25, rows=("." * 57,) * 37)
    seen = road(1, 0.0, confidence=0.0).model_copy(update={"surface": bare})
    decision = decide(flown, seen, car(1))
    assert decision.velocity == Velocity()
    assert "has left the road" in decision.state.reason
