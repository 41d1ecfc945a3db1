"""Labelled pictures on disk: 64x64 grayscale with what is needed to train and to judge.

A set is one `.npz` file: `gray` (N, S, S) uint8, `target` (N,) float32 in [0, 1] (NaN: nobody
could say, used for nothing), `label` (N,) uint8 (index into `LABELS`), `mouth_m`, `height_m`
(N,) float32, `site` (N,) int64, and perhaps `mask` (N, M, M) uint8.
"""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

LABELS = ("none", "junction", "transition")
MASK_SIZE = 32
"""Side of the masks that synthetic pictures come with."""


def small_mask(mask: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return a mask (H, W) of classes at (MASK_SIZE, MASK_SIZE), nearest cells."""
    rows, columns = (((np.arange(MASK_SIZE) + 0.5) * n / MASK_SIZE).astype(int) for n in mask.shape)
    return mask[np.ix_(rows, columns)]


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
    mask: NDArray[np.uint8] | None = None
    """(N, M, M): where road (1) and junction (2) lie in the picture; None: not kept."""

    def __len__(self) -> int:
        return len(self.label)

    def where(self, mask: NDArray[np.bool_]) -> "Samples":
        """Return the samples for which `mask` (N,) is true."""
        return Samples(**{name: array[mask] for name, array in self._arrays().items()})

    def save(self, path: Path) -> None:
        """Write the set to `path`."""
        np.savez(path, allow_pickle=False, **self._arrays())

    @classmethod
    def load(cls, path: Path) -> "Samples":
        """Return the set in `path`."""
        with np.load(path, allow_pickle=False) as data:
            return cls(**{f.name: data[f.name] for f in fields(cls) if f.name in data.files})

    @classmethod
    def concatenate(cls, parts: "list[Samples]") -> "Samples":
        """Return all parts as one set; masks are kept if all parts have them."""
        arrays = [part._arrays() for part in parts]
        kept = set[str].intersection(*(set(names) for names in arrays))
        return cls(**{name: np.concatenate([a[name] for a in arrays]) for name in kept})

    def _arrays(self) -> dict[str, NDArray[Any]]:
        found = {f.name: getattr(self, f.name) for f in fields(self)}
        return {name: array for name, array in found.items() if array is not None}
