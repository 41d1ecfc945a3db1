"""The road graph of a random town: a bent grid, some of its crossings opened, split and skewed.

Everything here is deterministic in the generator that it is given. `draw_roads` may fail for one
draw (roads too close, bends too tight): it says so by None and the caller draws again.
"""

import math
from collections import defaultdict
from dataclasses import dataclass, field

import numpy as np

from juncnet.simulation.roads import (
    Points,
    arc_lengths,
    setbacks,
    smallest_radius,
    smooth_curve,
)
from juncnet.simulation.world import Marking, Node, Road, Surface, wrap

MIN_RADIUS_M = 12.0
MIN_GAP_RAD = math.radians(52.0)
"""Smallest angle between two arms of a junction."""
MIN_STRAIGHT_M = 6.5
"""Arms leave a junction straight for at least this long."""
BLOCK_M = (30.0, 69.0)
"""Shortest and longest road between two junctions that are not a staggered pair."""
APART_M = 12.0
"""Smallest distance between the edges of two roads that do not meet."""
_ROUNDS = 9
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
class _Draft:
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


def draw_roads(
    rng: np.random.Generator, plan: TownPlan
) -> tuple[dict[int, Node], dict[int, Road]] | None:
    """Return the nodes and roads of one draw of `plan`, by id; None when this draw is no town."""
    draft = _grid(rng, plan)
    _corners(rng, draft, plan)
    _stubs(rng, draft, plan)
    _openings(rng, draft, plan)
    split = _stagger(rng, draft, plan)
    _aim(draft)
    _shape(rng, draft, plan, split)
    widths = _widths(rng, draft, plan)
    curves = _settle(draft, widths, split)
    return None if curves is None else _pave(rng, draft, plan, widths, curves)


def _grid(rng: np.random.Generator, plan: TownPlan) -> _Draft:
    across = np.concatenate([[0.0], np.cumsum(rng.uniform(*plan.block_m, plan.columns - 1))])
    along = np.concatenate([[0.0], np.cumsum(rng.uniform(*plan.block_m, plan.rows - 1))])
    lean = rng.uniform(-plan.shear, plan.shear)
    turn = rng.uniform(0, 2 * math.pi)
    c, s = math.cos(turn), math.sin(turn)
    draft = _Draft({})
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


def _stub(rng: np.random.Generator, draft: _Draft, key: Key, step: tuple[int, int]) -> None:
    """Add a dead end that leaves `key` away from the neighbour opposite to `step`."""
    i, j = key
    direction = draft.chord((i - step[0], j - step[1]), key) + rng.uniform(-0.1, 0.1)
    length = rng.uniform(38.0, 48.0)
    end = (*key, 1 + _STEPS.index(step))
    draft.place[end] = draft.place[key] + length * np.array(
        [math.cos(direction), math.sin(direction)]
    )
    draft.link(key, end)


def _corners(rng: np.random.Generator, draft: _Draft, plan: TownPlan) -> None:
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


def _stubs(rng: np.random.Generator, draft: _Draft, plan: TownPlan) -> None:
    """Let roads run out of the grid at some nodes of its border."""
    border = [k for k in draft.place if len(k) == 2 and _outwards(plan, k)]
    border = [k for k in border if not any(len(n) == 3 and n[2] < 10 for n in draft.near(k))]
    chosen = rng.permutation(len(border))[: max(2, len(border) // 2)]
    for index in sorted(chosen.tolist()):
        _stub(rng, draft, border[index], _outwards(plan, border[index])[0])


def _openings(rng: np.random.Generator, draft: _Draft, plan: TownPlan) -> None:
    """Take roads out where both ends remain junctions."""
    left = plan.openings
    links = sorted(draft.links)
    for index in rng.permutation(len(links)).tolist():
        a, b = links[index]
        if left and len(a) == len(b) == 2 and min(len(draft.near(a)), len(draft.near(b))) >= 4:
            draft.cut(a, b)
            left -= 1


def _stagger(rng: np.random.Generator, draft: _Draft, plan: TownPlan) -> set[Key]:
    """Split crossroads into two T junctions close to each other; return all these nodes."""
    split: set[Key] = set()
    crossings = [k for k in draft.place if len(k) == 2 and len(draft.near(k)) == 4]
    for index in rng.permutation(len(crossings)).tolist():
        key = crossings[index]
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
    return split


def _aim(draft: _Draft) -> None:
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


def _shape(rng: np.random.Generator, draft: _Draft, plan: TownPlan, split: set[Key]) -> None:
    """Twist the junctions, and make forks and skewed crossings of some of them."""
    junctions = [key for key in draft.place if len(draft.near(key)) >= 3 and key not in split]
    forks, skewed = plan.forks, plan.skewed
    for index in rng.permutation(len(junctions)).tolist():
        key = junctions[index]
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


def _stem(draft: _Draft, key: Key) -> Key | None:
    """Return the arm of a T that has no arm opposite to it."""
    around = draft.near(key)
    for stem in around:
        others = [draft.heading[key, other] for other in around if other != stem]
        if abs(wrap(others[0] - others[1])) > math.radians(150):
            return stem
    return None


def _axis(draft: _Draft, key: Key) -> tuple[Key, ...]:
    """Return two arms of a crossing that lie opposite to each other."""
    around = draft.near(key)
    first = around[0]
    opposite = max(
        around, key=lambda o: abs(wrap(draft.heading[key, o] - draft.heading[key, first]))
    )
    return (first, opposite)


def _settle(
    draft: _Draft, widths: dict[tuple[Key, Key], float], split: set[Key]
) -> dict[tuple[Key, Key], Points] | None:
    """Return the centre line of each link; what is too tight is bent less, until it fits or not."""
    for _ in range(_ROUNDS):
        straight: dict[tuple[Key, Key], float] = {}
        crowded = [key for key in sorted(draft.place) if not _open(draft, key, widths, straight)]
        for key in crowded:
            _relax(draft, key, 0.6, 1.0)
        if crowded:
            continue
        curves: dict[tuple[Key, Key], Points] = {}
        tight: list[tuple[Key, Key]] = []
        for link in sorted(draft.links):
            curve = _curve(draft, link, straight, split)
            if curve is None:
                tight.append(link)
            else:
                curves[link] = curve
        if not tight:
            return curves
        for key in sorted({key for link in tight for key in link}):
            _relax(draft, key, 0.85, 0.6)
    return None


def _relax(draft: _Draft, key: Key, offset: float, twist: float) -> None:
    draft.twist[key] = draft.twist.get(key, 0.0) * twist
    draft.tip[key] *= twist
    for other in draft.near(key):
        draft.offset[key, other] = draft.offset.get((key, other), 0.0) * offset


def _open(
    draft: _Draft,
    key: Key,
    widths: dict[tuple[Key, Key], float],
    straight: dict[tuple[Key, Key], float],
) -> bool:
    """Return whether the arms at `key` are far enough apart; note how long they are straight."""
    around = draft.near(key)
    if len(around) < 3:
        straight.update({(key, other): 1.0 for other in around})
        return True
    headings = [draft.leaving(key, other) for other in around]
    if not _wide_apart(headings):
        return False
    back = setbacks(headings, [widths[_ordered(key, other)] for other in around])
    for other, setback in zip(around, back, strict=True):
        straight[key, other] = max(MIN_STRAIGHT_M, setback + 1.0)
    return True


def _curve(
    draft: _Draft,
    link: tuple[Key, Key],
    straight: dict[tuple[Key, Key], float],
    split: set[Key],
) -> Points | None:
    """Return the centre line of a link, a dead end last; None where it is no road to drive."""
    a, b = _dead_end_last(draft, link)
    if straight[a, b] + straight[b, a] > 0.8 * float(np.hypot(*(draft.place[b] - draft.place[a]))):
        return None
    arriving = draft.leaving(b, a) + math.pi
    dead_end = len(draft.near(b)) == 1
    if dead_end:
        arriving = 2 * draft.chord(a, b) - draft.leaving(a, b) + draft.tip[b]
    ends = (straight[a, b], straight[b, a])
    centre = smooth_curve(draft.place[a], draft.leaving(a, b), draft.place[b], arriving, ends)
    if smallest_radius(centre) < MIN_RADIUS_M:
        return None
    free = dead_end or (a in split and b in split)
    length = float(arc_lengths(centre)[-1])
    return centre if free or BLOCK_M[0] <= length <= BLOCK_M[1] else None


def _dead_end_last(draft: _Draft, link: tuple[Key, Key]) -> tuple[Key, Key]:
    a, b = link
    return (b, a) if len(draft.near(a)) == 1 else (a, b)


def _pave(
    rng: np.random.Generator,
    draft: _Draft,
    plan: TownPlan,
    widths: dict[tuple[Key, Key], float],
    curves: dict[tuple[Key, Key], Points],
) -> tuple[dict[int, Node], dict[int, Road]] | None:
    ids = {key: number for number, key in enumerate(sorted(draft.place))}
    roads: dict[int, Road] = {}
    for number, (link, centre) in enumerate(sorted(curves.items(), key=lambda item: item[0])):
        a, b = _dead_end_last(draft, link)
        look = _look(rng, plan, widths[link])
        roads[number] = Road(number, ids[a], ids[b], centre, widths[link], *look)
    if not _clear(roads):
        return None
    nodes = {ids[k]: Node(ids[k], float(p[0]), float(p[1])) for k, p in draft.place.items()}
    return nodes, roads


def _ordered(a: Key, b: Key) -> tuple[Key, Key]:
    return (a, b) if a < b else (b, a)


def _widths(
    rng: np.random.Generator, draft: _Draft, plan: TownPlan
) -> dict[tuple[Key, Key], float]:
    """Choose widths: roads of one street (same row or column of the grid) are about as wide."""
    low, high = plan.widths_m
    streets: dict[tuple[str, int], float] = defaultdict(
        lambda: float(low + (high - low) * rng.beta(1.4, 1.8))
    )
    widths: dict[tuple[Key, Key], float] = {}
    for a, b in sorted(draft.links):
        row = a[1] == b[1] and (a[0] != b[0] or b[2] in (1, 3))
        street = streets["row" if row else "column", a[1] if row else a[0]]
        widths[a, b] = round(float(np.clip(street + rng.uniform(-0.5, 0.5), low, high)), 2)
    return widths


def _look(
    rng: np.random.Generator, plan: TownPlan, width_m: float
) -> tuple[Surface, Marking, bool]:
    surface = plan.surfaces[int(rng.integers(len(plan.surfaces)))]
    kerb = surface in ("asphalt", "concrete", "cobble") and rng.random() < plan.kerbs
    if surface not in ("asphalt", "concrete") or width_m < 4.6:
        return surface, "none", kerb
    markings: tuple[Marking, ...] = ("none", "centre_dashed", "centre_solid", "edges", "full")
    chances = [0.2, 0.35, 0.1, 0.15, 0.2]
    return surface, markings[int(rng.choice(len(markings), p=chances))], kerb


def _wide_apart(headings: list[float]) -> bool:
    ordered = sorted(h % (2 * math.pi) for h in headings)
    gaps = [
        (b - a) % (2 * math.pi) for a, b in zip(ordered, ordered[1:] + ordered[:1], strict=True)
    ]
    return min(gaps) >= MIN_GAP_RAD


def _clear(roads: dict[int, Road]) -> bool:
    """Return whether roads that do not meet keep apart, and those that do only meet at the node."""
    thin = {r.id: r.centre[::4] for r in roads.values()}
    for a in roads.values():
        for b in roads.values():
            if b.id <= a.id:
                continue
            least = APART_M + (a.width_m + b.width_m) / 2 + 1.0
            p, q = thin[a.id], thin[b.id]
            for node in {a.a, a.b} & {b.a, b.b}:
                p, q = _beyond(p, a, node), _beyond(q, b, node)
            if len(p) == 0 or len(q) == 0:
                continue
            apart = p[:, None, :] - q[None, :, :]
            if float(np.min(np.einsum("abk,abk->ab", apart, apart))) < least**2:
                return False
    return True


def _beyond(points: Points, road: Road, node: int) -> Points:
    """Return those of `points` that lie more than 26 m from the road's end at `node`."""
    end = road.centre[0] if road.a == node else road.centre[-1]
    return points[np.hypot(points[:, 0] - end[0], points[:, 1] - end[1]) > 26.0]
