"""Turns: where they begin, where their road is sought, when it is in sight."""

import math

import pytest

from juncnet.messages import Capabilities, RoadCommand, RoadSeen, Stamp, Turn, Velocity
from juncnet_services.junction_navigation import turning
from juncnet_services.junction_navigation.config import NavigatorConfig, TurnConfig
from juncnet_services.junction_navigation.progress import TurnProgress
from juncnet_services.junction_navigation.road_sight import RoadSight


def test_an_arc_of_a_right_angle_begins_a_radius_before_the_corner() -> None:
    assert turning.tangent_m(3.0, math.pi / 2) == pytest.approx(3.0)
    assert turning.tangent_m(0.0, math.pi / 2) == 0.0
    rover = Capabilities(minimum_radius_m=4.0)
    assert turning.arc_radius_m(TurnConfig(), rover) == pytest.approx(4.4)
    assert turning.arc_radius_m(TurnConfig(), Capabilities(turns_in_place=True)) == 0.0


def test_the_search_goes_on_then_back_then_on_again() -> None:
    config = TurnConfig(settle_s=1.0, sweep_radps=0.5)
    seen = [turning.sweep_rad(t, -1.0, 0.5, config) for t in (0.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.5)]
    assert seen == [0.0, *map(pytest.approx, (-0.5, 0.0, 0.5, 0.0, -0.5, 0.25))]


def test_the_way_straight_on_is_no_turns_road() -> None:
    config = TurnConfig()
    slight = Turn(at=1, angle_deg=40.0)
    middle, within = turning.search_arc(slight, 0.0, config)
    assert middle == 0.0
    sight = RoadSight(NavigatorConfig())
    for _ in range(5):  # the road straight on, sought 40 degrees to its left
        sight.look(0.0, 0.0, math.radians(40), within)
    assert sight.agreed_rad is None
    for _ in range(5):
        sight.look(0.0, 0.5, math.radians(40), within)
    assert sight.agreed_rad == pytest.approx(0.5)
    straight, right = (Turn(at=1, turn=turn) for turn in ("straight", "right"))
    assert turning.search_arc(straight, 0.0, config) == (0.0, config.search_rad)
    assert turning.search_arc(right, 0.0, config) == (0.0, turning.NAMED_RAD)
    assert turning.search_arc(right, 13.0, config) == (0.0, config.search_rad), "in the end"


@pytest.mark.parametrize(("angle_deg", "least_rad"), [(90.0, 0.5), (-90.0, 0.5), (40.0, 0.349)])
def test_an_arc_that_was_held_back_leads_less_aside_but_not_straight_on(
    angle_deg: float, least_rad: float
) -> None:
    config, turn = TurnConfig(), Turn(at=1, angle_deg=angle_deg)
    outwards = math.copysign(1.0, angle_deg)
    _, near = turning.search_arc(turn, 0.0, config)
    middle, within = turning.search_arc(turn, 0.0, config, held_back=True)
    nominal = math.radians(angle_deg)
    assert (nominal + middle) * outwards - within == pytest.approx(least_rad, abs=1e-3)
    assert middle * outwards + within == pytest.approx(near)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_arc_is_held_back_once_it_is_longer_than_it_turned_the_robot(side: float) -> None:
    turn = Turn(at=1, turn="left" if side > 0 else "right")
    arc = TurnProgress(turn=turn, nominal_rad=2.0, radius_m=3.0, started_m=10.0)
    for turned_rad in (0.0, 0.8, math.pi / 2):
        yaw, end_m = 2.0 - side * (math.pi / 2 - turned_rad), 10.0 + 3.0 * turned_rad
        assert not turning.is_held_back(arc, end_m + turning.LONGER_M - 0.1, yaw)
        assert turning.is_held_back(arc, end_m + turning.LONGER_M + 0.1, yaw)
    in_place = arc.model_copy(update={"radius_m": 0.0})
    assert not turning.is_held_back(in_place, 100.0, 2.0)


@pytest.mark.parametrize("angle_deg", [-70.0, 70.0])
def test_a_search_in_vain_goes_on_away_from_the_way_straight_on(angle_deg: float) -> None:
    config, turn = TurnConfig(), Turn(at=1, angle_deg=angle_deg)
    middle, within = turning.search_arc(turn, 8.0, config)
    outwards = math.copysign(1.0, angle_deg)
    assert middle * outwards + within == pytest.approx(config.search_rad)
    assert middle * outwards - within == pytest.approx(-math.radians(35))


def test_a_long_search_ends_with_every_road_near_the_angle() -> None:
    config, turn = TurnConfig(), Turn(at=1, angle_deg=45.0)
    assert turning.search_arc(turn, 0.0, config) == (0.0, math.radians(22.5))
    middle, within = turning.search_arc(turn, 6.0, config)
    assert middle - within == pytest.approx(-math.radians(22.5))
    assert turning.search_arc(turn, 12.0, config) == (0.0, config.search_rad)
    assert config.timeout_s > 12.0


@pytest.mark.parametrize(("in_place", "expected_deg"), [(True, 45.0), (False, -10.0)])
def test_before_its_road_a_robot_goes_by_the_part_in_view(
    in_place: bool, expected_deg: float
) -> None:
    """The line's direction beside the robot is a guess there."""
    seen = RoadSeen(
        offset_m=1.0,
        heading_rad=math.radians(-10.0),
        width_m=6.0,
        centre=((3.0, 1.0), (5.0, 2.0), (8.0, 6.0)),
    )
    command = RoadCommand(
        header=Stamp(epoch=1, sequence=1, time_ns=1, clock="c"),
        source="road_following",
        velocity=Velocity(forward_mps=3.0),
        confidence=0.9,
        road=seen,
    )
    heading = turning.seen_heading_rad(command, in_place)
    assert heading == pytest.approx(math.radians(expected_deg))


def test_a_view_that_flickers_after_it_was_agreed_on_still_is() -> None:
    sight = RoadSight(NavigatorConfig(turn=TurnConfig(frames=3)))
    agreed: list[bool] = []
    for heading in (0.0, 0.0, 0.0, 0.0, 0.0, None, 0.0, None, None):
        sight.look(heading, 1.5, 1.57, 0.8)
        agreed.append(sight.aligned)
    assert agreed == [False, False, True, True, True, True, True, False, False]


def test_agreement_takes_frames_in_a_row() -> None:
    sight = RoadSight(NavigatorConfig(turn=TurnConfig(frames=3)))
    for heading in (0.0, 0.0, None, 0.0, 0.0):
        sight.look(heading, 1.5, 1.57, 0.8)
    assert sight.agreed_rad is None
    sight.look(0.0, 1.5, 1.57, 0.8)
    assert sight.agreed_rad == pytest.approx(1.5)
    assert sight.aligned
    sight.look(0.0, 0.0, 1.57, 0.8)
    assert sight.agreed_rad is None
