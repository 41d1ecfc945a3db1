"""All figures of one model on one set, as one object."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from juncnet.learning.evaluation.answers import Answers
from juncnet.learning.evaluation.intervals import interval, site_counts
from juncnet.learning.evaluation.metrics import (
    BINS,
    accuracy,
    balanced_accuracy,
    calibration_error,
    confidence_bins,
    f1,
    f1_scores,
    mean_area,
    precisions,
    rankings,
    recalls,
)

FEW_SITES = 8
"""With fewer, an interval over sites is a guess itself and is marked so."""

Interval = tuple[float, float] | None


class ClassScore(BaseModel):
    """How one class is told from the others; None where it cannot be said."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    n: int
    recall: float | None
    precision: float | None
    f1: float | None


class Bin(BaseModel):
    """Answers of about the same confidence: a calibrated model is right as often as it is sure."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    n: int
    confidence: float
    """Mean of the bin."""
    accuracy: float


class Latency(BaseModel):
    """One picture after the other on one thread, from luminance to probabilities."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    n: int
    features_p50_ms: float
    network_p50_ms: float
    total_p50_ms: float
    total_p99_ms: float
    load: float
    """Processes that wanted to run in the minute before (load average): a busy machine is slow."""


class GroupScore(BaseModel):
    """The main figures of a part of the set."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    n: int
    sites: int
    accuracy: float
    accuracy_interval: Interval
    balanced_accuracy: float
    balanced_accuracy_interval: Interval
    auc: float | None
    """Area under the ROC; the mean over classes against the rest where there are more than two."""
    auc_interval: Interval
    f1: float | None
    """Of the positive class; the mean over classes where there are more than two."""
    f1_interval: Interval


class Scores(GroupScore):
    """How a model does on a set. Intervals: 95 %, whole sites drawn with replacement."""

    classes: tuple[str, ...]
    confusion: tuple[tuple[int, ...], ...]
    """Truth by row, answer by column."""
    per_class: dict[str, ClassScore]
    calibration_error: float
    """Expected calibration error (ECE) over `reliability`."""
    calibration_error_interval: Interval
    reliability: tuple[Bin, ...]
    """Bins of confidence that have pictures, from unsure to sure."""
    groups: dict[str, GroupScore]
    n_no_class: int
    """Pictures that belong to no class (a transition band): in no figure above."""
    no_class_called: dict[str, float]
    """Which share of those was given to each class; empty when there are none."""
    notes: tuple[str, ...]
    """What has to be known to read the figures."""
    latency: Latency | None = None


def main_figures(answers: Answers) -> GroupScore:
    """Return the main figures of all answers that have a label.

    Raises:
        ValueError: none has.
    """
    judged = answers.where(answers.label >= 0)
    if not len(judged):
        raise ValueError("no picture belongs to a class: there is nothing to judge")
    return _group_score(judged, _SiteSums(judged))


def score(answers: Answers, sites_known: bool = True) -> Scores:
    """Return the figures of these answers.

    Args:
        answers: of one model on one set.
        sites_known: false when every picture had to be taken for a site of its own.

    Raises:
        ValueError: no picture belongs to a class.
    """
    judged = answers.where(answers.label >= 0)
    rest = answers.probability[answers.label < 0].argmax(axis=1)
    if not len(judged):
        raise ValueError("no picture belongs to a class: there is nothing to judge")
    sums = _SiteSums(judged)
    confusion = sums.confusion.sum(axis=0)
    whole = _group_score(judged, sums)
    names = np.unique(judged.group)
    groups = {str(name): judged.where(judged.group == name) for name in names if len(names) > 1}
    bins = sums.bins.sum(axis=0)
    return Scores(
        **whole.model_dump(),
        classes=answers.classes,
        confusion=tuple(tuple(int(cell) for cell in row) for row in confusion),
        per_class=_per_class(answers.classes, confusion),
        calibration_error=calibration_error(*bins.T),
        calibration_error_interval=interval(
            site_counts(whole.sites),
            lambda counts: calibration_error(*np.tensordot(counts, sums.bins, 1).T),
        ),
        reliability=tuple(
            Bin(n=int(n), confidence=float(sure / n), accuracy=float(right / n))
            for n, sure, right in bins
            if n
        ),
        groups={name: _group_score(part, _SiteSums(part)) for name, part in groups.items()},
        n_no_class=len(rest),
        no_class_called={
            name: float((rest == k).mean()) for k, name in enumerate(answers.classes) if len(rest)
        },
        notes=_notes(judged, sites_known),
    )


class _SiteSums:
    """Confusion matrices (S, K, K) and bins of confidence (S, B, 3) of each of S sites."""

    def __init__(self, answers: Answers) -> None:
        answer = answers.probability.argmax(axis=1)
        confidence, slot = confidence_bins(answers.probability)
        right = (answer == answers.label).astype(np.float64)
        _, self.site = np.unique(answers.site, return_inverse=True)
        self.sites, k = int(self.site.max()) + 1, len(answers.classes)
        cell = (self.site * k + answers.label) * k + answer
        cells = np.bincount(cell, minlength=self.sites * k * k)
        self.confusion = cells.reshape(self.sites, k, k)
        place = self.site * BINS + slot
        columns = [
            np.bincount(place, weights, minlength=self.sites * BINS)
            for weights in (np.ones(len(right)), confidence, right)
        ]
        self.bins = np.stack(columns, axis=-1).reshape(self.sites, BINS, 3)


def _group_score(answers: Answers, sums: _SiteSums) -> GroupScore:
    draws, positive = site_counts(sums.sites), answers.positive
    ranked = rankings(answers.probability, answers.label, positive)

    def of_confusion(
        figure: Callable[[NDArray[np.int64]], float],
    ) -> tuple[float, Interval]:
        spread = interval(draws, lambda counts: figure(np.tensordot(counts, sums.confusion, 1)))
        return figure(sums.confusion.sum(axis=0)), spread

    right, right_interval = of_confusion(accuracy)
    balanced, balanced_interval = of_confusion(balanced_accuracy)
    harmonic, harmonic_interval = of_confusion(lambda confusion: f1(confusion, positive))
    return GroupScore(
        n=len(answers),
        sites=sums.sites,
        accuracy=right,
        accuracy_interval=right_interval,
        balanced_accuracy=balanced,
        balanced_accuracy_interval=balanced_interval,
        auc=_known(mean_area(ranked)),
        auc_interval=interval(
            draws, lambda counts: mean_area(ranked, counts[sums.site].astype(np.float64))
        ),
        f1=_known(harmonic),
        f1_interval=harmonic_interval,
    )


def _per_class(classes: tuple[str, ...], confusion: NDArray[np.int64]) -> dict[str, ClassScore]:
    columns = zip(
        classes,
        confusion.sum(axis=1),
        recalls(confusion),
        precisions(confusion),
        f1_scores(confusion),
        strict=True,
    )
    return {
        name: ClassScore(
            n=int(n), recall=_known(recall), precision=_known(precision), f1=_known(harmonic)
        )
        for name, n, recall, precision, harmonic in columns
    }


def _known(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _notes(judged: Answers, sites_known: bool) -> tuple[str, ...]:
    notes: list[str] = []
    sites = len(np.unique(judged.site))
    if not sites_known:
        notes.append("sites are unknown (samples.csv may tell them): intervals are too narrow")
    elif sites < FEW_SITES:
        notes.append(f"{sites} sites only: intervals are guesses, or missing")
    missing = [name for k, name in enumerate(judged.classes) if not (judged.label == k).any()]
    if missing:
        notes.append(f"no picture of class {', '.join(missing)}")
    return tuple(notes)
