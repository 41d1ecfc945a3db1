"""The pictures of datasets at a network's size, ready to be drawn from at random."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray

from juncnet.features import Crop, Preprocessing, cropped
from juncnet.learning.datasets import Dataset, DatasetError
from juncnet.shrink import shrink

Bytes = NDArray[np.uint8]
UNSURE = 0.6
"""A picture whose class is given a lower probability is worth seeing more often."""
HASHED = 8192
"""Pictures that tell one set from another; of targets and labels all do."""


@dataclass(frozen=True)
class Pictures:
    """Pictures at the network's size and what is to be learnt of them; N of each."""

    gray: Bytes
    """(N, S, S): cropped and scaled, before sharpening."""
    target: NDArray[np.float32]
    """(N, classes): probabilities to learn."""
    label: NDArray[np.int64]
    """(N,): index of the class; -1: none of them."""
    mask: Bytes
    """(N, M, M): 0, 1 (road) or 2 (junction); only where `masked`."""
    masked: NDArray[np.bool_]
    """(N,): which pictures come with a mask."""

    def __len__(self) -> int:
        return len(self.label)

    def take(self, indices: NDArray[np.integer]) -> "Pictures":
        """Return the pictures at these indices, in their order."""
        return Pictures(*(getattr(self, field.name)[indices] for field in fields(self)))

    def with_wrong_repeated(self, probability: NDArray[np.floating], times: int) -> "Pictures":
        """Return all pictures, those `times` whose sure class has a probability below `UNSURE`.

        `probability` (N, classes) is what a network answers to them.
        """
        sure = self.target.max(axis=1) == 1
        wrong = sure & ((probability * self.target).sum(axis=1) < UNSURE)
        return self.take(np.repeat(np.arange(len(self)), np.where(wrong, times, 1)))

    @cached_property
    def fingerprint(self) -> str:
        """What tells these pictures from others: a hash of targets, labels, and some pictures."""
        found = sha256()
        chosen = np.linspace(0, len(self) - 1, min(len(self), HASHED)).astype(int)
        some = (self.gray[chosen], self.mask[chosen])
        for array in (self.target, self.label, self.masked, *some):
            found.update(f"{array.shape} {array.dtype}".encode())
            found.update(np.ascontiguousarray(array).data)
        return found.hexdigest()[:16]

    @property
    def class_weights(self) -> NDArray[np.float32]:
        """Weights (classes,) with which the sure pictures of every class count the same."""
        share = np.maximum((self.target == 1).mean(axis=0), 1e-3)
        weights = 1.0 / share
        return (weights * share.sum() / len(share)).astype(np.float32)


def prepared(
    datasets: Sequence[Dataset],
    preprocessing: Preprocessing,
    classes: tuple[str, ...] | None = None,
) -> Pictures:
    """Return the pictures of all datasets that have something to teach, in memory.

    `classes` is the order of the classes in what is returned; the first dataset's by default.

    Raises:
        DatasetError: their classes differ, or a picture cannot be read.
    """
    classes = classes or datasets[0].classes
    parts: list[Pictures] = []
    for dataset in datasets:
        if set(dataset.classes) != set(classes):
            raise DatasetError(f"classes differ: {', '.join(classes)}; {dataset.classes}")
        parts.append(_prepared(dataset, classes, preprocessing))
    side = max(part.mask.shape[1] for part in parts)
    masks = [p.mask if p.masked.any() else np.zeros((len(p), side, side), np.uint8) for p in parts]
    return Pictures(
        np.concatenate([part.gray for part in parts]),
        np.concatenate([part.target for part in parts]),
        np.concatenate([part.label for part in parts]),
        np.concatenate(masks),
        np.concatenate([part.masked for part in parts]),
    )


def _prepared(dataset: Dataset, classes: tuple[str, ...], p: Preprocessing) -> Pictures:
    order = [dataset.classes.index(name) for name in classes]
    back = np.array([*(order.index(i) for i in range(len(order))), -1])
    known = np.flatnonzero(np.isfinite(dataset.target).all(axis=1))
    dataset = dataset.take(known)
    gray = dataset.whole_shards() if p.crop == Crop() else None
    if gray is None or gray.shape[1:] != (p.size, p.size):
        gray = np.empty((len(dataset), p.size, p.size), np.uint8)
        for index in range(len(dataset)):
            picture = cropped(dataset.luminance(index), p.crop)
            gray[index] = np.rint(shrink(picture, p.size))
    mask = dataset.masks()
    return Pictures(
        gray,
        dataset.target[:, order],
        back[dataset.label],
        np.zeros((len(dataset), 1, 1), np.uint8) if mask is None else mask,
        np.full(len(dataset), mask is not None),
    )
