"""The roads that lead away from a robot, read off a map of the surface around it.

On a ring around the robot every such road is a piece of surface that is connected to the robot.
Bearings are against the direction in which the robot looks, left positive.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from juncnet.messages import RoadOpening, RoadSeen, RoadSurface

UNSEEN, OFF_ROAD, ROAD = RoadSurface.UNSEEN, RoadSurface.OFF_ROAD, RoadSurface.ROAD
Flags = NDArray[np.bool_]
Classes = NDArray[np.int8]
DIRECTIONS = 180
STEP_RAD = 2 * math.pi / DIRECTIONS
BEARINGS = STEP_RAD * np.arange(DIRECTIONS) - math.pi
RINGS = ((8.0, 8.5, 9.0), (6.5, 7.0, 7.5))
"""Radii in metres, of which two of three decide; the inner ones where the outer show nothing. A map
that shows nothing at either, as of a camera lower than 1.5 m, has no arms."""
INWARD = (7.5, 6.5, 5.5, 4.5, 3.5)
"""Radii at which an arm must go on towards the robot, unless nothing was seen there."""
GAP = 2
"""Directions without surface that do not end an arm: the mask's noise;"""
NARROWEST = 7
"""and fewest with it that are one: 2 m."""
SLANT = 3
"""Directions by which an arm shifts from one of those radii to the next."""
EDGE_RAD = 0.5
"""Half the width of a wide road on the ring: so far inside its edge an arm is aimed at."""
LEAST_ROOM_RAD, ROOM = 0.2, 0.6
"""A line that passes the ring so far off where an arm is aimed at, or by such a part of the arm's
half there, is still on it."""
DEEP_M, AROUND_M = (3.0, 3.5, 4.0), 3.0
"""A road's mouth goes on so far beyond the edge that it opens, up to so much before or behind."""
NO_ROAD, SOME_ROAD, SEEN = 0.04, 0.1, 0.5
"""In how many of the places there at most no road leads on, in how many one does, and how many must
have been seen without one."""
KNOWN = 0.85
"""Part of the directions nearer to the wanted one that must have been seen."""


@dataclass(frozen=True)
class Arm:
    """A road that leads away, by the bearings of its right and left edge on the ring."""

    right_rad: float
    left_rad: float

    def bearing_rad(self, wanted_rad: float) -> float:
        """Return its middle; of one wide enough for several roads where the wanted one is."""
        edge_rad = min(EDGE_RAD, (self.left_rad - self.right_rad) / 2)
        right, left = self.right_rad + edge_rad, self.left_rad - edge_rad
        middle = (right + left) / 2
        near = middle + math.remainder(wanted_rad - middle, 2 * math.pi)
        return min(max(near, right), left)

    def room_rad(self, bearing_rad: float) -> float:
        """Return how far off a bearing of its own a line may pass the ring and be on it."""
        middle = (self.right_rad + self.left_rad) / 2
        off_rad = abs(math.remainder(bearing_rad - middle, 2 * math.pi))
        return max(LEAST_ROOM_RAD, ROOM * ((self.left_rad - self.right_rad) / 2 - off_rad))


@dataclass(frozen=True)
class Sector:
    """Directions among which an arm is looked for: the wanted one, the outermost right and left."""

    wanted_rad: float
    right_rad: float
    left_rad: float
    beyond: bool = True
    """Whether an arm on the other side of the wanted direction is waited for, too."""

    def turned(self, by_rad: float) -> "Sector":
        """Return the sector seen from another direction: all of it turned to the left."""
        right_rad, left_rad = self.right_rad + by_rad, self.left_rad + by_rad
        return Sector(self.wanted_rad + by_rad, right_rad, left_rad, self.beyond)


@dataclass(frozen=True)
class Arms:
    """The arms around a robot, and in which of `BEARINGS` nothing was seen."""

    arms: tuple[Arm, ...]
    unseen: Flags

    def towards(self, sector: Sector) -> tuple[float, float] | None:
        """Return bearing and room of the sector's arm that is nearest to the wanted direction.

        None: there is none, or what was not seen yet may hide a nearer one.
        """
        wanted_rad = sector.wanted_rad
        found = [
            (bearing, arm.room_rad(bearing))
            for arm in self.arms
            if sector.right_rad
            <= (bearing := _near(arm.bearing_rad(wanted_rad), wanted_rad))
            <= sector.left_rad
        ]
        if not found:
            return None
        nearest, room = min(found, key=lambda pair: abs(pair[0] - wanted_rad))
        apart = np.remainder(BEARINGS - wanted_rad + math.pi, 2 * math.pi) - math.pi
        if not sector.beyond:
            apart = np.where(apart * (nearest - wanted_rad) < 0, math.pi, apart)
        nearer: Flags = np.abs(apart) <= abs(nearest - wanted_rad)
        hidden = float(self.unseen[nearer].mean()) if nearer.any() else 0.0
        return (nearest, room) if hidden <= 1 - KNOWN else None


def arms(surface: RoadSurface) -> Arms:
    """Return the arms around the robot that a map of the surface shows."""
    outer, inner = (_ring(surface, radii) for radii in RINGS)
    classes = np.where(outer == UNSEEN, inner, outer)
    road = _closed(classes == ROAD)
    rings = [_at(surface, radius) for radius in INWARD]
    found = [
        Arm(BEARINGS[first] - STEP_RAD / 2, BEARINGS[first] + (count - 0.5) * STEP_RAD)
        for first, count in _runs(road)
        if count >= NARROWEST and _connected(_run_flags(first, count), rings)
    ]
    return Arms(tuple(found), classes == UNSEEN)


def leads_on(surface: RoadSurface, road: RoadSeen, opening: RoadOpening) -> bool | None:
    """Return whether an opening of a road's edge leads on, not into a lay-by; None: not seen."""
    near_m = 0.0 if opening.near_m is None else opening.near_m
    far_m = near_m if opening.far_m is None else opening.far_m
    x = np.arange(near_m - AROUND_M, far_m + AROUND_M, surface.cell_m)
    slope = math.tan(road.heading_rad) + road.curvature_1pm * x
    middle = road.offset_m + (math.tan(road.heading_rad) + road.curvature_1pm * x / 2) * x
    side = 1.0 if opening.side == "left" else -1.0
    beyond = side * (road.width_m / 2 + np.array(DEEP_M)[:, None]) * np.hypot(1.0, slope)
    seen = surface.classes(np.broadcast_to(x, beyond.shape), middle + beyond)
    on_road, off_road = float((seen == ROAD).mean()), float((seen == OFF_ROAD).mean())
    if on_road >= SOME_ROAD:
        return True
    return False if on_road <= NO_ROAD and off_road >= SEEN else None


def _near(bearing_rad: float, wanted_rad: float) -> float:
    return wanted_rad + math.remainder(bearing_rad - wanted_rad, 2 * math.pi)


def _at(surface: RoadSurface, radius_m: float) -> Classes:
    return surface.classes(radius_m * np.cos(BEARINGS), radius_m * np.sin(BEARINGS))


def _ring(surface: RoadSurface, radii: tuple[float, ...]) -> Classes:
    seen = np.stack([_at(surface, radius) for radius in radii])
    road, off = (seen == ROAD).sum(axis=0), (seen == OFF_ROAD).sum(axis=0)
    most = np.full(DIRECTIONS, UNSEEN, np.int8)
    most[off >= 2] = OFF_ROAD
    most[road >= 2] = ROAD
    return most


def _closed(road: Flags) -> Flags:
    """Return the directions with surface, gaps of up to `GAP` filled."""
    filled = road.copy()
    for first, count in _runs(~road):
        if count <= GAP and count < DIRECTIONS:
            filled |= _run_flags(first, count)
    return filled


def _runs(flags: Flags) -> Iterator[tuple[int, int]]:
    """Yield (first direction, how many) of the runs of set flags around the circle."""
    starts = np.flatnonzero(flags & ~np.roll(flags, 1))
    if starts.size == 0 and flags.any():
        yield 0, DIRECTIONS
    for start in starts:
        yield int(start), int(np.argmin(np.roll(flags, -start)))


def _run_flags(first: int, count: int) -> Flags:
    flags = np.zeros(DIRECTIONS, np.bool_)
    flags[(first + np.arange(count)) % DIRECTIONS] = True
    return flags


def _connected(arm: Flags, rings: list[Classes]) -> bool:
    """Return whether nothing was seen to part an arm from the robot."""
    for ring in rings:
        near = arm.copy()
        for shift in range(1, SLANT + 1):
            near |= np.roll(arm, shift) | np.roll(arm, -shift)
        inward: Flags = near & (ring != OFF_ROAD)
        if not inward.any():
            return False
        arm = inward
    return True
