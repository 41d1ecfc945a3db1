"""A learning curve as a picture."""

# Matplotlib leaves many of its own members without types.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence
from pathlib import Path

from juncnet.learning.evaluation.plots import drawing
from juncnet.learning.fit import Point


def draw_curve(curve: Sequence[Point], path: Path) -> None:
    """Write loss and balanced accuracy over the pictures seen to `path` (PNG).

    Raises:
        PlotError: matplotlib is not installed.
    """
    seen = [point.samples for point in curve]
    with drawing(path, 6.0, 3.6) as figure:
        loss = figure.add_subplot()
        accuracy = loss.twinx()
        loss.plot(seen, [point.loss for point in curve], color="tab:gray", marker=".")
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
