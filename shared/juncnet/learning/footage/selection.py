"""Which frames to keep when there are more than wanted: all classes and clips get a fair share."""

from collections.abc import Hashable, Mapping, Sequence
from typing import TypeVar

from juncnet.learning.datasets import Row
from juncnet.learning.footage.sheets import evenly

Key = TypeVar("Key", bound=Hashable)


def fair_shares(available: Mapping[Key, int], limit: int) -> dict[Key, int]:
    """Return how many to take of each key, at most `limit` together: as equal as possible.

    A key that has less than its share leaves the rest to the others.
    """
    left, shares = limit, dict.fromkeys(available, 0)
    for rank, key in enumerate(sorted(available, key=lambda k: available[k])):
        shares[key] = min(available[key], left // (len(available) - rank))
        left -= shares[key]
    return shares


def thinned(samples: Sequence[Row], limit: int) -> list[int]:
    """Return the indices of at most `limit` samples, in order.

    Classes share alike, within a class its clips do, and within a clip frames are evenly spread.
    """
    if len(samples) <= limit:
        return list(range(len(samples)))
    rows: dict[str, dict[str, list[int]]] = {}
    for index, sample in enumerate(samples):
        rows.setdefault(sample.label, {}).setdefault(sample.clip, []).append(index)
    classes = {label: sum(map(len, clips.values())) for label, clips in rows.items()}
    chosen: list[int] = []
    for label, share in fair_shares(classes, limit).items():
        clips = rows[label]
        for clip, n in fair_shares({c: len(r) for c, r in clips.items()}, share).items():
            chosen += [clips[clip][i] for i in evenly(len(clips[clip]), n)] if n else []
    return sorted(chosen)
