"""Arcs of car-like vehicles over maps of the road's surface drawn by hand."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from juncnet.clocks import Instant
from juncnet.messages import (
    Capabilities,
    MessageError,
    Mission,
    RoadCommand,
    RoadSurface,
    Stamp,
    Turn,
    Velocity,
)
from juncnet_services.junction_navigation.arcs import Arcs, clear_m
from juncnet_services.junction_navigation.config import NavigatorConfig
from juncnet_services.junction_navigation.helm import Helm
from juncnet_services.junction_navigation.inputs import Inputs
from juncnet_services.junction_navigation.plan import JunctionPlan
from juncnet_services.junction_navigation.progress import Progress, TurnProgress

CELL_M, ROOM_M, RADIUS_M = 0.25, 0.4, 3.0
LEFT_RAD = math.pi / 2


def surface(road: Callable[[float, float], bool]) -> RoadSurface:
    """A map of 12 x 14 m of what `road` says at (x, y)."""
    rows = tuple(
        "".join("#" if road(CELL_M * i - 1, 7 - CELL_M * j) else "." for j in range(57))
        for i in range(49)
    )
    return RoadSurface(x_m=-1, y_m=7, cell_m=CELL_M, rows=rows)


def arm(ahead_m: float, width_m: float = 5.0, straight_on: bool = True) -> RoadSurface:
    """A road of 6 m along x with an arm to the left whose middle is `ahead_m` ahead."""

    def road(x: float, y: float) -> bool:
        on_arm = y > 0 and abs(x - ahead_m) <= width_m / 2
        return on_arm or (abs(y) <= 3 and (straight_on or x <= ahead_m + width_m / 2))

    return surface(road)


def arcs(seen: RoadSurface | None) -> Arcs:
    return Arcs(seen, ROOM_M, 1 / 2.5)


@pytest.mark.parametrize("curvature", [-0.4, -0.2, 0.1, 0.25])
def test_an_arc_leaves_a_straight_road_where_geometry_says(curvature: float) -> None:
    straight = surface(lambda x, y: abs(y) <= 3)
    found = clear_m(straight, np.array([curvature]), np.array([math.copysign(3, curvature)]), 8, 0)
    expected = math.acos(1 - 3 * abs(curvature)) / abs(curvature)
    assert found[0] == pytest.approx(min(expected, 8), abs=0.45)


def test_a_path_goes_straight_on_behind_its_arc_and_keeps_its_room() -> None:
    seen = arm(ahead_m=3.0)
    curvature, turn = np.array([1 / RADIUS_M]), np.array([LEFT_RAD])
    assert clear_m(seen, curvature, turn, 8, ROOM_M)[0] == 8
    assert clear_m(seen, curvature, turn, 8, 2.7)[0] < 6
    too_little = np.array([LEFT_RAD * 0.6])
    assert clear_m(seen, curvature, too_little, 8, ROOM_M)[0] < 8


def test_what_was_not_seen_stops_no_path() -> None:
    unseen = RoadSurface(x_m=-1, y_m=7, cell_m=CELL_M, rows=(" " * 57,) * 49)
    assert arcs(unseen).on_road(0.3, LEFT_RAD, 0.2) == pytest.approx(0.3)
    assert not arcs(unseen).last_chance(LEFT_RAD, 0.2, RADIUS_M)


def test_the_wanted_arc_is_driven_where_it_is_on_the_road() -> None:
    wanted = 1 / RADIUS_M
    assert arcs(arm(ahead_m=3.0)).on_road(wanted, LEFT_RAD, 0.2) == wanted
    assert arcs(None).on_road(wanted, LEFT_RAD, 0.2) == wanted


def test_a_turn_that_began_too_early_goes_straighter_and_one_too_late_tighter() -> None:
    wanted = 1 / RADIUS_M
    early = arcs(arm(ahead_m=6.5)).on_road(wanted, LEFT_RAD, 0.2)
    late = arcs(arm(ahead_m=0.8, straight_on=False)).on_road(wanted, LEFT_RAD, 0.2)
    assert 0 <= early <= 0.28 < wanted
    assert late > wanted


def test_no_arc_is_driven_against_a_turn_that_is_still_to_be_made() -> None:
    """The road is seen to go on to the right only: a shadow hides the left."""
    right = surface(lambda x, y: abs(y + 0.12 * x * x) <= 2)
    assert arcs(right).on_road(1 / RADIUS_M, LEFT_RAD, 0.2) >= 0
    assert arcs(right).on_road(0.1, 0.2, 0.2) < -0.1, "where little is left, the road is kept"


def test_where_every_path_leaves_the_road_the_longest_is_driven() -> None:
    ends = surface(lambda x, y: x <= 2.5 + 0.2 * y)
    assert arcs(ends).on_road(0.0, 0.0, 0.2) > 0.05


def test_the_last_chance_comes_before_the_arm_is_missed_and_not_long_before() -> None:
    tangent_m = RADIUS_M
    begins = [m for m in np.arange(8, -1, -0.25) if arcs(arm(m)).last_chance(1.6, 0.1, RADIUS_M)]
    assert begins, "never"
    assert tangent_m - 1.5 <= begins[0] <= tangent_m + 0.5
    mirrored = surface(lambda x, y: abs(y) <= 3 or (y < 0 and abs(x - begins[0]) <= 2.5))
    assert arcs(mirrored).last_chance(-1.6, 0.1, RADIUS_M)
    assert not arcs(None).last_chance(1.6, 0.1, RADIUS_M)


def test_a_vehicle_is_off_the_road_where_no_arc_leads_back_onto_it() -> None:
    assert not arcs(None).off_road
    for seen, off_road in (
        (surface(lambda x, y: abs(y) <= 3), False),
        (surface(lambda x, y: x < 0), True),
        (surface(lambda x, y: x > 1.5), False),
        (surface(lambda x, y: x > 2.5), True),
        (surface(lambda x, y: y > 0.5), False),
        (surface(lambda x, y: y > 1.2), True),
    ):
        assert arcs(seen).off_road is off_road
    unseen = RoadSurface(x_m=-1, y_m=7, cell_m=CELL_M, rows=(" " * 57,) * 37)
    assert not arcs(unseen).off_road


def helm(seen: RoadSurface, turns_in_place: bool = False) -> tuple[Helm, Progress]:
    """The helm of a robot on the x axis that is to turn left at the counted junction."""
    config, mission = NavigatorConfig(), Mission(turns=(Turn(at=1, turn="left"),), finish_after=5)
    state = Progress(flight="f", configured=mission, mission=mission, count=1, axis_rad=0.0)
    plan, inputs = JunctionPlan(config, state), Inputs(config)
    plan.capabilities = Capabilities(
        turns_in_place=turns_in_place, minimum_radius_m=0.0 if turns_in_place else 2.5
    )
    assert inputs.accept_road(
        Instant(1, "c"),
        RoadCommand(
            header=Stamp(epoch=1, sequence=1, time_ns=1, clock="c"),
            source=config.road_source,
            velocity=None,
            confidence=0.0,
            surface=seen,
        ),
    )
    return Helm(config, state, plan, inputs), state


@pytest.mark.parametrize("turns_in_place", [False, True])
def test_a_car_is_steered_by_the_surface_and_a_copter_is_not(turns_in_place: bool) -> None:
    radius_m = 0.0 if turns_in_place else RADIUS_M
    turn = TurnProgress(turn=Turn(at=1, turn="left"), nominal_rad=LEFT_RAD, radius_m=radius_m)
    too_early = surface(lambda x, y: abs(y) <= 2 or (y > 0 and abs(x - 8) <= 2.5))
    rates = [
        helm(seen, turns_in_place)[0].yaw_towards(LEFT_RAD, turn).yaw_rate_radps
        for seen in (arm(3.0), too_early)
    ]
    assert rates[0] == pytest.approx(1.0 if turns_in_place else 1.5 / RADIUS_M)
    assert (rates[1] < 0.8 * rates[0]) is not turns_in_place
    assert helm(arm(2.5), turns_in_place)[0].last_chance is not turns_in_place
    bent = surface(lambda x, y: abs(y - 0.06 * x * x) <= 1.5)
    rate = helm(bent, turns_in_place)[0].cross(2.0).yaw_rate_radps
    assert (rate > 0.05) is not turns_in_place


def test_the_last_chance_of_an_arm_is_taken_where_the_way_straight_on_bends_to_its_side() -> None:
    """An arc that misses the arm leads 30 degrees left, onto the way on: that is no left."""

    def both(x: float, y: float) -> bool:
        bend = abs(y - 0.6 * max(x - 4, 0.0)) <= 3
        return bend or (y > 0 and abs(x - 2) <= 2.5)

    assert helm(surface(both))[0].last_chance


def test_a_robot_off_its_heading_comes_back_to_it() -> None:
    steered, state = helm(surface(lambda x, y: True))
    state.yaw_rad = 0.2
    assert steered.cross(2.0) == steered.hold_heading(2.0)
    assert steered.hold_heading(2.0).yaw_rate_radps < -0.2


@pytest.mark.parametrize(
    ("rows", "field"), [(("##", "#"), "surface"), (("#x",), "surface.rows.0"), ((), "surface.rows")]
)
def test_a_malformed_surface_is_refused_by_name(rows: tuple[str, ...], field: str) -> None:
    good = RoadCommand(
        header=Stamp(epoch=1, sequence=1, time_ns=1, clock="c"),
        source="s",
        velocity=Velocity(),
        confidence=1.0,
        surface=RoadSurface(x_m=0, y_m=0, cell_m=0.5, rows=("#. ",)),
    )
    assert RoadCommand.decode(good.encode()[0]) == good
    cells = ",".join(f'"{row}"' for row in rows)
    bad = good.encode()[0].replace(b'"rows":["#. "]', f'"rows":[{cells}]'.encode())
    with pytest.raises(MessageError, match=rf"RoadCommand\.{field}"):
        RoadCommand.decode(bad)
