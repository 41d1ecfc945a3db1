"""From a drafted town to its roads: curves that can be driven, widths, surfaces and markings."""

import math
from collections import defaultdict

import numpy as np

from juncnet.simulation.roads import (
    Points,
    arc_lengths,
    setbacks,
    smallest_radius,
    smooth_curve,
)
from juncnet.simulation.townplan import Draft, Key, TownPlan, draft_town
from juncnet.simulation.world import Marking, Node, Road, Surface

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

Link = tuple[Key, Key]


def draw_roads(
    rng: np.random.Generator, plan: TownPlan
) -> tuple[dict[int, Node], dict[int, Road]] | None:
    """Return the nodes and roads of one draw of `plan`, by id.

    None when this draw is no town (roads too close to each other, bends too tight): draw again.
    """
    draft = draft_town(rng, plan)
    widths = _widths(rng, draft, plan)
    curves = _settle(draft, widths)
    return None if curves is None else _pave(rng, draft, plan, widths, curves)


def _settle(draft: Draft, widths: dict[Link, float]) -> dict[Link, Points] | None:
    """Return the centre line of each link; what is too tight is bent less, until it fits or not."""
    for _ in range(_ROUNDS):
        straight: dict[Link, float] = {}
        crowded = [key for key in sorted(draft.place) if not _open(draft, key, widths, straight)]
        for key in crowded:
            _relax(draft, key, 0.6, 1.0)
        if crowded:
            continue
        curves: dict[Link, Points] = {}
        tight: list[Link] = []
        for link in sorted(draft.links):
            curve = _curve(draft, link, straight)
            if curve is None:
                tight.append(link)
            else:
                curves[link] = curve
        if not tight:
            return curves
        for key in sorted({key for link in tight for key in link}):
            _relax(draft, key, 0.85, 0.6)
    return None


def _relax(draft: Draft, key: Key, offset: float, twist: float) -> None:
    draft.twist[key] = draft.twist.get(key, 0.0) * twist
    draft.tip[key] *= twist
    for other in draft.near(key):
        draft.offset[key, other] = draft.offset.get((key, other), 0.0) * offset


def _open(
    draft: Draft,
    key: Key,
    widths: dict[Link, float],
    straight: dict[Link, float],
) -> bool:
    """Return whether the arms at `key` are far enough apart; note how long they are straight."""
    around = draft.near(key)
    if len(around) < 3:
        straight.update({(key, other): 1.0 for other in around})
        return True
    headings = [draft.leaving(key, other) for other in around]
    if not _wide_apart(headings):
        return False
    back = setbacks(headings, [widths[_link(key, other)] for other in around])
    for other, setback in zip(around, back, strict=True):
        straight[key, other] = max(MIN_STRAIGHT_M, setback + 1.0)
    return True


def _curve(
    draft: Draft,
    link: Link,
    straight: dict[Link, float],
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
    free = dead_end or (a in draft.split and b in draft.split)
    length = float(arc_lengths(centre)[-1])
    return centre if free or BLOCK_M[0] <= length <= BLOCK_M[1] else None


def _dead_end_last(draft: Draft, link: Link) -> Link:
    a, b = link
    return (b, a) if len(draft.near(a)) == 1 else (a, b)


def _pave(
    rng: np.random.Generator,
    draft: Draft,
    plan: TownPlan,
    widths: dict[Link, float],
    curves: dict[Link, Points],
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


def _link(a: Key, b: Key) -> Link:
    return (a, b) if a < b else (b, a)


def _widths(rng: np.random.Generator, draft: Draft, plan: TownPlan) -> dict[Link, float]:
    """Choose widths: roads of one street (same row or column of the grid) are about as wide."""
    low, high = plan.widths_m
    streets: dict[tuple[str, int], float] = defaultdict(
        lambda: float(low + (high - low) * rng.beta(1.4, 1.8))
    )
    widths: dict[Link, float] = {}
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
