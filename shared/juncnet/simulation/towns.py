"""Simulated worlds by seed and by name: complete, deterministic, made in a fraction of a second."""

import math
from dataclasses import dataclass, replace

import numpy as np

from juncnet.simulation.paving import draw_roads
from juncnet.simulation.roads import Junction, RoadNetwork, arc_lengths
from juncnet.simulation.roadside import Density, furnish
from juncnet.simulation.routes import plan_mission
from juncnet.simulation.townplan import TownPlan
from juncnet.simulation.world import Road, Start, Style, TimeOfDay, World, shuffled, wrap

PALETTES = ("temperate", "dry", "autumn", "nordic", "suburb")
"""Palettes of random worlds. `withheld` exists too: only an explicit style uses it, for tests."""
TIMES_OF_DAY: tuple[TimeOfDay, ...] = ("morning", "noon", "evening", "overcast")
STAGGERED_M = 32.0
"""Two T junctions on one road, this close or closer, are a staggered junction."""
BEND_RAD = math.radians(30.0)
"""A road whose heading changes by more than this has a bend."""
START_M = 25.0
"""Road before the first junction's mouth at least."""
_DRAWS = 400


def light(time_of_day: TimeOfDay, rng: np.random.Generator) -> dict[str, float]:
    """Return the sun, shadow and haze of a time of day as fields of `Style`."""
    azimuth = {"morning": 0.3, "noon": -1.5, "evening": 3.4, "overcast": 0.8}[time_of_day]
    elevation = {"morning": 0.5, "noon": 1.05, "evening": 0.33, "overcast": 0.9}[time_of_day]
    shadow = {"morning": 0.45, "noon": 0.5, "evening": 0.4, "overcast": 0.05}[time_of_day]
    return {
        "sun_azimuth_rad": azimuth + float(rng.uniform(-0.6, 0.6)),
        "sun_elevation_rad": elevation * float(rng.uniform(0.85, 1.15)),
        "shadow": shadow * float(rng.uniform(0.8, 1.15)),
        "haze": float(rng.uniform(0.05, 0.3)),
    }


def make_style(palette: str, time_of_day: TimeOfDay, seed: int = 0) -> Style:
    """Return the style of a palette at a time of day; `seed` varies the light a little."""
    sun = light(time_of_day, np.random.default_rng([seed, 3]))
    return Style(palette=palette, time_of_day=time_of_day, **sun)


def random_style(seed: int) -> Style:
    """Return a style drawn by `seed`; never the withheld one."""
    rng = np.random.default_rng([seed, 2])
    palette = PALETTES[int(rng.integers(len(PALETTES)))]
    return make_style(palette, TIMES_OF_DAY[int(rng.integers(len(TIMES_OF_DAY)))], seed)


def random_world(seed: int, style: Style | None = None) -> World:
    """Return the world of `seed`: always the same for the same seed, whatever its style.

    It has at least three kinds of junction, a bend, and a start from which missions through 4, 5
    and 6 junctions can be driven.
    """
    return _build(f"random-{seed}", seed, TownPlan(), Density(), style or random_style(seed))


@dataclass(frozen=True)
class _Named:
    seed: int
    plan: TownPlan
    density: Density
    palette: str
    time_of_day: TimeOfDay


_NAMED = {
    "crossing_town": _Named(
        11,
        TownPlan(openings=2, surfaces=("asphalt", "asphalt", "concrete"), kerbs=0.6),
        Density(cars=18),
        "temperate",
        "noon",
    ),
    "tee_village": _Named(
        12,
        TownPlan(openings=8, forks=3, widths_m=(4.0, 6.5), kerbs=0.1),
        Density(trees=180, cars=6),
        "autumn",
        "morning",
    ),
    "skew_hills": _Named(
        13,
        TownPlan(shear=0.45, twist_rad=0.42, skewed=4, surfaces=("gravel", "asphalt", "concrete")),
        Density(houses=14, trees=110),
        "dry",
        "noon",
    ),
    "muddy_hamlet": _Named(
        14,
        TownPlan(surfaces=("dirt", "gravel", "cobble"), widths_m=(4.0, 6.0), kerbs=0.0),
        Density(patches=110, mud=0.7, paths=12, cars=4, houses=18),
        "nordic",
        "overcast",
    ),
    "evening_suburb": _Named(
        15,
        TownPlan(surfaces=("asphalt", "asphalt", "cobble"), widths_m=(5.0, 8.0), kerbs=0.9),
        Density(houses=40, cars=28, paths=14),
        "suburb",
        "evening",
    ),
}
WORLD_NAMES = tuple(_NAMED)
"""Names that `named_world` knows."""


def named_world(name: str, style: Style | None = None) -> World:
    """Return the world called `name`, in its own look unless a `style` is given.

    Raises:
        ValueError: there is no such world; the text lists those that there are.
    """
    if name not in _NAMED:
        raise ValueError(f"no world {name!r}: choose one of {', '.join(WORLD_NAMES)}")
    row = _NAMED[name]
    own = make_style(row.palette, row.time_of_day, row.seed)
    return _build(name, row.seed, row.plan, row.density, style or own)


def junction_kind(network: RoadNetwork, node: int) -> str:
    """Return `crossroads`, `tee`, `fork` (Y), `staggered` or `skewed`: what a person calls it."""
    junction = network.junctions[node]
    gaps = _gaps(junction)
    if len(gaps) > 3:
        return "skewed" if max(gaps) > math.radians(104) else "crossroads"
    if _twin(network, junction):
        return "staggered"
    if max(gaps) < math.radians(157):
        return "fork"
    return "skewed" if min(gaps) < math.radians(76) else "tee"


def is_bend(road: Road) -> bool:
    """Return whether the heading of `road` changes by more than 30 degrees."""
    steps = np.diff(road.centre, axis=0)
    heading = np.unwrap(np.arctan2(steps[:, 1], steps[:, 0]))
    return float(np.ptp(heading)) > BEND_RAD


def _gaps(junction: Junction) -> list[float]:
    headings = sorted(arm.heading_rad % (2 * math.pi) for arm in junction.arms)
    following = headings[1:] + headings[:1]
    return [(b - a) % (2 * math.pi) for a, b in zip(headings, following, strict=True)]


def _twin(network: RoadNetwork, junction: Junction) -> bool:
    for arm in junction.arms:
        road = network.world.roads[arm.road]
        other = road.b if road.a == junction.id else road.a
        if other in network.junctions and network.lengths[road.id] <= STAGGERED_M:
            return True
    return False


def _build(name: str, seed: int, plan: TownPlan, density: Density, style: Style) -> World:
    rng = np.random.default_rng([seed, 1])
    for _ in range(_DRAWS):
        drawn = draw_roads(rng, plan)
        if drawn is None:
            continue
        nodes, roads = drawn
        nowhere = Start(0.0, 0.0, 0.0, next(iter(roads)), 0)
        world = World(name, seed, nodes, roads, nowhere, style=style)
        network = RoadNetwork(world)
        if not _varied(network):
            continue
        start = _start(rng, network)
        if start is None:
            continue
        side = furnish(rng, network, density)
        return replace(
            world,
            start=start,
            paths=side.paths,
            boxes=side.boxes,
            trees=side.trees,
            patches=side.patches,
        )
    raise RuntimeError(f"no town came of seed {seed} in {_DRAWS} draws")


def _varied(network: RoadNetwork) -> bool:
    kinds = {junction_kind(network, node) for node in network.junctions}
    return len(kinds) >= 3 and any(is_bend(road) for road in network.world.roads.values())


def _start(rng: np.random.Generator, network: RoadNetwork) -> Start | None:
    """Return a start on a dead end, or on any long road, from which missions can be driven."""
    world = network.world
    candidates = [
        (road, towards)
        for road in world.roads.values()
        for towards in (road.a, road.b)
        if towards in network.junctions
    ]
    candidates = shuffled(rng, candidates)
    candidates.sort(key=lambda candidate: not _from_dead_end(network, *candidate))
    for road, towards in candidates:
        start = _start_on(network, road, towards)
        if start is not None and _has_routes(replace(world, start=start)):
            return start
    return None


def _from_dead_end(network: RoadNetwork, road: Road, towards: int) -> bool:
    return (road.b if road.a == towards else road.a) not in network.junctions


def _start_on(network: RoadNetwork, road: Road, towards: int) -> Start | None:
    points = road.centre if road.b == towards else road.centre[::-1]
    along = arc_lengths(points)
    ends = network.setback_m(2 * road.id), network.setback_m(2 * road.id + 1)
    begin, end = ends if road.b == towards else ends[::-1]
    index = int(np.searchsorted(along, begin + 2.5))
    if along[-1] - end - along[index] < START_M:
        return None
    step = points[index + 1] - points[index]
    x, y = points[index].tolist()
    return Start(x, y, wrap(math.atan2(step[1], step[0])), road.id, towards)


def _has_routes(world: World) -> bool:
    try:
        for junctions in (4, 5, 6):
            plan_mission(world, 0, junctions)
    except ValueError:
        return False
    return True
