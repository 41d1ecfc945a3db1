"""How sure figures are: bootstraps that draw whole sites with replacement.

Frames of one site resemble each other, so drawing frames would pretend to more evidence than there
is. Each figure is made of sums over sites (or of weights of pictures), so a draw costs little.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

DRAWS = 1000
LEVEL = 0.95


def site_counts(sites: int, draws: int = DRAWS, seed: int = 0) -> NDArray[np.int64]:
    """Return how often each of the sites is drawn: (draws, sites); every row sums to `sites`."""
    rng = np.random.default_rng(seed)
    return rng.multinomial(sites, np.full(sites, 1 / sites), size=draws)


def interval(
    counts: NDArray[np.int64], figure: Callable[[NDArray[np.int64]], float]
) -> tuple[float, float] | None:
    """Return the central 95 % of `figure` over draws, each a row of `counts`.

    None for fewer than two sites, which say nothing about others, and when half of the draws or
    more have no figure.
    """
    if counts.shape[1] < 2:
        return None
    values = np.array([figure(row) for row in counts])
    values = values[np.isfinite(values)]
    if len(values) < len(counts) / 2:
        return None
    low, high = np.percentile(values, [50 * (1 - LEVEL), 50 * (1 + LEVEL)])
    return float(low), float(high)


def binomial_interval(share: float, n: int) -> tuple[float, float]:
    """Return the 95 % score interval (Wilson, 1927) of a share found in `n` independent trials."""
    z = 1.959964
    middle = (share + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * (share * (1 - share) / n + z * z / (4 * n * n)) ** 0.5
    return middle - half, middle + half
