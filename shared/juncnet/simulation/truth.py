"""Ground truth of a world: where the robot is, what is ahead, what it hit, which way it drove."""

import math
from typing import Literal

import numpy as np

from juncnet.camera import TRANSITION, CameraGeometry
from juncnet.simulation.roads import (
    Junction,
    Points,
    RoadNetwork,
    arm_ends,
    arm_id,
    reverse_arm,
)
from juncnet.simulation.roadside import box_corners
from juncnet.simulation.world import Box, World, wrap

Label = Literal["junction", "none", "transition"]

ON_ROAD_M = 0.5
"""A point this far off a road's surface still counts as on that road."""
ALONG_RAD = math.radians(60.0)
"""A robot whose heading is farther off a road's direction does not drive along it."""
ROBOT_RADIUS_M = 0.3
TRUNK_RADIUS_M = 0.2
ENOUGH_ARMS = 2
"""Arms other than the robot's own whose mouths must be visible for a frame to be *junction*."""


class GroundTruth:
    """What is true at a pose (x, y in world metres, yaw in radians) in `world`."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.network = RoadNetwork(world)
        self._trees = np.array([[tree.x_m, tree.y_m] for tree in world.trees]).reshape(-1, 2)
        houses = [box_corners(box) for box in world.boxes if box.kind == "building"]
        self._walls = np.array([[c[i], c[(i + 1) % 4]] for c in houses for i in range(4)]).reshape(
            -1, 2, 2
        )

    def road_offset_m(self, x_m: float, y_m: float, yaw_rad: float) -> float:
        """Return the distance from the nearest centre line; positive: left of it as one drives."""
        here = self.network.nearest(np.array([[x_m, y_m]]))
        backwards = math.cos(yaw_rad - float(here.heading_rad[0])) < 0
        return float(-here.offset_m[0] if backwards else here.offset_m[0])

    def off_road_m(self, x_m: float, y_m: float) -> float:
        """Return how far a point is off every road and junction surface, metres; 0: on one."""
        edge = float(self.network.nearest(np.array([[x_m, y_m]])).edge_m[0])
        if edge <= 0 or self.network.junction_of(x_m, y_m) is not None:
            return 0.0
        return edge

    def junction_of(self, x_m: float, y_m: float) -> int | None:
        """Return the id of the junction on whose surface a point is; None: on none."""
        return self.network.junction_of(x_m, y_m)

    def driving(self, x_m: float, y_m: float, yaw_rad: float) -> int | None:
        """Return the directed road id along which the robot heads; None: it is along none."""
        found = self._along(x_m, y_m, yaw_rad)
        return found[0] if found else None

    def mouth_ahead(self, x_m: float, y_m: float, yaw_rad: float) -> tuple[float, int] | None:
        """Return (distance along the robot's road to the next junction's mouth, its id).

        The distance is 0 for a robot past the mouth that still heads for the junction's node. None:
        the robot is on no road, heads more than 60 degrees off its road, or for a dead end.
        """
        found = self._along(x_m, y_m, yaw_rad)
        if found is None:
            return None
        arm, left = found
        node = arm_ends(self.world, arm)[1]
        if node not in self.network.junctions:
            return None
        return max(0.0, left - self.network.setback_m(reverse_arm(arm))), node

    def _along(self, x_m: float, y_m: float, yaw_rad: float) -> tuple[int, float] | None:
        """Return the directed road that the robot drives and how far its end is, metres."""
        under = self.network.roads_under(x_m, y_m, ON_ROAD_M)
        for road, along, heading in zip(
            under.road.tolist(), under.along_m.tolist(), under.heading_rad.tolist(), strict=True
        ):
            apart = abs(wrap(yaw_rad - heading))
            if min(apart, math.pi - apart) > ALONG_RAD:
                continue
            forward = apart < math.pi / 2
            left = self.network.lengths[road] - along if forward else along
            return arm_id(road, forward), left
        return None

    def label(self, x_m: float, y_m: float, yaw_rad: float, camera: CameraGeometry) -> Label:
        """Return what a picture taken by `camera` above this ground point shows.

        *junction*: the mouth ahead lies between d_near and d_far and at least two of the junction's
        other mouths are in the picture and in sight. *transition*, where the label is a matter of
        taste: on a junction's surface; around d_near and d_far; nearer than d_near; too little of
        the junction in the picture; a junction in sight off the robot's road. Else *none*.
        """
        if self.junction_of(x_m, y_m) is not None:
            return "transition"
        band = camera.band
        pose = (x_m, y_m, yaw_rad)
        ahead = self.mouth_ahead(*pose)
        if ahead is not None and ahead[0] <= band.d_far_m * (1 + TRANSITION):
            mouth_m, node = ahead
            if band.in_transition(mouth_m) or mouth_m < band.d_near_m:
                return "transition"
            visible = self._visible_mouths(self.network.junctions[node], pose, camera)
            if visible >= ENOUGH_ARMS:
                return "junction"
            return "transition" if visible else self._elsewhere(pose, camera, None)
        return self._elsewhere(pose, camera, ahead[1] if ahead else None)

    def _elsewhere(
        self, pose: tuple[float, float, float], camera: CameraGeometry, ahead: int | None
    ) -> Label:
        """Return *transition* when a junction other than `ahead` is in sight within d_far."""
        for junction in self.network.junctions.values():
            apart = math.hypot(junction.x_m - pose[0], junction.y_m - pose[1])
            near = apart - junction.reach_m <= camera.band.d_far_m
            if near and junction.id != ahead and self._visible_mouths(junction, pose, camera) > 1:
                return "transition"
        return "none"

    def _visible_mouths(
        self, junction: Junction, pose: tuple[float, float, float], camera: CameraGeometry
    ) -> int:
        """Count the junction's mouths, other than the nearest, in the picture and in sight."""
        x_m, y_m, yaw_rad = pose
        apart = [math.hypot(a.mouth[0] - x_m, a.mouth[1] - y_m) for a in junction.arms]
        own = apart.index(min(apart))
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        count = 0
        for number, arm in enumerate(junction.arms):
            if number == own:
                continue
            # Of a wide mouth half is enough: its nearer edge or its middle.
            for point in _mouth_points(junction, number):
                dx, dy = float(point[0]) - x_m, float(point[1]) - y_m
                seen = camera.project(c * dx + s * dy, c * dy - s * dx)
                if seen is None or not (0.0 <= seen[0] <= 1.0 and 0.0 <= seen[1] <= 1.0):
                    continue
                if self._in_sight(x_m, y_m, *arm.mouth):
                    count += 1
                    break
        return count

    def _in_sight(self, x_m: float, y_m: float, to_x_m: float, to_y_m: float) -> bool:
        """Return whether no wall of a building stands between two points."""
        if not len(self._walls):
            return True
        a, b = np.array([x_m, y_m]), np.array([to_x_m, to_y_m])
        p, q = self._walls[:, 0], self._walls[:, 1]
        crosses = (_side(a, b, p) != _side(a, b, q)) & (_side(p, q, a) != _side(p, q, b))
        return not bool(np.any(crosses))

    def collides(self, x_m: float, y_m: float, height_m: float = 0.0) -> bool:
        """Return whether a robot of 0.3 m radius, flying `height_m` up, touches something there.

        Boxes count up to their height, trunks at any: a crown is wider the higher one flies.
        """
        if len(self._trees):
            apart = np.hypot(self._trees[:, 0] - x_m, self._trees[:, 1] - y_m)
            if float(np.min(apart)) < ROBOT_RADIUS_M + TRUNK_RADIUS_M:
                return True
        tall = (box for box in self.world.boxes if box.height_m > height_m - ROBOT_RADIUS_M)
        return any(_distance_to_box(box, x_m, y_m) < ROBOT_RADIUS_M for box in tall)


def _mouth_points(junction: Junction, number: int) -> Points:
    arm = junction.arms[number]
    left = np.array([-math.sin(arm.heading_rad), math.cos(arm.heading_rad)])
    return np.array(arm.mouth) + np.array([[0.0], [0.4], [-0.4]]) * arm.width_m * left


def _side(a: Points, b: Points, p: Points) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
    """Return whether p lies left of the line from a to b; the arguments broadcast over (N, 2)."""
    cross = (b[..., 0] - a[..., 0]) * (p[..., 1] - a[..., 1])
    return cross - (b[..., 1] - a[..., 1]) * (p[..., 0] - a[..., 0]) > 0


def _distance_to_box(box: Box, x_m: float, y_m: float) -> float:
    c, s = math.cos(box.yaw_rad), math.sin(box.yaw_rad)
    dx, dy = x_m - box.x_m, y_m - box.y_m
    along = max(abs(c * dx + s * dy) - box.length_m / 2, 0.0)
    across = max(abs(c * dy - s * dx) - box.width_m / 2, 0.0)
    return math.hypot(along, across)


class PassCounter:
    """Counts each pass of a junction once: entered by one arm and left by another."""

    def __init__(self, truth: GroundTruth) -> None:
        self._truth = truth
        self._inside: int | None = None
        self._path: list[int] = []
        self.passed = 0
        """Passes so far."""

    @property
    def path(self) -> tuple[int, ...]:
        """Directed road ids driven so far, in order, the first from the start."""
        return tuple(self._path)

    def update(self, x_m: float, y_m: float, yaw_rad: float) -> None:
        """Take the robot's next pose; call it at least every metre."""
        junction = self._truth.junction_of(x_m, y_m)
        if junction is not None:
            self._inside = junction
            return
        if self._inside is None:
            if not self._path:
                arm = self._truth.driving(x_m, y_m, yaw_rad)
                self._path.extend([] if arm is None else [arm])
            return
        node, self._inside = self._inside, None
        leaving = self._arm_left_by(node, x_m, y_m)
        if not self._path:
            self._path.append(leaving)
        elif leaving == reverse_arm(self._path[-1]):
            # Back the way it came: no pass, but another direction from here on.
            if self._truth.driving(x_m, y_m, yaw_rad) == leaving:
                self._path.append(leaving)
        elif leaving != self._path[-1]:
            self._passed(node, leaving)

    def _passed(self, node: int, leaving: int) -> None:
        if arm_ends(self._truth.world, self._path[-1])[0] == node:
            # It had turned round on the road that it left this junction by.
            self._path.append(reverse_arm(self._path[-1]))
        self._path.append(leaving)
        self.passed += 1

    def _arm_left_by(self, node: int, x_m: float, y_m: float) -> int:
        arms = self._truth.network.junctions[node].arms
        return min(arms, key=lambda arm: math.hypot(arm.mouth[0] - x_m, arm.mouth[1] - y_m)).id
