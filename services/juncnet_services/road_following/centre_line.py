"""The road's centre line: a cubic with a width, fitted to the road's edges and followed over time.

y(x) = offset + heading x + curvature x^2 / 2 + bend x^3 / 6 in the robot frame (x forward, y left);
the edges lie half a width across. Side arms, junctions and blobs in the mask pull at one edge or
both: what lies far from the predicted edges hardly counts, and where nothing else is seen the
line goes on as it was, moved by the robot's own motion.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from juncnet_services.road_following.ground_view import GroundView, RoadEdges

Array = NDArray[np.float64]
PRIOR_SIGMA = np.array([0.20, 0.06, 0.022, 0.006, 0.12])
"""How far offset [m], heading [rad], curvature [1/m], bend [1/m^2] and half-width [m] may change
from one frame to the next, against the edges' noise."""
KNOWN_WIDTH_SIGMA_M = 0.03
"""The same for the half-width of a road that has been followed for a while: roads keep their width,
and where one edge is lost at a junction, the other and the width say where the middle is."""
LOOSE_SIGMA = np.array([4.0, 0.8, 0.05, 0.006, 3.0])
"""The same for a road seen for the first time."""
EDGE_SIGMA_M = (0.5, 0.07)
"""Noise of an edge: constant, and per metre ahead; neighbouring edges are not independent."""
OUTWARD_M, INWARD_M, LOOSE_M = 0.7, 1.5, 4.0
"""Beyond these residuals an edge counts for nothing: outwards (side arms) sooner than inwards;
the last for a road seen for the first time."""
ITERATIONS = 4
SEARCH_DEGREES = (0, -12, 12, -25, 25, -37, 37, -50, 50)


@dataclass(frozen=True)
class CentreLine:
    """The centre line in the robot frame, and how well the picture supports it (0..1)."""

    offset_m: float = 0.0
    heading: float = 0.0
    """Slope dy/dx at x = 0."""
    curvature_1pm: float = 0.0
    bend_1pm2: float = 0.0
    half_width_m: float = 3.0
    support: float = 0.0

    @property
    def vector(self) -> Array:
        """Offset, heading, curvature, bend, half-width."""
        return np.array(
            [
                self.offset_m,
                self.heading,
                self.curvature_1pm,
                self.bend_1pm2,
                self.half_width_m,
            ]
        )

    @classmethod
    def of(cls, vector: Array, support: float) -> "CentreLine":
        """Return the line of a parameter vector, each held within what a road can be."""
        low = np.array([-20.0, -1.5, -0.25, -0.05, 1.2])
        high = np.array([20.0, 1.5, 0.25, 0.05, 12.0])
        a, b, c, d, h = (float(v) for v in np.clip(vector, low, high))
        return cls(a, b, c, d, h, support)

    def y(self, x_m: Array) -> Array:
        """Return y at each x, metres."""
        x = x_m
        return (
            self.offset_m
            + self.heading * x
            + self.curvature_1pm * x**2 / 2
            + self.bend_1pm2 * x**3 / 6
        )

    def slope(self, x_m: Array) -> Array:
        """Return dy/dx at each x."""
        return self.heading + self.curvature_1pm * x_m + self.bend_1pm2 * x_m**2 / 2

    def moved(self, forward_m: float, turned_rad: float) -> "CentreLine":
        """Return the line after the robot drove `forward_m` and turned left by `turned_rad`."""
        at = np.array([forward_m])
        heading = float(np.tan(np.arctan(self.slope(at)[0]) - turned_rad))
        return CentreLine.of(
            np.array(
                [
                    self.y(at)[0],
                    heading,
                    self.curvature_1pm + self.bend_1pm2 * forward_m,
                    self.bend_1pm2,
                    self.half_width_m,
                ]
            ),
            self.support,
        )


def fit(
    edges: RoadEdges, start: CentreLine, sigma: Array, outward_m: float = OUTWARD_M
) -> CentreLine:
    """Return the line that agrees with the edges and, within `sigma` (5,), with `start`.

    Iteratively reweighted least squares with Tukey's weight. Where the road goes on beyond the
    picture, its edge counts only while the line's lies inside.
    """
    x = np.concatenate([edges.x_m, edges.x_m])
    y = np.concatenate([edges.left_m, edges.right_m])
    side = np.repeat([1.0, -1.0], edges.x_m.size)
    opened = np.concatenate([edges.left_open, edges.right_open])
    seen = np.isfinite(y)
    x, y, side, opened = x[seen], y[seen], side[seen], opened[seen]
    noise = EDGE_SIGMA_M[0] + EDGE_SIGMA_M[1] * x
    information = np.diag(1.0 / sigma**2)
    prior = start.vector
    line, weight = start, np.zeros_like(x)
    for _ in range(ITERATIONS):
        stretch = side * np.hypot(1.0, np.clip(line.slope(x), -1.5, 1.5))
        design = np.stack([np.ones_like(x), x, x**2 / 2, x**3 / 6, stretch], axis=1)
        residual = y - design @ line.vector
        outward = residual * side > 0
        limit = np.where(outward, outward_m, max(outward_m, INWARD_M)) * (1.0 + 0.04 * x)
        weight = np.clip(1.0 - (residual / limit) ** 2, 0.0, None) ** 2
        weight *= outward | ~opened
        scaled = design * (weight / noise**2)[:, None]
        solution: Array = np.asarray(
            np.linalg.solve(design.T @ scaled + information, scaled.T @ y + information @ prior),
            dtype=np.float64,
        )
        line = CentreLine.of(solution, 0.0)
    expected = 2 * max(int(edges.visible.sum()), edges.x_m.size // 2)
    return CentreLine.of(line.vector, float(min(1.0, 1.5 * weight.sum() / expected)))


def find(view: GroundView, above: NDArray[np.float32], width_m: float) -> CentreLine:
    """Return the line of the road that starts nearest to the robot, whatever its direction.

    Straight lines from the robot in directions up to 50 degrees off are fitted each; the best
    supported one wins, the one straight ahead where they are equal.
    """
    best, best_score = CentreLine(half_width_m=width_m / 2), -1.0
    for degrees in SEARCH_DEGREES:
        heading = float(np.tan(np.radians(degrees)))
        start = CentreLine(heading=heading, half_width_m=width_m / 2)
        edges = view.edges(above, start.y(view.x_m), 1.5 * width_m)
        coarse = fit(edges, start, LOOSE_SIGMA, LOOSE_M)
        edges = view.edges(above, coarse.y(view.x_m), coarse.half_width_m)
        line = fit(edges, coarse, LOOSE_SIGMA, LOOSE_M / 2)
        after = view.edges(above, line.y(view.x_m), line.half_width_m)
        on_road = after.on_road.sum() / max(int(after.visible.sum()), view.x_m.size // 2)
        near = 1.0 - 0.05 * max(0.0, abs(line.offset_m) - width_m / 2)
        score = float((0.2 + line.support) * on_road * near * np.cos(np.radians(degrees / 2)))
        if score > best_score:
            best, best_score = line, score
    return best
