"""The road graph of a random town: a grid, some of its crossings opened, split and skewed.

Everything here is deterministic in the generator that it is given.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from juncnet.simulation.roads import Points
from juncnet.simulation.world import Surface, shuffled, wrap

_TWIN = 20
"""Third number in the key of a staggered pair's second node; 1..4, 11, 12: of a dead end."""
_STEPS = ((1, 0), (0, 1), (-1, 0), (0, -1))

Key = tuple[int, ...]


@dataclass(frozen=True)
class TownPlan:
    """What a town's roads are like; probabilities are 0..1, angles radians, lengths metres."""

    columns: int = 4
    rows: int = 4
    block_m: tuple[float, float] = (41.0, 49.0)
    shear: float = 0.35
    """Largest lean of the grid, as x per y."""
    twist_rad: float = 0.36
    """Largest rotation of a junction against the grid: what bends the roads between them."""
    openings: int = 5
    """Roads taken out of the grid: what makes T junctions of crossroads."""
    staggered: int = 1
    forks: int = 2
    """Y junctions."""
    skewed: int = 2
    surfaces: tuple[Surface, ...] = ("asphalt", "asphalt", "concrete", "gravel", "cobble", "dirt")
    widths_m: tuple[float, float] = (4.0, 8.0)
    kerbs: float = 0.3


@dataclass
class Draft:
    """A road graph under construction: positions, links, and the heading of each arm."""

    place: dict[Key, Points]
    links: set[tuple[Key, Key]] = field(default_factory=set[tuple[Key, Key]])
    heading: dict[tuple[Key, Key], float] = field(default_factory=dict[tuple[Key, Key], float])
    """Of the arm that leaves the first node towards the second, before it is bent."""
    offset: dict[tuple[Key, Key], float] = field(default_factory=dict[tuple[Key, Key], float])
    """What makes a fork or a skewed crossing of it."""
    twist: dict[Key, float] = field(default_factory=dict[Key, float])
    """Rotation of all arms of a node."""
    tip: dict[Key, float] = field(default_factory=dict[Key, float])
    """How much more than an arc the road to a dead end bends."""
    via: dict[tuple[Key, Key], Points] = field(default_factory=dict[tuple[Key, Key], Points])
    """Where the arms of a bend aim."""
    split: set[Key] = field(default_factory=set[Key])
    """Nodes of staggered pairs."""

    def leaving(self, a: Key, b: Key) -> float:
        return self.heading[a, b] + self.offset.get((a, b), 0.0) + self.twist.get(a, 0.0)

    def near(self, key: Key) -> list[Key]:
        return sorted({b if a == key else a for a, b in self.links if key in (a, b)})

    def link(self, a: Key, b: Key) -> None:
        self.links.add((a, b) if a < b else (b, a))

    def cut(self, a: Key, b: Key) -> None:
        self.links.discard((a, b) if a < b else (b, a))

    def chord(self, a: Key, b: Key) -> float:
        d = self.place[b] - self.place[a]
        return math.atan2(d[1], d[0])


def draft_town(rng: np.random.Generator, plan: TownPlan) -> Draft:
    """Return one draw of `plan`: where junctions are, what links them, how their arms leave."""
    draft = _grid(rng, plan)
    _corners(rng, draft, plan)
    _stubs(rng, draft, plan)
    _openings(rng, draft, plan)
    _stagger(rng, draft, plan)
    _aim(draft)
    _shape(rng, draft, plan)
    return draft


def _grid(rng: np.random.Generator, plan: TownPlan) -> Draft:
    across = np.concatenate([[0.0], np.cumsum(rng.uniform(*plan.block_m, plan.columns - 1))])
    along = np.concatenate([[0.0], np.cumsum(rng.uniform(*plan.block_m, plan.rows - 1))])
    lean = rng.uniform(-plan.shear, plan.shear)
    turn = rng.uniform(0, 2 * math.pi)
    c, s = math.cos(turn), math.sin(turn)
    draft = Draft({})
    for i in range(plan.columns):
        for j in range(plan.rows):
            x, y = across[i] + rng.uniform(-3, 3), along[j] + rng.uniform(-3, 3)
            x, y = x - across[-1] / 2 + lean * (y - along[-1] / 2), y - along[-1] / 2
            draft.place[i, j] = np.array([c * x - s * y, s * x + c * y])
    for i, j in list(draft.place):
        for di, dj in _STEPS[:2]:
            if (i + di, j + dj) in draft.place:
                draft.link((i, j), (i + di, j + dj))
    return draft


def _outwards(plan: TownPlan, key: Key) -> list[tuple[int, int]]:
    """Return the grid steps that lead out of the grid at `key`."""
    i, j = key
    inside = ((i + di, j + dj) for di, dj in _STEPS)
    return [
        step
        for step, (a, b) in zip(_STEPS, inside, strict=True)
        if not (0 <= a < plan.columns and 0 <= b < plan.rows)
    ]


def _stub(rng: np.random.Generator, draft: Draft, key: Key, step: tuple[int, int]) -> None:
    """Add a dead end that leaves `key` away from the neighbour opposite to `step`."""
    i, j = key
    direction = draft.chord((i - step[0], j - step[1]), key) + rng.uniform(-0.1, 0.1)
    length = rng.uniform(38.0, 48.0)
    end = (*key, 1 + _STEPS.index(step))
    draft.place[end] = draft.place[key] + length * np.array(
        [math.cos(direction), math.sin(direction)]
    )
    draft.link(key, end)


def _corners(rng: np.random.Generator, draft: Draft, plan: TownPlan) -> None:
    """Make of each corner of the grid a bend, a T, or two dead ends."""
    for i in (0, plan.columns - 1):
        for j in (0, plan.rows - 1):
            key, (a, b) = (i, j), draft.near((i, j))
            kind = rng.choice(["bend", "tee", "ends"], p=[0.6, 0.25, 0.15])
            if kind == "bend" and float(np.hypot(*(draft.place[a] - draft.place[b]))) > 63.0:
                kind = "ends"
            if kind == "tee":
                steps = _outwards(plan, key)
                _stub(rng, draft, key, steps[int(rng.integers(len(steps)))])
                continue
            draft.cut(key, a)
            draft.cut(key, b)
            if kind == "bend":
                draft.link(a, b)
                middle = (draft.place[a] + draft.place[b]) / 2
                draft.via[a, b] = draft.via[b, a] = 0.45 * draft.place[key] + 0.55 * middle
            else:
                for number, near in ((1, a), (2, b)):
                    share = rng.uniform(0.55, 0.7)
                    end = (*key, 10 + number)
                    draft.place[end] = draft.place[near] * (1 - share) + draft.place[key] * share
                    draft.link(near, end)
            del draft.place[key]


def _stubs(rng: np.random.Generator, draft: Draft, plan: TownPlan) -> None:
    """Let roads run out of the grid at some nodes of its border."""
    border = [k for k in draft.place if len(k) == 2 and _outwards(plan, k)]
    border = [k for k in border if not any(len(n) == 3 and n[2] < 10 for n in draft.near(k))]
    for key in sorted(shuffled(rng, border)[: max(2, len(border) // 2)]):
        _stub(rng, draft, key, _outwards(plan, key)[0])


def _openings(rng: np.random.Generator, draft: Draft, plan: TownPlan) -> None:
    """Take roads out where both ends remain junctions."""
    left = plan.openings
    for a, b in shuffled(rng, sorted(draft.links)):
        if left and len(a) == len(b) == 2 and min(len(draft.near(a)), len(draft.near(b))) >= 4:
            draft.cut(a, b)
            left -= 1


def _stagger(rng: np.random.Generator, draft: Draft, plan: TownPlan) -> None:
    """Split crossroads into two T junctions close to each other."""
    split = draft.split
    crossings = [k for k in draft.place if len(k) == 2 and len(draft.near(k)) == 4]
    for key in shuffled(rng, crossings):
        if len(split) >= 2 * plan.staggered:
            break
        if split & set(draft.near(key)):
            continue
        around = sorted(draft.near(key), key=lambda other: draft.chord(key, other))
        lengths = [float(np.hypot(*(draft.place[k] - draft.place[key]))) for k in around]
        if min(lengths[0], lengths[2]) < min(lengths[1], lengths[3]):
            around = around[1:] + around[:1]
        first, second = around[0], around[2]
        axis = draft.place[second] - draft.place[first]
        shift = rng.uniform(11.3, 13.0) * axis / np.hypot(*axis)
        twin = (*key, _TWIN)
        draft.place[twin] = draft.place[key] + shift
        draft.place[key] = draft.place[key] - shift
        for moved in (second, around[3]):
            draft.cut(key, moved)
            draft.link(twin, moved)
        draft.link(key, twin)
        split |= {key, twin}


def _aim(draft: Draft) -> None:
    """Let every arm leave towards its neighbour, opposite arms in one line."""
    for key in draft.place:
        around = draft.near(key)
        for other in around:
            aim = draft.via.get((key, other), draft.place[other]) - draft.place[key]
            draft.heading[key, other] = math.atan2(aim[1], aim[0])
        for a in around:
            for b in around:
                gap = wrap(draft.heading[key, b] - draft.heading[key, a])
                if a < b and abs(gap) > math.radians(140):
                    kink = wrap(gap - math.pi)
                    # The short road between a staggered pair stays straight.
                    share = 0.0 if _TWIN in (*key[2:], *a[2:]) and a[:2] == key[:2] else 0.5
                    if _TWIN in (*key[2:], *b[2:]) and b[:2] == key[:2]:
                        share = 1.0
                    draft.heading[key, a] += share * kink
                    draft.heading[key, b] -= (1 - share) * kink


def _shape(rng: np.random.Generator, draft: Draft, plan: TownPlan) -> None:
    """Twist the junctions, and make forks and skewed crossings of some of them."""
    junctions = [key for key in draft.place if len(draft.near(key)) >= 3 and key not in draft.split]
    forks, skewed = plan.forks, plan.skewed
    for key in shuffled(rng, junctions):
        around = draft.near(key)
        stem = _stem(draft, key) if len(around) == 3 else None
        if stem is not None and forks:
            forks -= 1
            bend = rng.uniform(math.radians(24), math.radians(33))
            for other in around:
                if other != stem:
                    side = wrap(draft.heading[key, other] - draft.heading[key, stem])
                    draft.offset[key, other] = math.copysign(bend, side)
        elif skewed:
            skewed -= 1
            angle = rng.choice([-1, 1]) * rng.uniform(math.radians(16), math.radians(30))
            for other in [stem] if stem is not None else _axis(draft, key):
                draft.offset[key, other] = angle
        draft.twist[key] = rng.uniform(-plan.twist_rad, plan.twist_rad)
    for key in draft.place:
        draft.tip[key] = rng.uniform(-0.25, 0.25)


def _stem(draft: Draft, key: Key) -> Key | None:
    """Return the arm of a T that has no arm opposite to it."""
    around = draft.near(key)
    for stem in around:
        others = [draft.heading[key, other] for other in around if other != stem]
        if abs(wrap(others[0] - others[1])) > math.radians(150):
            return stem
    return None


def _axis(draft: Draft, key: Key) -> tuple[Key, ...]:
    """Return two arms of a crossing that lie opposite to each other."""
    around = draft.near(key)
    first = around[0]
    opposite = max(
        around, key=lambda o: abs(wrap(draft.heading[key, o] - draft.heading[key, first]))
    )
    return (first, opposite)
