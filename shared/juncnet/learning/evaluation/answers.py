"""What a model answered, beside what is true: all that figures are made from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

NONE = "none"
"""The class of plain road: where there are two classes, the other one is the positive one."""


@dataclass(frozen=True)
class Answers:
    """The probabilities that a model gave to N pictures and the truth about them."""

    classes: tuple[str, ...]
    """K names in the order of the probabilities."""
    probability: NDArray[np.float32]
    """(N, K), each row sums to 1."""
    label: NDArray[np.int64]
    """(N,): index into `classes`; -1: belongs to no class (a transition band), in no figure."""
    site: NDArray[np.str_]
    """(N,): where each picture was taken; resampled together for intervals."""
    group: NDArray[np.str_]
    """(N,): what figures are broken down by."""

    def __post_init__(self) -> None:
        """Refuse arrays that do not fit together.

        Raises:
            ValueError: lengths or classes differ, or a label is no class; the text says which.
        """
        n, k = len(self.label), len(self.classes)
        if self.probability.shape != (n, k):
            raise ValueError(f"probabilities {self.probability.shape}, not ({n}, {k})")
        if len(self.site) != n or len(self.group) != n:
            raise ValueError(f"{len(self.site)} sites and {len(self.group)} groups of {n} labels")
        if n and not -1 <= self.label.min() <= self.label.max() < k:
            raise ValueError(f"labels outside -1..{k - 1}")

    def __len__(self) -> int:
        return len(self.label)

    def where(self, mask: NDArray[np.bool_]) -> "Answers":
        """Return the answers for which `mask` (N,) is true."""
        return Answers(
            self.classes,
            self.probability[mask],
            self.label[mask],
            self.site[mask],
            self.group[mask],
        )

    @property
    def positive(self) -> int | None:
        """The index of the positive class of two; None where there are more."""
        if len(self.classes) != 2:
            return None
        return 1 - self.classes.index(NONE) if NONE in self.classes else 1
