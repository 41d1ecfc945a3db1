"""Table IV as Markdown and as a picture."""

# Matplotlib leaves many of its own members without types.
# pyright: reportUnknownMemberType=false

from math import floor
from pathlib import Path
from textwrap import fill

from juncnet.learning.evaluation.compare import (
    PAPER_FIGURES,
    SEEN,
    UNSEEN,
    Comparison,
    Entry,
    unknown_sites,
)
from juncnet.learning.evaluation.contestants import NAMES
from juncnet.learning.evaluation.plots import drawing
from juncnet.learning.evaluation.report import area
from juncnet.learning.evaluation.scores import GroupScore
from juncnet.learning.evaluation.tables import percent, table


def titles(comparison: Comparison) -> list[str]:
    """Return the names of the columns as the table shows them."""
    return [
        f"{comparison.data}, {name}" if name in (UNSEEN, SEEN) else name
        for name in (comparison.entries[0].columns if comparison.entries else ())
    ]


def markdown(comparison: Comparison, picture: str) -> str:
    """Return the comparison as Markdown; `picture` is the file name of its bars."""
    names = titles(comparison)
    heads = ["method", *names, "paper's own pictures"]
    rows = [
        [
            entry.name,
            *(percent(s.balanced_accuracy, s.balanced_accuracy_interval) for s in _scores(entry)),
            PAPER_FIGURES.get(entry.name, ""),
        ]
        for entry in comparison.entries
    ]
    areas = [
        [entry.name, *(area(s.auc, s.auc_interval) for s in _scores(entry))]
        for entry in comparison.entries
    ]
    recipes = [
        [
            entry.name,
            str(entry.pictures_seen),
            "" if entry.weights is None else str(entry.weights),
            "" if entry.training_cpu_s is None else f"{entry.training_cpu_s / 60:.1f}",
            entry.how,
        ]
        for entry in comparison.entries
    ]
    sizes = ", ".join(
        f"{s.n} pictures of {s.sites} sites ({title})"
        for title, s in zip(names, _scores(comparison.entries[0]), strict=True)
    )
    return "\n".join(
        [
            f"# Table IV on {comparison.data}",
            "",
            f"Trained on {comparison.n_train} pictures of {comparison.train_sites} sites; tested "
            f"on {sizes}. One training serves all columns: *seen sites* are other pictures of the "
            "training sites (the paper's protocol), *unseen sites* are other sites. Nothing is "
            "pretrained, every network saw as many pictures, kNN and SVM chose their settings on "
            f"{comparison.n_validation} pictures of other sites. The paper's own pictures (and "
            "its ImageNet junction set) are not public: its figures are on seen sites.",
            "",
            "Balanced accuracy (95 %, whole sites drawn with replacement):",
            "",
            table(heads, rows),
            "",
            "AUC:",
            "",
            table(["method", *names], areas),
            "",
            *unknown_sites(comparison),
            f"![Balanced accuracy]({picture})",
            "",
            table(["method", "pictures seen", "weights", "CPU minutes", "how"], recipes),
            "",
            *_missing(comparison),
            f"Made by `{comparison.command}` on {comparison.machine}; seed {comparison.seed}.",
            "",
        ]
    )


def _missing(comparison: Comparison) -> list[str]:
    there = {entry.name for entry in comparison.entries}
    missing = [name for name in NAMES if name not in there]
    return [f"Not trained yet: {'; '.join(missing)}. `--resume` goes on.", ""] if missing else []


def _scores(entry: Entry) -> list[GroupScore]:
    return list(entry.columns.values())


def draw(comparison: Comparison, path: Path, title: str) -> None:
    """Draw the balanced accuracy of every contestant on every column with its interval."""
    names = titles(comparison)
    with drawing(path, max(7.0, 1.0 * len(comparison.entries)), 4.5) as figure:
        axes = figure.add_subplot()
        width = 0.8 / max(len(names), 1)
        for place, name in enumerate(names):
            scores = [_scores(entry)[place] for entry in comparison.entries]
            left = [i + (place - (len(names) - 1) / 2) * width for i in range(len(scores))]
            heights = [100 * s.balanced_accuracy for s in scores]
            axes.bar(left, heights, width, label=name)
            for x, s in zip(left, scores, strict=True):
                if s.balanced_accuracy_interval is not None:
                    low, high = (100 * value for value in s.balanced_accuracy_interval)
                    axes.plot([x, x], [low, high], color="black", lw=1)
        axes.axhline(50, color="grey", lw=0.8, ls=":")
        axes.set_xticks(
            range(len(comparison.entries)),
            [fill(entry.name, 11, break_long_words=False) for entry in comparison.entries],
            fontsize=8,
        )
        axes.set(ylabel="balanced accuracy, %", ylim=(_floor(comparison), 100), title=title)
        # Outside: wherever bars and intervals may be, there is no free place among them.
        axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def _floor(comparison: Comparison) -> float:
    """Return where the axis of balanced accuracies begins, in %: below every bar and interval."""
    scores = [score for entry in comparison.entries for score in _scores(entry)]
    least = [(s.balanced_accuracy_interval or (s.balanced_accuracy,))[0] for s in scores]
    return min([40.0, *(10 * floor(10 * value) for value in least)])
