"""Routes through a world: missions that can be driven, and the arms that they lead through."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from juncnet.messages import Mission, Turn
from juncnet.simulation.roads import RoadNetwork, arm_ends, arm_id, reverse_arm
from juncnet.simulation.world import World, shuffled, wrap

STRAIGHT_RAD = math.radians(40.0)
"""Up to this angle a way through a junction is straight on; up to `SHARPEST_RAD` it is a turn."""
SHARPEST_RAD = math.radians(140.0)
AFTER_LAST_M = 20.0
"""Road that must be left after the last junction of a planned mission."""


@dataclass(frozen=True)
class Route:
    """A mission and what driving it right looks like."""

    mission: Mission
    path: tuple[int, ...]
    """Directed road ids (`roads.arm_id`) in order, the first one being driven at the start."""
    length_m: float
    """Along the centre lines, from the start to `AFTER_LAST_M` beyond the last junction's mouth."""
    turns: int
    """Junctions of it that are not passed straight on."""


def turn_angle(network: RoadNetwork, arriving: int, leaving: int) -> float:
    """Return the angle [rad], left positive, from directed road `arriving` to arm `leaving`."""
    out, back = network.arm(leaving), network.arm(reverse_arm(arriving))
    if out is None or back is None:
        raise ValueError(f"roads {arriving} and {leaving} do not meet at a junction")
    return wrap(out.heading_rad - back.heading_rad - math.pi)


def ways(network: RoadNetwork, arriving: int) -> dict[int, float]:
    """Return the arms that lead on from directed road `arriving`, each with its angle [rad]."""
    junction = network.junctions.get(arm_ends(network.world, arriving)[1])
    if junction is None:
        return {}
    others = (arm.id for arm in junction.arms if arm.id != reverse_arm(arriving))
    return {other: turn_angle(network, arriving, other) for other in others}


def choose(angles: dict[int, float], turn: Turn) -> int | None:
    """Return the arm that `turn` means, the nearest to its angle; None: there is none near it."""
    wanted = {"left": math.pi / 2, "right": -math.pi / 2, "straight": 0.0}
    target = wanted[turn.turn] if turn.turn else math.radians(turn.angle_deg or 0.0)
    limit = math.pi / 4 if turn.angle_deg is not None else math.radians(50.0)
    if turn.turn == "straight":
        limit = STRAIGHT_RAD
    near = {arm: abs(wrap(angle - target)) for arm, angle in angles.items()}
    best = min(near, key=lambda arm: near[arm], default=None)
    return best if best is not None and near[best] <= limit else None


def start_arm(world: World) -> int:
    """Return the directed road on which the robot starts."""
    road = world.roads[world.start.road]
    return arm_id(road.id, road.b == world.start.towards)


def expected_path(world: World, mission: Mission, junctions: int | None = None) -> tuple[int, ...]:
    """Return the directed roads that `mission` leads through, the one at the start included.

    Args:
        world: where it is driven, from `world.start`.
        mission: what is driven; it ends after `finish_after`.
        junctions: how many junctions to follow it when it has no `finish_after`.

    Raises:
        ValueError: the mission asks for a way that is not there, or never ends.
    """
    last = mission.finish_after or junctions
    if last is None:
        raise ValueError("the mission never finishes: give junctions")
    network = RoadNetwork(world)
    path = [start_arm(world)]
    for count in range(1, last + 1):
        turn = mission.turn_at(count)
        arm = choose(ways(network, path[-1]), turn)
        if arm is None:
            way = turn.turn or f"{turn.angle_deg} deg"
            raise ValueError(f"junction {count} of the mission has no way {way}")
        path.append(arm)
    return tuple(path)


def plan_mission(world: World, seed: int, junctions: int = 5) -> Route:
    """Return a random mission through `junctions` junctions: some left, some right, some straight.

    Raises:
        ValueError: no such route starts at the world's start.
    """
    rng = np.random.default_rng([seed, junctions])
    network = RoadNetwork(world)
    path = next(_paths(network, rng, [start_arm(world)], junctions), None)
    if path is None:
        raise ValueError(f"world {world.name} has no route through {junctions} junctions")
    turns = [
        _name(rng, ways(network, arriving), leaving, count)
        for count, (arriving, leaving) in enumerate(pairwise(path), start=1)
    ]
    # Straight on is what happens where a mission names nothing: name it only now and then.
    listed = tuple(t for t in turns if t.turn != "straight" or rng.random() < 0.5)
    mission = Mission(name=f"{world.name}-{seed}-{junctions}", turns=listed, finish_after=junctions)
    return _route(network, mission, path)


def route_of(world: World, mission: Mission) -> Route:
    """Return what driving `mission` right from the world's start looks like.

    Raises:
        ValueError: the mission asks for a way that is not there, or never finishes.
    """
    return _route(RoadNetwork(world), mission, expected_path(world, mission))


def _route(network: RoadNetwork, mission: Mission, path: tuple[int, ...]) -> Route:
    angles = [turn_angle(network, a, b) for a, b in pairwise(path)]
    turns = sum(1 for angle in angles if _side(angle) != "straight")
    return Route(mission, path, path_length(network, path), turns)


def path_length(network: RoadNetwork, path: tuple[int, ...]) -> float:
    """Return the length [m] of a path from the world's start to 20 m beyond its last junction."""
    start = network.world.start
    here = network.nearest(np.array([[start.x_m, start.y_m]]))
    along = float(here.along_m[0])
    first = network.lengths[start.road] - along if path[0] % 2 == 0 else along
    between = sum(network.lengths[arm // 2] for arm in path[1:-1])
    return first + between + network.setback_m(path[-1]) + AFTER_LAST_M


def ideal_time_s(length_m: float, speed_mps: float, turns: int, yaw_rate_radps: float) -> float:
    """Return the time of a flight at constant speed that stops for a quarter turn at each turn."""
    return length_m / speed_mps + turns * (math.pi / 2) / yaw_rate_radps


def _paths(
    network: RoadNetwork, rng: np.random.Generator, path: list[int], junctions: int
) -> Iterator[tuple[int, ...]]:
    """Yield the paths of `junctions` junctions that begin with `path`, in random order."""
    if len(path) == junctions + 1:
        if _complete(network, path):
            yield tuple(path)
        return
    driven = {arm // 2 for arm in path}
    angles = ways(network, path[-1])
    for arm in shuffled(rng, sorted(angles)):
        if arm // 2 not in driven and abs(angles[arm]) <= SHARPEST_RAD and _sayable(angles, arm):
            yield from _paths(network, rng, [*path, arm], junctions)


def _complete(network: RoadNetwork, path: list[int]) -> bool:
    sides = {_side(ways(network, a)[b]) for a, b in pairwise(path)}
    last = path[-1]
    left = network.lengths[last // 2] - network.setback_m(last)
    left -= network.setback_m(reverse_arm(last))
    return len(sides) == 3 and left >= AFTER_LAST_M


def _side(angle: float) -> str:
    if abs(angle) < STRAIGHT_RAD:
        return "straight"
    return "left" if angle > 0 else "right"


def _sayable(angles: dict[int, float], arm: int) -> bool:
    """Return whether a turn exists that means this arm."""
    return choose(angles, _turn(angles, arm, 1)) == arm


def _turn(angles: dict[int, float], arm: int, count: int) -> Turn:
    side = _side(angles[arm])
    same = [a for a, angle in angles.items() if _side(angle) == side and abs(angle) <= SHARPEST_RAD]
    if len(same) > 1:
        return Turn(at=count, angle_deg=_degrees(angles[arm]))
    names = {"left": "left", "right": "right", "straight": "straight"}
    return Turn.model_validate({"at": count, "turn": names[side]})


def _name(rng: np.random.Generator, angles: dict[int, float], arm: int, count: int) -> Turn:
    """Return the turn that means `arm`; one in four turns is said as an angle."""
    turn = _turn(angles, arm, count)
    if turn.turn in ("left", "right") and rng.random() < 0.25:
        return Turn(at=count, angle_deg=_degrees(angles[arm]))
    return turn


def _degrees(angle: float) -> float:
    return float(5 * round(math.degrees(angle) / 5))
