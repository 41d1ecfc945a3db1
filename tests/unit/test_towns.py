"""Worlds: deterministic, varied, drivable, and nothing stands in the way."""

from itertools import combinations

import numpy as np
import pytest

from juncnet.messages import Mission, Turn
from juncnet.simulation import towns
from juncnet.simulation.roads import (
    RoadNetwork,
    arc_lengths,
    corner,
    map_polylines,
    resample,
    setbacks,
    smallest_radius,
    smooth_curve,
)
from juncnet.simulation.roadside import box_corners
from juncnet.simulation.routes import (
    choose,
    expected_path,
    ideal_time_s,
    plan_mission,
    route_of,
    turn_angle,
)
from juncnet.simulation.truth import GroundTruth
from juncnet.simulation.world import World

SEEDS = range(100, 112)


@pytest.fixture(scope="module", name="worlds")
def _worlds() -> list[World]:
    named = [towns.named_world(name) for name in towns.WORLD_NAMES]
    return named + [towns.random_world(seed) for seed in SEEDS]


def test_same_seed_same_world() -> None:
    a, b = towns.random_world(3), towns.random_world(3)
    assert a.start == b.start
    assert a.trees == b.trees
    assert a.boxes == b.boxes
    assert all(np.array_equal(a.roads[i].centre, b.roads[i].centre) for i in a.roads)
    assert towns.random_world(4).start != a.start


def test_style_changes_the_look_only() -> None:
    style = towns.make_style("withheld", "evening")
    plain, other = towns.random_world(3), towns.random_world(3, style)
    assert other.style == style
    assert other.start == plain.start
    assert all(towns.random_style(seed).palette != "withheld" for seed in range(300))


def test_unknown_name_lists_the_known() -> None:
    with pytest.raises(ValueError, match="crossing_town"):
        towns.named_world("atlantis")


def test_every_world_is_varied(worlds: list[World]) -> None:
    for world in worlds:
        network = RoadNetwork(world)
        kinds = {towns.junction_kind(network, node) for node in network.junctions}
        assert len(kinds) >= 3, world.name
        assert any(towns.is_bend(road) for road in world.roads.values()), world.name


def test_roads_can_be_followed(worlds: list[World]) -> None:
    for world in worlds:
        network = RoadNetwork(world)
        for road in world.roads.values():
            assert 4.0 <= road.width_m <= 8.0
            assert np.hypot(*np.diff(road.centre, axis=0).T).max() <= 0.5 + 1e-9
            assert smallest_radius(road.centre) >= 11.5
            ends = {road.a, road.b}
            if ends <= network.junctions.keys():
                length = network.lengths[road.id]
                assert 22.0 <= length <= 70.0, (world.name, road.id)
                assert length >= 30.0 or "staggered" in {
                    towns.junction_kind(network, node) for node in ends
                }


def test_arms_leave_straight_and_apart(worlds: list[World]) -> None:
    for world in worlds:
        for junction in RoadNetwork(world).junctions.values():
            for a, b in combinations(junction.arms, 2):
                apart = abs((a.heading_rad - b.heading_rad + np.pi) % (2 * np.pi) - np.pi)
                assert apart >= np.radians(50)
            for arm in junction.arms:
                road = world.roads[arm.road]
                out = road.centre if road.a == junction.id else road.centre[::-1]
                at = int(np.searchsorted(arc_lengths(out), 6.0))
                ray = np.array([np.cos(arm.heading_rad), np.sin(arm.heading_rad)])
                assert np.hypot(*(out[at] - out[0] - arc_lengths(out)[at] * ray)) < 0.1


def test_roads_that_do_not_meet_keep_apart(worlds: list[World]) -> None:
    for world in worlds:
        for a, b in combinations(world.roads.values(), 2):
            if {a.a, a.b} & {b.a, b.b}:
                continue
            apart = a.centre[::3, None] - b.centre[None, ::3]
            edge = np.hypot(apart[..., 0], apart[..., 1]).min() - (a.width_m + b.width_m) / 2
            assert edge >= 12.0, (world.name, a.id, b.id)


def test_nothing_stands_in_the_way(worlds: list[World]) -> None:
    for world in worlds:
        truth = GroundTruth(world)
        for road in world.roads.values():
            left = np.gradient(road.centre, axis=0)[:, ::-1] * (-1, 1)
            left /= np.hypot(*left.T)[:, None]
            for side in (-1.2, 0.0, 1.2):
                for x, y in (road.centre + side * left)[::4]:
                    assert not truth.collides(float(x), float(y)), (world.name, road.id)
        assert all(path.width_m < 2.2 for path in world.paths)


def test_missions_turn_left_right_and_straight(worlds: list[World]) -> None:
    for world in worlds:
        network = RoadNetwork(world)
        for junctions in (4, 5, 6):
            route = plan_mission(world, 7, junctions)
            assert route.mission.finish_after == junctions
            assert len(route.path) == junctions + 1
            assert expected_path(world, route.mission) == route.path
            assert route_of(world, route.mission) == route
            angles = [
                turn_angle(network, a, b) for a, b in zip(route.path, route.path[1:], strict=False)
            ]
            assert min(angles) < np.radians(-40)
            assert max(angles) > np.radians(40)
            assert min(map(abs, angles)) < np.radians(40)
            assert route.length_m > 30.0 * junctions


def test_start_leaves_room_before_the_first_junction(worlds: list[World]) -> None:
    for world in worlds:
        start = world.start
        ahead = GroundTruth(world).mouth_ahead(start.x_m, start.y_m, start.yaw_rad)
        assert ahead is not None
        assert ahead[1] == start.towards
        assert ahead[0] >= 24.5


def test_mission_without_such_a_way_is_refused() -> None:
    world = towns.random_world(3)
    mission = Mission(turns=(Turn(at=1, angle_deg=180),), finish_after=1)
    with pytest.raises(ValueError, match="junction 1"):
        expected_path(world, mission)
    with pytest.raises(ValueError, match="never finishes"):
        expected_path(world, Mission())


def test_turns_mean_the_nearest_arm() -> None:
    angles = {10: np.radians(60), 11: np.radians(100), 12: np.radians(-5)}
    assert choose(angles, Turn(at=1, turn="left")) == 11
    assert choose(angles, Turn(at=1, angle_deg=55)) == 10
    assert choose(angles, Turn(at=1, turn="straight")) == 12
    assert choose(angles, Turn(at=1, turn="right")) is None


def test_ideal_time() -> None:
    assert ideal_time_s(30.0, 3.0, 2, np.pi / 2) == pytest.approx(12.0)


def test_right_angled_corner() -> None:
    found = corner(3.0, 2.0, np.pi / 2)
    assert found is not None
    assert found[:2] == pytest.approx((2.0, 3.0))
    assert found[2] == pytest.approx(3.0)
    assert corner(3.0, 2.0, np.pi) is None


def test_setbacks_of_a_tee() -> None:
    through, stem, other = setbacks([0.0, np.pi / 2, np.pi], [6.0, 4.0, 6.0])
    assert stem == pytest.approx(6.0)
    assert through == pytest.approx(other) == pytest.approx(5.0)


def test_smooth_curve_of_a_quarter_circle_has_its_radius() -> None:
    start, end = np.array([0.0, 0.0]), np.array([40.0, 40.0])
    curve = smooth_curve(start, 0.0, end, np.pi / 2, (10.0, 10.0))
    assert np.allclose(curve[[0, -1]], [start, end])
    assert smallest_radius(curve) == pytest.approx(30.0, rel=0.1)
    assert arc_lengths(curve)[-1] == pytest.approx(20.0 + 30.0 * np.pi / 2, rel=0.01)


def test_resample_keeps_the_ends() -> None:
    line = resample(np.array([[0.0, 0.0], [3.0, 4.0]]))
    assert len(line) == 11
    assert np.allclose(line[-1], (3, 4))


def test_map_shows_every_road() -> None:
    world = towns.random_world(3)
    assert len(map_polylines(world)) == len(world.roads)


def test_box_corners() -> None:
    box = next(b for b in towns.random_world(3).boxes if b.kind == "building")
    corners = box_corners(box)
    assert np.allclose(corners.mean(axis=0), (box.x_m, box.y_m))
    assert np.hypot(*(corners[0] - corners[1])) == pytest.approx(box.length_m)
