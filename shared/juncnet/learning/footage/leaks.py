"""What of the training set stands in the other splits too, so that figures would flatter."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

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
    pairs = _pairs([s.split for s in samples], descriptors, threshold)
    return [
        Leak(
            "near_duplicate",
            f"{samples[i].path} and {samples[j].path}",
            (samples[j].split, samples[i].split),
            split_by == "frame",
            apart,
        )
        for i, j, apart in sorted(pairs, key=lambda pair: pair[2])
    ]


def twins_across(splits: Sequence[str], descriptors: F32, threshold: float) -> set[int]:
    """Return the pictures to leave out so that no near-duplicate stands in two splits.

    Of train and another split the other's goes, of validation and test that of the test.
    """
    return {i for i, _, _ in _pairs(splits, descriptors, threshold)}


def _pairs(
    splits: Sequence[str], descriptors: F32, threshold: float
) -> list[tuple[int, int, float]]:
    """Return (index in the later split, index in the earlier one, difference) of near-duplicates.

    Of each picture only the closest in each earlier split is told.
    """
    found: list[tuple[int, int, float]] = []
    for first, second in combinations(SPLITS, 2):
        rows = [i for i, split in enumerate(splits) if split == second]
        others = [i for i, split in enumerate(splits) if split == first]
        pairs = close_pairs(descriptors[rows], descriptors[others], threshold)
        found += [(rows[i], others[j], apart) for i, j, apart in pairs]
    return found
