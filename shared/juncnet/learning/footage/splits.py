"""Which side of the data set a site or clip stands on: train, validation or test.

Frames of one drive resemble each other: a split by frame asks a model what it has seen. So whole
sites (or whole clips) are dealt out; single frames only where the paper's protocol is asked for.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from juncnet.learning.datasets import Split
from juncnet.learning.footage.intervals import SPLITS, FootageError

FRACTIONS = (0.7, 0.15, 0.15)
"""Of train, validation and test."""

Counts = Mapping[str, int]


def deal_groups(
    groups: Mapping[str, Counts],
    fixed: Mapping[str, Split],
    fractions: Sequence[float] = FRACTIONS,
    seed: int = 0,
) -> dict[str, Split]:
    """Return the split of every group (a site, or a clip).

    Groups go one by one, large ones first and equals in an order drawn by `seed`, to the split that
    lacks most of what the group has, class by class. A split that shall hold anything gets at least
    one group of every class that has enough groups.

    Args:
        groups: Frames by class, of each group.
        fixed: The split of groups for which the user has chosen.
        fractions: Wanted shares of train, validation and test; 0: that split stays empty.
        seed: Of the order among equals.

    Raises:
        FootageError: there are fewer groups than splits to fill.
    """
    wanted: list[Split] = [s for s, f in zip(SPLITS, fractions, strict=True) if f > 0]
    if len(groups) < len(wanted) and not set(groups) <= set(fixed):
        raise FootageError(
            f"{len(groups)} of them cannot fill {', '.join(wanted)}: film more, "
            "split by clip instead of by site, or name shares such as --shares 80,20,0"
        )
    classes = sorted({name for counts in groups.values() for name in counts})
    total = {c: sum(counts.get(c, 0) for counts in groups.values()) for c in classes}
    goal: dict[tuple[Split, str], float] = {
        (split, c): f * total[c]
        for split, f in zip(SPLITS, fractions, strict=True)
        for c in classes
    }
    have = dict.fromkeys(goal, 0.0)
    split_of: dict[str, Split] = {}

    def put(group: str, split: Split) -> None:
        split_of[group] = split
        for c, n in groups[group].items():
            have[split, c] += n

    for group, split in sorted(fixed.items()):
        if group in groups:
            put(group, split)
    for group in _large_first(groups, seed):
        if group not in split_of:
            put(group, max(wanted, key=lambda s: _lack(groups[group], s, goal, have, total)))
    return split_of


def _large_first(groups: Mapping[str, Counts], seed: int) -> list[str]:
    """Return the groups, those of rare classes and many frames first."""
    names = sorted(groups)
    order: list[int] = np.random.default_rng([seed, 51]).permutation(len(names)).tolist()
    drawn = [names[i] for i in order]
    return sorted(drawn, key=lambda name: -sum(groups[name].values()))


def _lack(
    counts: Counts,
    split: Split,
    goal: Mapping[tuple[Split, str], float],
    have: Mapping[tuple[Split, str], float],
    total: Counts,
) -> float:
    """Return how much a split would gain by a group: its relative want of the group's classes.

    A class of which the split has nothing yet counts once more, so that no split is left without.
    """
    gain = 0.0
    for name, n in counts.items():
        if not n:
            continue
        aim = max(goal[split, name], 1e-9)
        share = n / max(total[name], 1)
        gain += share * (aim - have[split, name]) / aim
        gain += share if have[split, name] == 0 else 0.0
    return gain


def deal_frames(
    labels: Sequence[str], fractions: Sequence[float] = FRACTIONS, seed: int = 0
) -> list[Split]:
    """Return a split for every frame, class by class in the wanted shares: the paper's protocol."""
    rng = np.random.default_rng([seed, 52])
    split_of: list[Split] = [""] * len(labels)
    for name in sorted(set(labels)):
        rows = [i for i, label in enumerate(labels) if label == name]
        edges = np.round(np.cumsum(fractions) * len(rows)).astype(int).tolist()
        for rank, position in enumerate(rng.permutation(len(rows)).tolist()):
            side = next(k for k, edge in enumerate(edges) if rank < edge or k == len(edges) - 1)
            split_of[rows[position]] = SPLITS[side]
    return split_of


def parse_shares(text: str) -> tuple[float, float, float]:
    """Return the shares of train, validation and test of `70,15,15`.

    Raises:
        FootageError: not three numbers of which the first is above 0.
    """
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != 3 or min(values) < 0 or values[0] <= 0:
        raise FootageError(
            f"shares {text!r}: give three numbers for {', '.join(SPLITS)}, such as 70,15,15"
        )
    train, validation, test = (value / sum(values) for value in values)
    return train, validation, test
