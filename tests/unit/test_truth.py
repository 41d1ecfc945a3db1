"""Ground truth in a crossing of two straight roads, where every answer is known."""

import math
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from juncnet.camera import CameraGeometry
from juncnet.simulation.roads import RoadNetwork, arm_ends, arm_id, resample, reverse_arm
from juncnet.simulation.routes import plan_mission
from juncnet.simulation.towns import random_world
from juncnet.simulation.truth import GroundTruth, PassCounter
from juncnet.simulation.world import Box, Node, Road, Start, Tree, World

EAST, NORTH, WEST, SOUTH = 0.0, math.pi / 2, math.pi, -math.pi / 2
ENDS = ((60.0, 0.0), (0.0, 60.0), (-60.0, 0.0), (0.0, -60.0))


def crossing(boxes: tuple[Box, ...] = (), trees: tuple[Tree, ...] = ()) -> World:
    """Four roads, each 6 m wide, that leave node 0 at the origin; roads 0..3: east, north, ..."""
    nodes = {0: Node(0, 0.0, 0.0)}
    roads: dict[int, Road] = {}
    for number, end in enumerate(ENDS):
        nodes[number + 1] = Node(number + 1, *end)
        line = resample(np.array([(0.0, 0.0), end]))
        roads[number] = Road(number, 0, number + 1, line, 6.0)
    start = Start(-50.0, 0.0, EAST, 2, 0)
    return World("crossing", 0, nodes, roads, start, boxes=boxes, trees=trees)


@pytest.fixture(name="truth")
def _truth() -> GroundTruth:
    return GroundTruth(crossing())


def test_a_junction_whose_roads_all_lie_to_one_side_reaches_their_outer_edges() -> None:
    """Roads to the west, north and north-east: south-east of the node there is none."""
    nodes = {0: Node(0, 0.0, 0.0)}
    roads: dict[int, Road] = {}
    for number, end in enumerate(((-60.0, 0.0), (0.0, 60.0), (42.0, 42.0))):
        nodes[number + 1] = Node(number + 1, *end)
        roads[number] = Road(number, 0, number + 1, resample(np.array([(0.0, 0.0), end])), 6.0)
    world = World("one side", 0, nodes, roads, Start(-50.0, 0.0, EAST, 0, 0))
    junction = RoadNetwork(world).junctions[0]
    asked = np.array([(1.0, 0.0), (-2.0, -2.5), (1.5, -1.0), (-2.0, -3.5), (3.0, -3.0)])
    assert junction.contains(asked).tolist() == [True, True, True, False, False]


def test_directed_roads() -> None:
    assert arm_id(3, True) == 6
    assert reverse_arm(6) == arm_id(3, False) == 7
    assert arm_ends(crossing(), 7) == (4, 0)


def test_mouths_lie_a_corner_away(truth: GroundTruth) -> None:
    # Half the other road's width, 3 m, and a corner radius of 3 m.
    for arm in truth.network.junctions[0].arms:
        assert arm.setback_m == pytest.approx(6.0)
    assert {truth.network.setback_m(arm) for arm in (1, 3, 5, 7)} == {0.0}


def test_offsets_are_left_positive(truth: GroundTruth) -> None:
    assert truth.road_offset_m(-30.0, 1.0, EAST) == pytest.approx(1.0)
    assert truth.road_offset_m(-30.0, 1.0, WEST) == pytest.approx(-1.0)
    assert truth.off_road_m(-30.0, 2.9) == 0.0
    assert truth.off_road_m(-30.0, 5.0) == pytest.approx(2.0)
    assert truth.off_road_m(3.2, 3.2) == 0.0  # within the rounded corner
    assert truth.off_road_m(5.5, 5.5) > 0.0


def test_surface_ends_at_the_mouth(truth: GroundTruth) -> None:
    assert truth.junction_of(-5.9, 0.0) == 0
    assert truth.junction_of(-6.1, 0.0) is None
    assert truth.junction_of(5.5, 5.5) is None


def test_mouth_ahead(truth: GroundTruth) -> None:
    assert truth.mouth_ahead(-30.0, 0.5, EAST) == (pytest.approx(24.0), 0)
    assert truth.mouth_ahead(-30.0, 0.5, EAST + 0.9) == (pytest.approx(24.0), 0)
    assert truth.mouth_ahead(-30.0, 0.5, WEST) is None  # a dead end
    assert truth.mouth_ahead(-30.0, 0.5, NORTH) is None  # across the road
    assert truth.mouth_ahead(-30.0, 9.0, EAST) is None  # on no road
    assert truth.mouth_ahead(-4.0, 0.0, EAST) == (0.0, 0)


def test_label_follows_the_band(truth: GroundTruth) -> None:
    camera = CameraGeometry()
    near, far = camera.band.d_near_m, camera.band.d_far_m

    def label(mouth_m: float, yaw: float = EAST) -> str:
        return truth.label(-6.0 - mouth_m, 0.0, yaw, camera)

    assert label((near + far) / 2) == "junction"
    assert label(0.75 * far) == "junction"
    assert label(far) == label(near) == label(0.5 * near) == "transition"
    assert label(1.3 * far) == "none"
    assert label((near + far) / 2, WEST) == "none"
    assert truth.label(-2.0, 0.0, EAST, camera) == "transition"
    assert truth.label(7.0, 0.0, EAST, camera) == "none"


def test_label_scales_with_the_height(truth: GroundTruth) -> None:
    low, high = CameraGeometry(height_m=1.5), CameraGeometry(height_m=6.0)
    assert truth.label(-6.0 - 20.0, 0.0, EAST, low) == "none"
    assert truth.label(-6.0 - 20.0, 0.0, EAST, high) == "junction"


def test_a_junction_behind_houses_is_not_called_one() -> None:
    houses = tuple(
        Box("building", -9.0, side * 5.3, 0.0, 4.0, 4.0, 6.0, (0, 0, 0)) for side in (-1, 1)
    )
    hidden, camera = GroundTruth(crossing(houses)), CameraGeometry()
    assert GroundTruth(crossing()).label(-17.5, 0.0, EAST, camera) == "junction"
    assert hidden.label(-17.5, 0.0, EAST, camera) != "junction"


def test_collisions() -> None:
    car = Box("car", -30.0, 3.5, EAST, 4.0, 1.8, 1.5, (0, 0, 0))
    truth = GroundTruth(crossing((car,), (Tree(-20.0, 5.0, 2.0, 5.0),)))
    assert truth.collides(-30.0, 2.4)
    assert not truth.collides(-30.0, 2.2)
    assert not truth.collides(-30.0, 3.5, height_m=3.0)  # over the car
    assert truth.collides(-20.2, 4.8)
    assert not truth.collides(-20.0, 4.2)


def drive(counter: PassCounter, *points: tuple[float, float]) -> None:
    for (x1, y1), (x2, y2) in pairwise(points):
        heading = math.atan2(y2 - y1, x2 - x1)
        for share in np.linspace(0.0, 1.0, 200):
            counter.update(x1 + share * (x2 - x1), y1 + share * (y2 - y1), heading)


def test_each_pass_counts_once(truth: GroundTruth) -> None:
    counter = PassCounter(truth)
    drive(counter, (-40, 0), (0, 0), (0, 40))
    assert (counter.passed, counter.path) == (1, (arm_id(2, False), arm_id(1, True)))
    drive(counter, (0, 6.1), (0, 5.9), (0, 6.1), (0, 20))  # trembling at the mouth
    assert counter.passed == 1
    drive(counter, (0, 20), (0, 0), (0, -20))
    assert counter.passed == 2
    assert counter.path[2:] == (arm_id(1, False), arm_id(3, True))


def test_turning_back_is_no_pass(truth: GroundTruth) -> None:
    counter = PassCounter(truth)
    drive(counter, (-40, 0), (-2, 0), (-40, 0))
    assert counter.passed == 0
    assert counter.path == (arm_id(2, False), arm_id(2, True))


def test_the_planned_route_is_what_is_counted() -> None:
    world = random_world(5)
    truth, route = GroundTruth(world), plan_mission(world, 1, 6)
    counter = PassCounter(truth)
    for arm in route.path:
        centre = world.roads[arm // 2].centre[:: 1 if arm % 2 == 0 else -1]
        for (x, y), (dx, dy) in zip(centre, np.diff(centre, axis=0), strict=False):
            counter.update(float(x), float(y), math.atan2(dy, dx))
            assert truth.off_road_m(float(x), float(y)) == 0.0
    assert counter.path == route.path
    assert counter.passed == 6


def test_labels_of_a_world_are_mixed() -> None:
    world = random_world(5)
    truth, camera = GroundTruth(world), CameraGeometry()
    labels = Counter(
        truth.label(float(x), float(y), math.atan2(dy, dx), camera)
        for road in world.roads.values()
        for (x, y), (dx, dy) in zip(
            road.centre[:-1:6], np.diff(road.centre, axis=0)[::6], strict=True
        )
    )
    assert min(labels["junction"], labels["none"]) > 0.1 * labels.total()


def test_nearest_agrees_with_brute_force() -> None:
    world = random_world(5)
    network = RoadNetwork(world)
    points = np.random.default_rng(0).uniform(-80, 80, (300, 2))
    found = network.nearest(points)
    every = np.concatenate([road.centre for road in world.roads.values()])
    apart = np.hypot(*(points[:, None] - every[None]).T).T.min(axis=1)
    assert np.all(np.abs(found.offset_m) <= apart + 1e-9)
    assert np.allclose(np.abs(found.offset_m), apart, atol=0.26)
