"""Figures of merit as functions of arrays; those that bootstraps need take weights.

Letters: N pictures, K classes, B bins of confidence. The confusion matrix `(K, K)` has the truth by
row and the answer by column.
"""

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Ints = NDArray[np.int64]
BINS = 10
"""Of equal width, in which confidence is compared with accuracy."""


def confusion_matrix(label: Ints, answer: Ints, classes: int) -> Ints:
    """Return how often (K, K) pictures of the row's class were answered with the column's."""
    cells = np.bincount(label * classes + answer, minlength=classes * classes)
    return cells.reshape(classes, classes).astype(np.int64)


def accuracy(confusion: NDArray[np.number]) -> float:
    """Return the share of right answers; NaN of an empty matrix."""
    total = float(confusion.sum())
    return float(np.trace(confusion)) / total if total else float("nan")


def recalls(confusion: NDArray[np.number]) -> F64:
    """Return for each class the share (K,) that was found; NaN for a class without pictures."""
    return _ratio(np.diag(confusion), confusion.sum(axis=1))


def precisions(confusion: NDArray[np.number]) -> F64:
    """Return for each class how many (K,) of its answers are right; NaN where it was never said."""
    return _ratio(np.diag(confusion), confusion.sum(axis=0))


def balanced_accuracy(confusion: NDArray[np.number]) -> float:
    """Return the mean recall of the classes that occur; NaN of an empty matrix."""
    found = recalls(confusion)
    there = np.isfinite(found)
    return float(found[there].mean()) if there.any() else float("nan")


def f1_scores(confusion: NDArray[np.number]) -> F64:
    """Return 2 TP / (2 TP + FP + FN) of each class (K,); NaN for one neither there nor said."""
    right = np.diag(confusion)
    return _ratio(2 * right, confusion.sum(axis=0) + confusion.sum(axis=1))


def f1(confusion: NDArray[np.number], positive: int | None) -> float:
    """Return the F1 of the positive class, or the mean over classes without one."""
    scores = f1_scores(confusion)
    if positive is not None:
        return float(scores[positive])
    there = np.isfinite(scores)
    return float(scores[there].mean()) if there.any() else float("nan")


def _ratio(part: NDArray[np.number], whole: NDArray[np.number]) -> F64:
    result = np.full(len(whole), np.nan)
    np.divide(part, whole, out=result, where=whole > 0)
    return result


class Ranking:
    """Scores put in order once, so that each area under the ROC costs one pass."""

    def __init__(self, score: NDArray[np.floating], positive: NDArray[np.bool_]) -> None:
        """Sort `score` (N,); `positive` (N,) says which pictures should have the higher ones."""
        self._order = np.argsort(-score, kind="stable")
        ordered = score[self._order]
        self._positive = positive[self._order]
        last = np.flatnonzero(np.diff(ordered)) if len(ordered) else np.empty(0, np.int64)
        self._ends = np.append(last, len(ordered) - 1) if len(ordered) else last
        self.thresholds: F64 = ordered[self._ends].astype(np.float64)
        """(T,), descending: every score that occurs."""

    def counts(self, weight: F64 | None = None) -> tuple[F64, F64]:
        """Return how many positives and negatives (T,) reach each threshold, weighted (N,)."""
        ones = np.ones(len(self._order)) if weight is None else weight[self._order]
        true = np.cumsum(ones * self._positive)[self._ends]
        false = np.cumsum(ones * ~self._positive)[self._ends]
        return true, false

    def curve(self) -> tuple[F64, F64]:
        """Return the false and the true positive rate (T + 1,), from (0, 0) to (1, 1)."""
        true, false = self.counts()
        return np.append(0.0, false / max(false[-1], 1)), np.append(0.0, true / max(true[-1], 1))

    def area(self, weight: F64 | None = None) -> float:
        """Return the area under the ROC, ties counting half; NaN when one side is empty.

        It is the probability that a positive drawn at random has the higher score than a negative.
        """
        if not len(self._order):
            return float("nan")
        true, false = self.counts(weight)
        if true[-1] == 0 or false[-1] == 0:
            return float("nan")
        steps = np.diff(false, prepend=0.0)
        middles = true - np.diff(true, prepend=0.0) / 2
        return float((steps * middles).sum() / (true[-1] * false[-1]))


def rankings(
    probability: NDArray[np.float32], label: Ints, positive: int | None
) -> tuple[Ranking, ...]:
    """Return the ranking by the positive class, or one for each class against the rest."""
    wanted = range(probability.shape[1]) if positive is None else (positive,)
    return tuple(Ranking(probability[:, k], label == k) for k in wanted)


def mean_area(ranked: tuple[Ranking, ...], weight: F64 | None = None) -> float:
    """Return the mean area under the ROCs that have both sides; NaN when none has."""
    areas = np.array([ranking.area(weight) for ranking in ranked])
    there = np.isfinite(areas)
    return float(areas[there].mean()) if there.any() else float("nan")


def confidence_bins(probability: NDArray[np.float32]) -> tuple[F64, Ints]:
    """Return the confidence (N,) of each answer and its bin (N,) of `BINS` over 0 to 1."""
    confidence = probability.max(axis=1).astype(np.float64)
    return confidence, np.minimum((confidence * BINS).astype(np.int64), BINS - 1)


def calibration_error(counts: F64, confidence: F64, right: F64) -> float:
    """Return the expected calibration error (ECE) from sums over each bin (B,).

    It is the mean over pictures of |accuracy - confidence| of the bin that they fall into. Source:
    Guo et al., On Calibration of Modern Neural Networks, 2017, equation 3.
    """
    total = counts.sum()
    return float(np.abs(right - confidence).sum() / total) if total else float("nan")
