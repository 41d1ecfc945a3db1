"""Pictures of an evaluation: curves, the worst mistakes, the paper's Fig. 5."""

# Matplotlib leaves many of its own members without types.
# pyright: reportUnknownMemberType=false

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juncnet.features import F32, Extractor, Preprocessing, cropped
from juncnet.learning.datasets import Dataset
from juncnet.learning.evaluation.answers import Answers
from juncnet.learning.evaluation.metrics import rankings
from juncnet.learning.evaluation.plots import drawing
from juncnet.learning.evaluation.scores import Scores
from juncnet.shrink import shrink

MISTAKES = 16
STAGES = 8
"""Columns of Fig. 5: half of them plain road."""


def draw_figures(given: Answers, scores: Scores, title: str, path: Path) -> None:
    """Draw the ROC, how sure and how right the answers are, and the confusion matrix."""
    judged = given.where(given.label >= 0)
    with drawing(path, 12, 4) as figure:
        figure.suptitle(title)
        roc, reliability, confusion = figure.subplots(1, 3)
        _roc(roc, judged, scores)
        _reliability(reliability, scores)
        _confusion(confusion, scores)


def _roc(axes: Any, judged: Answers, scores: Scores) -> None:
    positive = judged.positive
    wanted = range(len(judged.classes)) if positive is None else (positive,)
    ranked = rankings(judged.probability, judged.label, positive)
    for k, ranking in zip(wanted, ranked, strict=True):
        false, true = ranking.curve()
        axes.plot(false, true, label=f"{judged.classes[k]}: AUC {ranking.area():.3f}")
    axes.plot([0, 1], [0, 1], color="grey", lw=0.8, ls=":")
    axes.set(xlabel="false positive rate", ylabel="true positive rate", title="ROC")
    if scores.auc_interval is not None:
        low, high = scores.auc_interval
        axes.set_title(f"ROC, AUC {scores.auc:.3f} ({low:.2f} to {high:.2f})")
    axes.grid(alpha=0.3)
    axes.legend(loc="lower right")


def _reliability(axes: Any, scores: Scores) -> None:
    total = sum(b.n for b in scores.reliability)
    axes.plot([0, 1], [0, 1], color="grey", lw=0.8, ls=":")
    axes.plot(
        [b.confidence for b in scores.reliability],
        [b.accuracy for b in scores.reliability],
        marker="o",
        label="accuracy",
    )
    axes.bar(
        [b.confidence for b in scores.reliability],
        [b.n / total for b in scores.reliability],
        width=0.03,
        alpha=0.4,
        label="share of pictures",
    )
    axes.set(
        xlabel="confidence",
        xlim=(1 / len(scores.classes) - 0.05, 1.02),
        ylim=(0, 1.18),
        yticks=np.linspace(0, 1, 6),
        title=f"calibration, ECE {100 * scores.calibration_error:.1f} %",
    )
    axes.grid(alpha=0.3)
    axes.legend(loc="upper center", ncols=2)  # above the highest accuracy


def _confusion(axes: Any, scores: Scores) -> None:
    cells = np.array(scores.confusion)
    shares = cells / np.maximum(cells.sum(axis=1, keepdims=True), 1)
    axes.imshow(shares, cmap="Blues", vmin=0, vmax=1)
    for (row, column), n in np.ndenumerate(cells):
        colour = "white" if shares[row, column] > 0.5 else "black"
        text = f"{n}\n{100 * shares[row, column]:.1f} %"
        axes.text(column, row, text, ha="center", va="center", color=colour)
    places = range(len(scores.classes))
    axes.set_xticks(places, scores.classes)
    axes.set_yticks(places, scores.classes)
    axes.set(xlabel="answer", ylabel="truth")
    axes.set_title(f"balanced accuracy {100 * scores.balanced_accuracy:.2f} %")


def worst_mistakes(given: Answers, count: int = MISTAKES) -> NDArray[np.int64]:
    """Return the indices of the wrong answers that were surest, at most two of a site.

    A site that fools a model does so in many frames; the limit lets others be seen as well.
    """
    answer = given.probability.argmax(axis=1)
    wrong = np.flatnonzero((given.label >= 0) & (answer != given.label))
    order = wrong[np.argsort(-given.probability[wrong, answer[wrong]], kind="stable")]
    of_site: dict[str, int] = {}
    chosen: list[int] = []
    for index in order.tolist():
        site = str(given.site[index])
        of_site[site] = of_site.get(site, 0) + 1
        if of_site[site] <= 2 and len(chosen) < count:
            chosen.append(index)
    return np.array(chosen, np.int64)


def draw_mistakes(
    given: Answers, data: Dataset, preprocessing: Preprocessing, title: str, path: Path
) -> int:
    """Draw the surest wrong answers, each above its Radon reconstruction; return how many."""
    chosen = worst_mistakes(given)
    columns = 8
    rows = max(1, -(-len(chosen) // columns))
    stages = _stages(data, chosen, preprocessing)
    with drawing(path, 12, 0.6 + 3.3 * rows) as figure:
        figure.suptitle(title if len(chosen) else f"{title}: none")
        grid = figure.subplots(2 * rows, columns, squeeze=False)
        for axes in grid.ravel():
            axes.axis("off")
        for place, index in enumerate(chosen.tolist()):
            row, column = divmod(place, columns)
            k = int(given.probability[index].argmax())
            above, below = grid[2 * row, column], grid[2 * row + 1, column]
            _show(above, stages[place][0])
            _show(below, stages[place][2])
            truth, said = given.classes[given.label[index]], given.classes[k]
            above.set_title(
                f"{truth}, said {said}\n{given.probability[index, k]:.3f}  {given.site[index]}",
                fontsize=7,
            )
    return len(chosen)


def draw_stages(data: Dataset, preprocessing: Preprocessing, title: str, path: Path) -> None:
    """Draw the paper's Fig. 5: grayscale, sharpened and reconstructed, columns from each class."""
    per_class = max(1, STAGES // len(data.classes))
    rng = np.random.default_rng(0)
    chosen = np.concatenate(
        [
            np.sort(rng.permutation(np.flatnonzero(data.label == k))[:per_class])
            for k in range(len(data.classes))
        ]
    )
    stages = _stages(data, chosen, preprocessing)
    with drawing(path, 1.5 * len(chosen) + 0.5, 5.2) as figure:
        figure.suptitle(title)
        grid = figure.subplots(3, len(chosen), squeeze=False)
        for column, index in enumerate(chosen.tolist()):
            for row, name in enumerate(("grayscale", "sharpened", "reconstruction")):
                axes = grid[row, column]
                _show(axes, stages[column][row])
                axes.set_xticks([])
                axes.set_yticks([])
                if column == 0:
                    axes.set_ylabel(name)
            grid[0, column].set_title(data.classes[data.label[index]], fontsize=9)


def _stages(
    data: Dataset, chosen: NDArray[np.int64], preprocessing: Preprocessing
) -> list[tuple[F32, F32, F32]]:
    """Return each picture at the network's size: plain, sharpened and reconstructed."""
    both = preprocessing.model_copy(
        update={"channels": ("gray", "radon"), "standardisation": "none"}
    )
    extractor = Extractor(both)
    found: list[tuple[F32, F32, F32]] = []
    for index in chosen.tolist():
        picture = data.luminance(index)
        features = extractor(picture)
        found.append((shrink(cropped(picture, both.crop), both.size), features[0], features[1]))
    return found


def _show(axes: Any, picture: F32) -> None:
    low, high = np.percentile(picture, [0.5, 99.5])
    axes.imshow(picture, cmap="gray", vmin=low, vmax=max(high, low + 1e-6))
