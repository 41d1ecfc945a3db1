"""Arcs of a vehicle that cannot turn in place: which of them stay on the road's surface."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from juncnet.messages import RoadSurface

Array = NDArray[np.float64]
STEP_M = 0.25
"""Between the points of a path that are looked at."""
AHEAD_M = 5.0
"""How far ahead a path must be on the road."""
CANDIDATES = 17
OFF_ROAD = 4.0
"""What a path that leaves the road at once costs, against one as far from the wanted as can be."""
WIDER = 0.6
"""A turn begins, at the latest, when an arc of this part of its curvature would miss its road."""
BEHIND_M, LONGEST_M = 1.5, 8.0
"""How far behind that arc its path must be on the road, and the longest that is looked at."""
AGAINST_RAD = 0.5
"""What is left of a turn, from which on no arc is driven against it."""
EVADED_M = 1.5
"""Length of an arc away from where the turn leads."""
BACK_M = 2.0
"""How far an arc back onto the road may be."""
ANGLES = np.linspace(-1.0, 1.0, 5)
"""Angles that a turn may have, relative to how well its own is known."""


@dataclass(frozen=True)
class Arcs:
    """The arcs of a vehicle that keeps `half_width_m` of room at either side.

    `surface` None: nobody tells where the road is, and every arc is as good as any.
    """

    surface: RoadSurface | None
    half_width_m: float
    tightest_1pm: float

    def on_road(self, wanted_1pm: float, turn_rad: float, within_rad: float) -> float:
        """Return the curvature near the wanted one (1/m, left positive) that stays on the road.

        The path turns by `turn_rad`, known `within_rad`, and goes straight on from there. Where
        none stays on the road, one that does for longer is taken for one that is nearer; none is
        against a turn that is still to be made, for it leads onto another road.
        """
        if self.surface is None:
            return wanted_1pm
        least = 0.0 if turn_rad > AGAINST_RAD else -self.tightest_1pm
        most = 0.0 if turn_rad < -AGAINST_RAD else self.tightest_1pm
        curvatures = np.append(wanted_1pm, np.linspace(least, most, CANDIDATES))
        clear = self._clear_m(self.surface, curvatures, turn_rad, within_rad, AHEAD_M)
        apart = abs(curvatures - wanted_1pm) / (2 * self.tightest_1pm)
        return float(curvatures[np.argmin(apart + OFF_ROAD * (1 - clear / AHEAD_M))])

    def last_chance(self, turn_rad: float, within_rad: float, radius_m: float) -> bool:
        """Return whether a turn on an arc leads onto its road now, but soon will not."""
        if self.surface is None:
            return False
        pair = np.copysign(np.array([1.0, WIDER]) / radius_m, turn_rad)
        length_m = min(abs(turn_rad) * radius_m / WIDER + BEHIND_M, LONGEST_M)
        own_m, wider_m = self._clear_m(self.surface, pair, turn_rad, within_rad, length_m)
        return bool(own_m >= length_m > wider_m)

    @property
    def off_road(self) -> bool:
        """Whether the vehicle is off the road and no arc leads back onto it soon."""
        if self.surface is None:
            return False
        curvature = np.linspace(-self.tightest_1pm, self.tightest_1pm, CANDIDATES)
        x, y, _ = _paths(curvature, np.full(CANDIDATES, BACK_M), BACK_M)
        here = np.zeros(1)
        return bool(self.surface.off_road(here, here).all() and self.surface.off_road(x, y).all())

    def _clear_m(
        self,
        surface: RoadSurface,
        curvatures_1pm: Array,
        turn_rad: float,
        within_rad: float,
        length_m: float,
    ) -> Array:
        """Return how far the best path of each curvature is not known to leave the road."""
        turns = turn_rad + within_rad * ANGLES
        curvature, turn = (grid.ravel() for grid in np.meshgrid(curvatures_1pm, turns))
        clear = clear_m(surface, curvature, turn, length_m, self.half_width_m)
        return clear.reshape(turns.size, -1).max(axis=0)


def clear_m(
    surface: RoadSurface,
    curvature_1pm: Array,
    turn_rad: Array,
    length_m: float,
    half_width_m: float,
) -> Array:
    """Return how far paths (N,) are not known to leave the road: `length_m` where they stay on it.

    A path goes straight on once it has turned by its `turn_rad`, or, where that is to the other
    side, soon.
    """
    towards = curvature_1pm * turn_rad > 0
    arc_m = np.full(curvature_1pm.size, EVADED_M)
    arc_m[towards] = turn_rad[towards] / curvature_1pm[towards]
    x, y, heading = _paths(curvature_1pm, arc_m, length_m)
    aside = half_width_m * np.array([-1.0, 0.0, 1.0])[:, None, None]
    off_road = surface.off_road(x - aside * np.sin(heading), y + aside * np.cos(heading))
    off = np.any(off_road, axis=0)
    off[:, :-1] &= off[:, 1:]  # one point alone is the mask's noise
    return np.where(np.any(off, axis=1), STEP_M * np.argmax(off, axis=1), length_m)


def _paths(curvature_1pm: Array, arc_m: Array, length_m: float) -> tuple[Array, Array, Array]:
    """Return x, y and heading (N, M) every `STEP_M` along arcs that go straight on from `arc_m`."""
    curvature, arc_m = curvature_1pm[:, None], arc_m[:, None]
    along = np.arange(STEP_M, length_m + STEP_M / 2, STEP_M)
    middle = curvature * np.minimum(along - STEP_M / 2, arc_m)
    x, y = np.cumsum(STEP_M * np.cos(middle), axis=1), np.cumsum(STEP_M * np.sin(middle), axis=1)
    return x, y, curvature * np.minimum(along, arc_m)
