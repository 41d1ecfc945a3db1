"""The arms of junctions, read off maps of the surface drawn by hand."""

import math

import numpy as np
import pytest

from juncnet.messages import RoadCommand, RoadSeen, Stamp, Turn, Velocity
from juncnet_services.junction_navigation import turning
from juncnet_services.junction_navigation.arms import Arm, Arms, Sector, arms
from juncnet_services.junction_navigation.config import NavigatorConfig
from juncnet_services.junction_navigation.progress import TurnProgress
from juncnet_services.junction_navigation.road_sight import RoadSight
from surfaces import Mark, hidden, roads, surface


def bearings(found: Arms) -> list[float]:
    return sorted(
        math.degrees(math.remainder(arm.bearing_rad(arm.right_rad), 2 * math.pi))
        for arm in found.arms
    )


@pytest.mark.parametrize(
    "degrees", [(180, 0, 90, -90), (180, 43, -75), (170, 120, 30), (-175, -60)]
)
def test_every_road_that_leads_away_is_an_arm(degrees: tuple[float, ...]) -> None:
    found = bearings(arms(surface(roads(*degrees))))
    expected = sorted(math.degrees(math.remainder(math.radians(d), 2 * math.pi)) for d in degrees)
    assert np.abs(np.array(found) - expected).max() <= 3


def test_a_robot_beside_the_middle_sees_the_same_arms() -> None:
    found = arms(surface(roads(180, 0, 90, -90, centre=(1.5, -1.0))))
    assert np.abs(np.array(bearings(found)) - [-173, -80, -7, 80]).max() <= 4
    assert len(found.arms) == 4


def test_surface_that_grass_parts_from_the_robot_is_no_arm() -> None:
    crossing = roads(180, 0)

    def mark(x: float, y: float) -> str:
        return "#" if 5 <= y <= 10 and abs(x) <= 3 else crossing(x, y)

    assert np.abs(np.abs(bearings(arms(surface(mark)))) - [0, 180]).max() <= 3


def test_specks_are_neither_arms_nor_do_they_part_one() -> None:
    crossing = roads(180, 0, 90)

    def mark(x: float, y: float) -> str:
        if abs(x) < 0.2 and y > 6:
            return "."
        return "#" if abs(x - 1) < 0.5 and y < 0 else crossing(x, y)

    found = arms(surface(mark))
    assert len(found.arms) == 3


@pytest.mark.parametrize("wanted_deg", [60.0, 90.0, 120.0])
def test_the_arm_nearest_to_what_is_wanted_is_chosen(wanted_deg: float) -> None:
    found = arms(surface(roads(180, 0, 105)))
    chosen = found.towards(Sector(math.radians(wanted_deg), 0.3, 2.7))
    assert chosen == pytest.approx((math.radians(105), 0.22), abs=0.06)
    assert found.towards(Sector(math.radians(wanted_deg), -0.5, 1.0)) != chosen, (
        "out of these bounds"
    )
    assert found.towards(Sector(math.radians(wanted_deg), 2.2, 2.7)) is None


def test_what_was_not_seen_may_hide_a_nearer_arm() -> None:
    mark = roads(180, 43, -75)
    wanted = Sector(math.radians(90), 0.3, 2.7)
    assert arms(surface(mark)).towards(wanted) == pytest.approx((0.75, 0.22), abs=0.06)
    assert arms(surface(hidden(mark, 80, 130))).towards(wanted) is None
    far_side = arms(surface(hidden(mark, 150, 180)))
    assert far_side.towards(wanted) == pytest.approx((0.75, 0.22), abs=0.06)


def test_a_plaza_is_aimed_at_where_it_is_wanted_but_inside_its_edges() -> None:
    plaza = Arm(right_rad=0.5, left_rad=2.0)
    assert plaza.bearing_rad(1.2) == pytest.approx(1.2)
    assert plaza.bearing_rad(0.0) == pytest.approx(1.0)
    assert plaza.bearing_rad(math.pi) == pytest.approx(1.5)
    assert plaza.room_rad(1.2) > plaza.room_rad(1.5) == pytest.approx(0.3)
    assert Arm(right_rad=0.5, left_rad=0.9).bearing_rad(2.0) == pytest.approx(0.7)


def command(mark: Mark, bearing_deg: float, confidence: float = 1.0) -> RoadCommand:
    """What a follower tells that sees a line towards a bearing."""
    direction = math.radians(bearing_deg)
    centre = tuple((d * math.cos(direction), d * math.sin(direction)) for d in (4.0, 8.0, 12.0))
    return RoadCommand(
        header=Stamp(epoch=1, sequence=1, time_ns=1, clock="c"),
        source="road_following",
        velocity=Velocity(forward_mps=3.0),
        confidence=confidence,
        road=RoadSeen(offset_m=0, heading_rad=direction, width_m=6, centre=centre),
        surface=surface(mark),
    )


def test_a_turn_on_the_spot_ends_on_an_arm_that_leads_little_aside() -> None:
    turn = TurnProgress(turn=Turn(at=1, turn="left"), nominal_rad=math.pi / 2)
    sight = RoadSight(NavigatorConfig())
    for _ in range(3):
        sight.see(command(roads(180, 43, -75), 43), 0.0, turn)
    assert sight.agreed_rad == pytest.approx(math.radians(43), abs=0.06)
    assert turn.arm_rad == sight.agreed_rad
    assert not sight.aligned, "the robot still looks straight on"
    yaw = math.radians(43)
    here = roads(180 - 43, 0, -75 - 43)
    for _ in range(3):
        sight.see(command(here, 30), yaw, turn)
    assert not sight.aligned, "the follower's line leads past the arm"
    for _ in range(3):
        sight.see(command(here, 3), yaw, turn)
    assert sight.aligned


@pytest.mark.parametrize("sign", [1, -1], ids=["left", "right"])
@pytest.mark.parametrize(
    ("arm_deg", "held_back", "unseen_deg", "taken"),
    [
        (12, True, None, True),
        (12, False, None, False),
        (12, True, (30, 150), False),
        (-25, True, None, False),
        (178, True, None, False),
    ],
    ids=["held back", "not yet", "who knows", "the other side", "the way back"],
)
def test_what_leads_little_aside_is_left_or_right_where_an_arc_was_held_back(
    arm_deg: float,
    held_back: bool,
    unseen_deg: tuple[float, float] | None,
    taken: bool,
    sign: int,
) -> None:
    turn = TurnProgress(
        turn=Turn.model_validate({"at": 1, "turn": "left" if sign == 1 else "right"}),
        nominal_rad=sign * math.pi / 2,
        radius_m=3.0,
        held_back=held_back,
    )
    mark = roads(178 * sign, arm_deg * sign)
    if unseen_deg is not None:
        mark = hidden(mark, *sorted(sign * angle for angle in unseen_deg))
    sight = RoadSight(NavigatorConfig())
    for _ in range(4):
        sight.see(command(mark, arm_deg * sign), 0.0, turn)
    assert (turn.arm_rad is not None) is taken


def test_behind_a_turn_the_road_of_its_arm_is_followed_and_no_other() -> None:
    turn = TurnProgress(turn=Turn(at=1, turn="left"), nominal_rad=1.57, arm_rad=0.75, ended_m=10.0)
    config = NavigatorConfig().turn
    nothing = roads(0)
    for bearing_deg, at_m, astray in ((0, 10.0, False), (-60, 10.0, True), (-60, 22.0, False)):
        line = command(nothing, bearing_deg)
        assert turning.is_astray(line, at_m, 0.75, turn, config) is astray
