"""Learning curves: as pictures, and joined over trainings that followed each other."""

# Matplotlib leaves many of its own members without types.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from juncnet.learning.evaluation.plots import drawing
from juncnet.learning.fit import Point


class WatchedPoint(BaseModel):
    """Where a training stood."""

    model_config = ConfigDict(frozen=True)

    samples: int
    """Pictures seen in this training, repetitions counted."""
    watched_auc: float | None = None
    """Area under the ROC of *any junction* against *none* on the watched pictures."""


class Stretch(BaseModel):
    """One training, as `juncnet train` reports it in JSON."""

    model_config = ConfigDict(frozen=True)

    name: str = ""
    command: str
    curve: tuple[WatchedPoint, ...]


class WatchedCurve(BaseModel):
    """Trainings in their order, each from the model of the one before."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    command: str
    stretches: tuple[Stretch, ...]

    @property
    def begins(self) -> list[int]:
        """Pictures seen before each stretch."""
        lengths = [stretch.curve[-1].samples for stretch in self.stretches]
        return [sum(lengths[:i]) for i in range(len(lengths))]

    @property
    def points(self) -> list[tuple[int, float]]:
        """Pictures seen since the first stretch began, and the AUC then."""
        return [
            (before + point.samples, point.watched_auc)
            for before, stretch in zip(self.begins, self.stretches, strict=True)
            for point in stretch.curve
            if point.watched_auc is not None
        ]


def read_stretch(path: Path) -> Stretch:
    """Return the training that a report is about.

    Raises:
        OSError: it cannot be read.
        ValueError: it is none of `juncnet train`, or nothing was watched.
    """
    try:
        stretch = Stretch.model_validate_json(path.read_bytes())
    except ValidationError as error:
        raise ValueError(f"{path} is no report of juncnet train") from error
    if all(point.watched_auc is None for point in stretch.curve):
        raise ValueError(f"{path}: nothing was watched: train with --watch DATA")
    return stretch.model_copy(update={"name": path.stem})


def draw_watched(curve: WatchedCurve, path: Path) -> None:
    """Write the AUC over the pictures seen to `path` (PNG), with a line where a stretch begins.

    Raises:
        PlotError: matplotlib is not installed.
    """
    seen, area = zip(*curve.points, strict=True)
    with drawing(path, 6.0, 3.6) as figure:
        axes = figure.add_subplot()
        axes.plot([n / 1e6 for n in seen], area, marker=".")
        for before, stretch in zip(curve.begins, curve.stretches, strict=True):
            if before:
                axes.axvline(before / 1e6, color="tab:gray", ls=":")
                axes.annotate(
                    stretch.name,
                    (before / 1e6, 0.02),
                    (3, 0),
                    xycoords=("data", "axes fraction"),
                    textcoords="offset points",
                    fontsize=8,
                )
        axes.axhline(0.5, color="lightgray")
        axes.set(xlabel="pictures seen in training [millions]", ylabel="AUC, watched pictures")
        axes.set_ylim(min(0.45, min(area) - 0.03), 1)


def draw_curve(curve: Sequence[Point], path: Path) -> None:
    """Write loss and balanced accuracy over the pictures seen to `path` (PNG).

    Raises:
        PlotError: matplotlib is not installed.
    """
    seen = [point.samples for point in curve]
    with drawing(path, 6.0, 3.6) as figure:
        loss = figure.add_subplot()
        accuracy = loss.twinx()
        learnt = [point for point in curve if point.samples]  # no step has been taken at 0
        seen_then = [point.samples for point in learnt]
        loss.plot(seen_then, [point.loss for point in learnt], color="tab:gray", marker=".")
        loss.set_xlabel("pictures seen in training")
        loss.set_ylabel("loss", color="tab:gray")
        loss.set_ylim(bottom=0)
        percent = [100 * point.balanced_accuracy for point in curve]
        accuracy.plot(seen, percent, color="tab:blue", marker=".")
        accuracy.set_ylabel("balanced accuracy, validation part [%]", color="tab:blue")
        watched = [(p.samples, 100 * p.watched_auc) for p in curve if p.watched_auc is not None]
        if watched:
            x, y = zip(*watched, strict=True)
            accuracy.plot(x, y, color="tab:green", marker=".", label="100 AUC, watched pictures")
            accuracy.legend(loc="lower right")
