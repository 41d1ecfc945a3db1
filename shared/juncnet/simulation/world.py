"""What a simulated world is made of: a road graph, what stands beside it, and its look.

World frame: metres, x east, y north, yaw counter-clockwise from x. Everything is plain data; the
generators are in `towns`, ground truth in `truth`, pictures in `render`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

T = TypeVar("T")
Surface = Literal["asphalt", "concrete", "cobble", "gravel", "dirt"]
Marking = Literal["none", "centre_dashed", "centre_solid", "edges", "full"]
TimeOfDay = Literal["morning", "noon", "evening", "overcast"]


@dataclass(frozen=True)
class Node:
    """An end of roads. Three or more roads meet at a junction, two at a bend, one at a dead end."""

    id: int
    x_m: float
    y_m: float


@dataclass(frozen=True)
class Road:
    """A road from node `a` to node `b`."""

    id: int
    a: int
    b: int
    centre: NDArray[np.float64]
    """(N, 2) points of the centre line from a to b, at most 0.5 m apart."""
    width_m: float
    surface: Surface = "asphalt"
    marking: Marking = "centre_dashed"
    kerb: bool = False
    """Whether a light kerb and a pavement run along both sides."""


@dataclass(frozen=True)
class SidePath:
    """A narrow path or driveway that leaves a road and is not a junction: below 2.2 m wide."""

    centre: NDArray[np.float64]
    width_m: float
    surface: Surface = "dirt"


@dataclass(frozen=True)
class Box:
    """A building or a parked car, standing on the ground."""

    kind: Literal["building", "car"]
    x_m: float
    y_m: float
    yaw_rad: float
    length_m: float
    width_m: float
    height_m: float
    colour: tuple[int, int, int]
    """Blue, green, red, 0..255."""
    seed: int = 0
    """Of its windows, roof and other details."""


@dataclass(frozen=True)
class Tree:
    """A tree or a bush: a crown on a trunk."""

    x_m: float
    y_m: float
    radius_m: float
    height_m: float
    seed: int = 0


@dataclass(frozen=True)
class Patch:
    """A patch of mud, a puddle or a repaired surface, anywhere on the ground."""

    kind: Literal["mud", "puddle", "repair"]
    x_m: float
    y_m: float
    radius_m: float
    seed: int = 0


@dataclass(frozen=True)
class Style:
    """How a world looks: palette, light, weather. `palette` names a row of the renderer's table."""

    palette: str = "temperate"
    time_of_day: TimeOfDay = "noon"
    sun_azimuth_rad: float = 0.8
    """Direction from which the sun shines; shadows fall the other way."""
    sun_elevation_rad: float = 0.9
    shadow: float = 0.5
    """0: none; 1: black."""
    haze: float = 0.1
    """0..1: how much of the far ground is lost in the sky's colour at 200 m."""


@dataclass(frozen=True)
class Start:
    """Where a robot starts: on the centre line of `road`, heading along it."""

    x_m: float
    y_m: float
    yaw_rad: float
    road: int
    towards: int
    """Node id it drives towards."""


@dataclass(frozen=True)
class World:
    """A world: what a seed or a name gives, complete."""

    name: str
    seed: int
    nodes: dict[int, Node]
    roads: dict[int, Road]
    start: Start
    paths: tuple[SidePath, ...] = ()
    boxes: tuple[Box, ...] = ()
    trees: tuple[Tree, ...] = ()
    patches: tuple[Patch, ...] = ()
    style: Style = field(default_factory=Style)

    def roads_at(self, node: int) -> list[Road]:
        """Return the roads that end at `node`, by id."""
        return [r for _, r in sorted(self.roads.items()) if node in (r.a, r.b)]

    def is_junction(self, node: int) -> bool:
        """Return whether three or more roads meet at `node`."""
        return len(self.roads_at(node)) >= 3

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """(x_min, y_min, x_max, y_max) of all roads, metres."""
        points = np.concatenate([r.centre for r in self.roads.values()])
        low, high = points.min(axis=0), points.max(axis=0)
        return (float(low[0]), float(low[1]), float(high[0]), float(high[1]))


def wrap(angle_rad: float) -> float:
    """Return the angle in (-pi, pi]."""
    return math.pi - (math.pi - angle_rad) % (2 * math.pi)


def shuffled(rng: np.random.Generator, items: Sequence[T]) -> list[T]:
    """Return `items` in random order."""
    return [items[int(index)] for index in rng.permutation(len(items))]
