"""What a test set has in common with the training set: said beside every figure.

The paper takes frames of the same junctions for training and test (*seen sites*). A robot comes to
junctions that its model never saw (*unseen sites*). Both are of use, mixed up they are not.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from juncnet.learning.datasets import Dataset, sites_of
from juncnet.learning.footage.splits import deal_groups

Protocol = Literal["unseen sites", "seen sites", "sites unknown", "no split"]
PROTOCOLS: dict[str, Protocol] = {"unseen": "unseen sites", "seen": "seen sites"}
SEEN_SHARE = 0.2
"""Of the pictures of every training site: held back to test on seen sites."""


def protocol_of(data: Dataset, split: str) -> Protocol:
    """Return how the pictures of a split stand to those of the split `train`.

    Without one the dataset cannot tell: what the model was trained on is elsewhere.
    """
    if split == "all" or not (data.split == "train").any():
        return "no split"
    site, known = sites_of(data)
    if not known:
        return "sites unknown"
    shared = set(site[data.split == split]) & set(site[data.split == "train"])
    return "seen sites" if shared else "unseen sites"


@dataclass(frozen=True)
class Parts:
    """One division of a dataset that serves both protocols with one training."""

    train: Dataset
    validation: Dataset
    """Other sites than those of `train`; choices are made on it."""
    unseen: Dataset
    """Of sites that occur in none of the other parts."""
    seen: Dataset
    """Other pictures of the sites of `train`."""


def divided(data: Dataset, limit: int | None = None, seed: int = 0) -> Parts:
    """Return the parts of a dataset; its own splits are kept where it has them.

    Args:
        data: with sites; pictures of no class and without target are left out of `train`.
        limit: at most so many training pictures, spread over all training sites.
        seed: of what is drawn.

    Raises:
        ValueError: sites are unknown or too few, or a part is empty.
    """
    site, known = sites_of(data)
    if not known:
        raise ValueError(
            "the sites of these pictures are unknown: write them into samples.csv, without them "
            "nobody can say what has been seen in training"
        )
    split = data.split if (data.split == "train").any() else _dealt(data, site, seed)
    judged = data.label >= 0
    for name in ("validation", "test"):
        if not (judged & (split == name)).any():
            raise ValueError(
                f"no picture of a class is in the part {name}: name sites for it, or leave "
                "the splits empty, so that sites are dealt out"
            )
    learnt = np.flatnonzero((split == "train") & np.isfinite(data.target).all(axis=1))
    rng = np.random.default_rng([seed, 3])
    held_back = _held_back(site[learnt], rng)
    seen, train = learnt[held_back], learnt[~held_back]
    if limit is not None:
        train = np.sort(rng.permutation(train)[:limit])
    return Parts(
        train=data.take(train),
        validation=data.where(judged & (split == "validation")),
        unseen=data.where(judged & (split == "test")),
        seen=data.take(seen[judged[seen]]),
    )


def _held_back(site: NDArray[np.str_], rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return which pictures (N,) to hold back: the same share of every site, at random."""
    chosen = np.zeros(len(site), np.bool_)
    for name in np.unique(site):
        rows = rng.permutation(np.flatnonzero(site == name))
        chosen[rows[: round(SEEN_SHARE * len(rows))]] = True
    return chosen


def _dealt(data: Dataset, site: NDArray[np.str_], seed: int) -> NDArray[np.str_]:
    """Return a split for each picture, by whole sites."""
    counts = {
        str(name): {
            data.classes[k]: int(((site == name) & (data.label == k)).sum())
            for k in range(len(data.classes))
        }
        for name in np.unique(site)
    }
    if len(counts) < 3:
        raise ValueError(f"{len(counts)} sites cannot be divided into training, choice and test")
    split_of = deal_groups(counts, {}, seed=seed)
    return np.array([split_of[str(name)] for name in site], np.str_)
