"""Labelled pictures on disk: 64x64 grayscale with what is needed to train and to judge.

A set is one `.npz` file: `gray` (N, S, S) uint8, `target` (N,) float32 in [0, 1] (NaN: nobody
could say, used for nothing), `label` (N,) uint8 (index into `LABELS`), `mouth_m`, `height_m`
(N,) float32, `site` (N,) int64.
"""

from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

LABELS = ("none", "junction", "transition")


@dataclass(frozen=True)
class Samples:
    """Labelled pictures; all arrays have the same length N."""

    gray: NDArray[np.uint8]
    """(N, S, S): cropped and scaled, before sharpening."""
    target: NDArray[np.float32]
    """Probability of *junction* to be learnt; NaN: leave out."""
    label: NDArray[np.uint8]
    mouth_m: NDArray[np.float32]
    """Distance to the next junction's mouth; infinite: none."""
    height_m: NDArray[np.float32]
    """Height of the camera."""
    site: NDArray[np.int64]
    """Seed of the world: splits are by site."""

    def __len__(self) -> int:
        return len(self.label)

    def where(self, mask: NDArray[np.bool_]) -> "Samples":
        """Return the samples for which `mask` (N,) is true."""
        return Samples(*(getattr(self, f.name)[mask] for f in fields(self)))

    def save(self, path: Path) -> None:
        """Write the set to `path`."""
        arrays = {f.name: getattr(self, f.name) for f in fields(self)}
        np.savez(path, **arrays)

    @classmethod
    def load(cls, path: Path) -> "Samples":
        """Return the set in `path`."""
        with np.load(path, allow_pickle=False) as data:
            return cls(*(data[f.name] for f in fields(cls)))

    @classmethod
    def concatenate(cls, parts: "list[Samples]") -> "Samples":
        """Return all parts as one set."""
        return cls(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in fields(cls)))
