"""Geometry of a road graph: centre lines, junction surfaces, arms and their mouths. Pure.

An *arm* is a road as it leaves a junction. Its id is the directed road id: `2 * road` when it is
driven from the road's node a to b, `2 * road + 1` from b to a. Its *mouth* lies `setback_m` from
the node along the arm: there its surface no longer overlaps that of other arms, corners included.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from juncnet.simulation.world import Road, World, wrap

Points = NDArray[np.float64]

SPACING_M = 0.5
"""Largest distance between neighbouring points of a centre line."""
THROUGH_RAD = math.radians(165.0)
"""From this gap between two arms on there is no corner between them: the edge runs through."""
_GROUP = 8
"""Centre line segments that the search for the nearest one takes together."""
_NEAREST_GROUPS = 6
_CHUNK = 20_000


def arm_id(road: int, forward: bool) -> int:
    """Return the directed id of `road`, driven from a to b (`forward`) or from b to a."""
    return 2 * road + (0 if forward else 1)


def reverse_arm(arm: int) -> int:
    """Return the id of the same road driven the other way."""
    return arm ^ 1


def arm_ends(world: World, arm: int) -> tuple[int, int]:
    """Return the nodes (from, to) of a directed road."""
    road = world.roads[arm // 2]
    return (road.a, road.b) if arm % 2 == 0 else (road.b, road.a)


def resample(points: Points, spacing_m: float = SPACING_M) -> Points:
    """Return an (M, 2) polyline along `points` (N, 2), evenly spaced, <= `spacing_m` apart."""
    along = arc_lengths(points)
    count = max(2, math.ceil(along[-1] / spacing_m) + 1)
    wanted = np.linspace(0.0, float(along[-1]), count)
    x, y = np.interp(wanted, along, points[:, 0]), np.interp(wanted, along, points[:, 1])
    return np.stack([x, y], axis=1)


def arc_lengths(points: Points) -> NDArray[np.float64]:
    """Return the distance along a polyline (N, 2) of each of its points, (N,) metres."""
    steps = np.hypot(*np.diff(points, axis=0).T)
    return np.concatenate([[0.0], np.cumsum(steps)])


def smooth_curve(
    start: Points, start_heading: float, end: Points, end_heading: float, straight: Sequence[float]
) -> Points:
    """Return a smooth polyline, points <= 0.5 m apart, between two straight pieces.

    It leaves `start` (2,) along `start_heading` [rad] for `straight[0]` metres and arrives at `end`
    along `end_heading` (of driving, not of the arm) after `straight[1]` straight metres.
    """
    u = np.array([math.cos(start_heading), math.sin(start_heading)])
    v = np.array([math.cos(end_heading), math.sin(end_heading)])
    p, q = start + straight[0] * u, end - straight[1] * v
    # Handles of this length make a cubic Bezier curve come closest to a circular arc.
    turn = abs(wrap(end_heading - start_heading))
    chord = float(np.hypot(*(q - p)))
    handle = chord * 2 / (3 * (1 + math.cos(turn / 2)))
    t = np.linspace(0.0, 1.0, max(24, round(3 * chord)))[:, None]
    curve = (
        (1 - t) ** 3 * p
        + 3 * t * (1 - t) ** 2 * (p + handle * u)
        + 3 * t**2 * (1 - t) * (q - handle * v)
        + t**3 * q
    )
    return resample(np.concatenate([start[None], curve, end[None]]))


def smallest_radius(points: Points, span: int = 4) -> float:
    """Return the smallest radius [m] of a polyline's bends, over pieces of 2 * `span` points."""
    if len(points) <= 2 * span:
        return math.inf
    steps = np.diff(points, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    along = arc_lengths(points)
    turn = np.abs(heading[span:] - heading[:-span])
    length = along[span:-1] - along[: -span - 1]
    return float(np.min(length / np.maximum(turn, 1e-9)))


def corner(half_a: float, half_b: float, gap_rad: float) -> tuple[float, float, float] | None:
    """Return where the facing edges of two neighbouring arms meet, and how far the corner is cut.

    Args:
        half_a: half the width of one arm, metres; `half_b` of the next one counter-clockwise.
        half_b: see `half_a`.
        gap_rad: angle between the two.

    Returns:
        (distance along a, distance along b, length cut off along both by the corner's radius),
        metres; None where the gap is so wide that there is no corner.
    """
    if gap_rad >= THROUGH_RAD:
        return None
    s, c = math.sin(gap_rad), math.cos(gap_rad)
    along_a, along_b = (half_b + half_a * c) / s, (half_a + half_b * c) / s
    radius = min(max(3.0 * (gap_rad - math.radians(40)) / math.radians(50), 0.8), 3.5)
    return max(along_a, 0.0), max(along_b, 0.0), radius / math.tan(gap_rad / 2)


def setbacks(headings: Sequence[float], widths: Sequence[float]) -> list[float]:
    """Return the setback [m] of each arm of a junction, given headings [rad] and widths [m]."""
    result = [0.0] * len(headings)
    order = sorted(range(len(headings)), key=lambda i: headings[i] % (2 * math.pi))
    for i, j in zip(order, order[1:] + order[:1], strict=True):
        gap = (headings[j] - headings[i]) % (2 * math.pi)
        found = corner(widths[i] / 2, widths[j] / 2, gap)
        if found is not None:
            result[i] = max(result[i], found[0] + found[2])
            result[j] = max(result[j], found[1] + found[2])
    return result


@dataclass(frozen=True)
class Arm:
    """A road as it leaves a junction."""

    id: int
    """Directed road id, away from the junction."""
    road: int
    heading_rad: float
    """Away from the junction."""
    width_m: float
    setback_m: float
    mouth: tuple[float, float]
    """Where the centre line leaves the junction's surface, world metres."""


@dataclass(frozen=True)
class Junction:
    """A junction: its arms, counter-clockwise, and the outline of its surface."""

    id: int
    x_m: float
    y_m: float
    arms: tuple[Arm, ...]
    outline: Points
    """(N, 2) polygon, counter-clockwise: the mouths, and between them the rounded corners."""

    @cached_property
    def reach_m(self) -> float:
        """Largest distance of the outline from the node, metres."""
        return float(np.max(np.hypot(self.outline[:, 0] - self.x_m, self.outline[:, 1] - self.y_m)))

    def contains(self, points: Points) -> NDArray[np.bool_]:
        """Return which of `points` (N, 2) lie on the junction's surface, (N,) bool."""
        x, y = points[:, 0, None], points[:, 1, None]
        x1, y1 = self.outline[:, 0], self.outline[:, 1]
        x2, y2 = np.roll(x1, -1), np.roll(y1, -1)
        rise = np.where(y2 == y1, 1e-12, y2 - y1)
        crosses = ((y1 > y) != (y2 > y)) & (x < (x2 - x1) * (y - y1) / rise + x1)
        return np.sum(crosses, axis=1) % 2 == 1


def leaving_heading(road: Road, node: int) -> float:
    """Return the heading [rad] of `road` as it leaves `node`, over its first two metres."""
    points = road.centre if road.a == node else road.centre[::-1]
    far = points[min(4, len(points) - 1)]
    return math.atan2(far[1] - points[0, 1], far[0] - points[0, 0])


def junction_at(world: World, node: int) -> Junction:
    """Return the junction at `node`."""
    place = world.nodes[node]
    roads = sorted(
        world.roads_at(node), key=lambda road: leaving_heading(road, node) % (2 * math.pi)
    )
    headings = [leaving_heading(road, node) for road in roads]
    back = setbacks(headings, [road.width_m for road in roads])
    centre = np.array([place.x_m, place.y_m])
    arms = tuple(
        Arm(
            id=arm_id(road.id, road.a == node),
            road=road.id,
            heading_rad=heading,
            width_m=road.width_m,
            setback_m=setback,
            mouth=(
                place.x_m + setback * math.cos(heading),
                place.y_m + setback * math.sin(heading),
            ),
        )
        for road, heading, setback in zip(roads, headings, back, strict=True)
    )
    return Junction(node, place.x_m, place.y_m, arms, _outline(centre, arms))


def _outline(centre: Points, arms: tuple[Arm, ...]) -> Points:
    pieces: list[Points] = []
    for arm, following in zip(arms, arms[1:] + arms[:1], strict=True):
        u, n = _axes(arm.heading_rad)
        half = arm.width_m / 2
        pieces.append(centre + arm.setback_m * u - half * n)
        pieces.append(centre + arm.setback_m * u + half * n)
        gap = (following.heading_rad - arm.heading_rad) % (2 * math.pi)
        found = corner(half, following.width_m / 2, gap)
        v, m = _axes(following.heading_rad)
        if found is None:
            if gap > math.pi:  # On the outer side of a bend the roads' edges reach the node.
                pieces += [centre + half * n, centre - following.width_m / 2 * m]
            continue
        begin = centre + (found[0] + found[2]) * u + half * n
        end = centre + (found[1] + found[2]) * v - following.width_m / 2 * m
        apex = centre + found[0] * u + half * n
        pieces.extend((1 - t) ** 2 * begin + 2 * t * (1 - t) * apex + t**2 * end for t in _ARC)
    return np.array(pieces)


_ARC = np.linspace(0.0, 1.0, 7)


def _axes(heading: float) -> tuple[Points, Points]:
    u = np.array([math.cos(heading), math.sin(heading)])
    return u, np.array([-u[1], u[0]])


@dataclass(frozen=True)
class Nearest:
    """The nearest centre line of each of N points; every array is (N,)."""

    road: NDArray[np.int64]
    """Road ids."""
    along_m: NDArray[np.float64]
    """Distance from the road's node a along its centre line."""
    offset_m: NDArray[np.float64]
    """Distance from the centre line; positive: left of the direction from a to b."""
    heading_rad: NDArray[np.float64]
    """Of the centre line there, from a to b."""
    edge_m: NDArray[np.float64]
    """Distance from the nearest road's edge of any road; negative: on a road."""


class RoadNetwork:
    """The roads and junctions of a world, indexed for fast geometry."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.junctions = {
            node: junction_at(world, node) for node in world.nodes if world.is_junction(node)
        }
        roads = [road for _, road in sorted(world.roads.items())]
        self._start = np.concatenate([road.centre[:-1] for road in roads])
        self._step = np.concatenate([np.diff(road.centre, axis=0) for road in roads])
        self._length = np.hypot(self._step[:, 0], self._step[:, 1])
        self._heading = np.arctan2(self._step[:, 1], self._step[:, 0])
        counts = [len(road.centre) - 1 for road in roads]
        self._road = np.repeat([road.id for road in roads], counts)
        self._half = np.repeat([road.width_m / 2 for road in roads], counts)
        self._along = np.concatenate([arc_lengths(road.centre)[:-1] for road in roads])
        self.lengths = {r.id: float(arc_lengths(r.centre)[-1]) for r in roads}
        """Length of each road's centre line, metres, by road id."""
        self._groups = self._group(counts)
        middle = self._groups[:, _GROUP // 2]
        self._middle = self._start[middle]

    def _group(self, counts: list[int]) -> NDArray[np.int64]:
        """Return (G, 8) segment indices: neighbours on one road, the last one repeated to fill."""
        rows: list[NDArray[np.int64]] = []
        first = 0
        for count in counts:
            rows.extend(
                np.minimum(np.arange(begin, begin + _GROUP), count - 1) + first
                for begin in range(0, count, _GROUP)
            )
            first += count
        return np.stack(rows)

    def nearest(self, points: Points) -> Nearest:
        """Return the centre line nearest to each of `points` (N, 2); 100 000 points take ~2 s."""
        parts = [self._nearest(points[i : i + _CHUNK]) for i in range(0, len(points), _CHUNK)]
        names = ("road", "along_m", "offset_m", "heading_rad", "edge_m")
        return Nearest(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def _nearest(self, points: Points) -> Nearest:
        difference = points[:, None, :] - self._middle[None]
        squared = np.einsum("nga,nga->ng", difference, difference)
        keep = min(_NEAREST_GROUPS, squared.shape[1])
        groups = np.argpartition(squared, keep - 1, axis=1)[:, :keep]
        segments = self._groups[groups].reshape(len(points), -1)
        fraction, distance = self._distances(points[:, None, :], segments)
        row = np.arange(len(points))
        best = np.argmin(distance, axis=1)
        segment = segments[row, best]
        relative = points - self._start[segment]
        step = self._step[segment]
        side = step[:, 0] * relative[:, 1] - step[:, 1] * relative[:, 0]
        return Nearest(
            self._road[segment],
            self._along[segment] + fraction[row, best] * self._length[segment],
            np.copysign(distance[row, best], side),
            self._heading[segment],
            np.min(distance - self._half[segments], axis=1),
        )

    def _distances(
        self, points: Points, segments: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        relative = points - self._start[segments]
        step = self._step[segments]
        dot = np.einsum("...a,...a->...", relative, step)
        fraction = np.clip(dot / self._length[segments] ** 2, 0.0, 1.0)
        apart = relative - fraction[..., None] * step
        return fraction, np.hypot(apart[..., 0], apart[..., 1])

    def roads_under(self, x_m: float, y_m: float, margin_m: float) -> Nearest:
        """Return where on each road a point is, of those whose surface, widened, is below it."""
        every = np.arange(len(self._road))
        point = np.array([x_m, y_m])
        fraction, distance = self._distances(point[None], every)
        near = np.flatnonzero(distance <= self._half + margin_m)
        best: dict[int, int] = {}
        for index in near[np.argsort(distance[near], kind="stable")].tolist():
            best.setdefault(int(self._road[index]), index)
        chosen = np.array(list(best.values()), dtype=np.int64)
        relative, step = point - self._start[chosen], self._step[chosen]
        side = step[:, 0] * relative[:, 1] - step[:, 1] * relative[:, 0]
        return Nearest(
            self._road[chosen],
            self._along[chosen] + fraction[chosen] * self._length[chosen],
            np.copysign(distance[chosen], side),
            self._heading[chosen],
            distance[chosen] - self._half[chosen],
        )

    def junction_of(self, x_m: float, y_m: float) -> int | None:
        """Return the id of the junction on whose surface a point is."""
        point = np.array([[x_m, y_m]])
        for junction in self.junctions.values():
            if math.hypot(x_m - junction.x_m, y_m - junction.y_m) > junction.reach_m:
                continue
            if bool(junction.contains(point)[0]):
                return junction.id
        return None

    def arm(self, identity: int) -> Arm | None:
        """Return the arm with this directed road id; None where it does not leave a junction."""
        junction = self.junctions.get(arm_ends(self.world, identity)[0])
        if junction is None:
            return None
        return next(arm for arm in junction.arms if arm.id == identity)

    def setback_m(self, identity: int) -> float:
        """Return the setback of the mouth at the beginning of a directed road; 0 at a dead end."""
        arm = self.arm(identity)
        return arm.setback_m if arm is not None else 0.0


def map_polylines(world: World) -> list[list[tuple[float, float]]]:
    """Return the centre line of every road as (x, y) points some 2 m apart, to draw a map of."""
    return [[(float(x), float(y)) for x, y in road.centre[::4]] for road in world.roads.values()]
