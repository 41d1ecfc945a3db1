"""What of the training set stands in the other splits too, so that figures would flatter."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np

from juncnet.learning.datasets import Row
from juncnet.learning.footage.intervals import SPLITS
from juncnet.learning.footage.likeness import F32, NEAR_DUPLICATE, close_pairs
from juncnet.learning.footage.writer import (
    SplitBy,
    clips_in_several_splits,
    sites_in_several_splits,
)


@dataclass(frozen=True)
class Leak:
    """Something that stands in more than one split."""

    kind: Literal["site", "clip", "near_duplicate"]
    what: str
    """The site or clip, or the paths of two pictures."""
    splits: tuple[str, ...]
    asked_for: bool
    """Whether the data set says that it was made so: no mistake, but the figures must say it."""
    difference: float | None = None
    """Of near-duplicates, see `juncnet.learning.footage.likeness`."""


def group_leaks(samples: Sequence[Row], split_by: SplitBy) -> list[Leak]:
    """Return the sites and clips that stand in more than one split."""
    sites = sites_in_several_splits(samples)
    clips = clips_in_several_splits(samples)
    return [
        *(Leak("site", name, splits, split_by != "site") for name, splits in sites.items()),
        *(Leak("clip", name, splits, split_by == "frame") for name, splits in clips.items()),
    ]


def near_duplicate_leaks(
    samples: Sequence[Row],
    descriptors: F32,
    split_by: SplitBy,
    threshold: float = NEAR_DUPLICATE,
) -> list[Leak]:
    """Return near-duplicates across splits, the closest first.

    Args:
        samples: The N pictures.
        descriptors: Theirs, (N, 1024), see `likeness.descriptor`.
        split_by: What was dealt out: of frames, near-duplicates were asked for.
        threshold: Difference below which two pictures are near-duplicates.
    """
    found: list[Leak] = []
    splits = np.array([s.split for s in samples])
    for first, second in combinations(SPLITS, 2):
        rows: list[int] = np.flatnonzero(splits == second).tolist()
        others: list[int] = np.flatnonzero(splits == first).tolist()
        for i, j, apart in close_pairs(descriptors[rows], descriptors[others], threshold):
            what = f"{samples[rows[i]].path} and {samples[others[j]].path}"
            found.append(Leak("near_duplicate", what, (first, second), split_by == "frame", apart))
    return sorted(found, key=lambda leak: leak.difference or 0.0)
