"""The paper's Table IV on one's own data: every contestant on the same pictures."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from pydantic import BaseModel, ConfigDict

from juncnet.features import Preprocessing
from juncnet.learning.datasets import Dataset, DatasetError, sites_of
from juncnet.learning.evaluation.answers import Answers
from juncnet.learning.evaluation.contestants import Budget, Trained, train
from juncnet.learning.evaluation.protocols import Parts
from juncnet.learning.evaluation.scores import GroupScore, main_figures
from juncnet.learning.pictures import Pictures, prepared

PAPER_FIGURES = {
    "kNN": "52.45 / 48.87",
    "SVM": "74.34 / 68.87",
    "1-CNN, 2-FCN": "90.12 / 91.22",
    "AlexNet": "94.22 / 94.34",
    "JuncNet, paper's recipe": "98.74 / 97.34",
}
"""Per cent on its ImageNet junctions and on its own videos: seen sites, pictures not public."""
UNSEEN, SEEN = "unseen sites", "seen sites"


class Entry(BaseModel):
    """A contestant and its figures."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    how: str
    pictures_seen: int
    weights: int | None
    training_cpu_s: float | None
    """None: trained in parts, by several processes."""
    columns: dict[str, GroupScore]


class Comparison(BaseModel):
    """Table IV on a dataset."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    data: str
    preset: str | None = None
    """Of an ablation: whose network and recipe."""
    command: str
    machine: str
    seed: int
    epochs: float
    n_train: int
    train_sites: int
    n_validation: int
    sites_unknown: tuple[str, ...] = ()
    """Columns of which nobody told all sites: clips or single pictures stand for them."""
    entries: tuple[Entry, ...]

    def with_entry(self, entry: Entry, order: Sequence[str]) -> "Comparison":
        """Return the table with one more contestant, in the order of all their names."""
        entries = sorted([*self.entries, entry], key=lambda e: order.index(e.name))
        return self.model_copy(update={"entries": tuple(entries)})


@dataclass(frozen=True)
class Column:
    """A set that all are tested on."""

    data: Dataset
    pictures: Pictures
    """Their labels are indices into `classes`, whatever order those of `data` have."""
    classes: tuple[str, ...]
    """Those that are trained."""


def judged_sets(
    parts: Parts, also: Mapping[str, Dataset], limit: int | None = None
) -> dict[str, Dataset]:
    """Return what all are tested on: unseen sites, seen sites, and further sets by name.

    Of each, `limit` of its judged pictures at most, drawn at random.

    Raises:
        DatasetError: a set has other classes than those that are trained, or nothing to judge.
    """
    found: dict[str, Dataset] = {}
    for name, data in {UNSEEN: parts.unseen, SEEN: parts.seen, **also}.items():
        if set(data.classes) != set(parts.train.classes):
            raise DatasetError(
                f"{name}: its classes are {', '.join(data.classes)}, those that are trained "
                f"{', '.join(parts.train.classes)}: test on a set of the same classes"
            )
        rows = np.flatnonzero((data.label >= 0) & np.isfinite(data.target).all(axis=1))
        if not len(rows):
            raise DatasetError(
                f"{name}: it has no picture of a class: label some of its pictures, or leave it out"
            )
        if limit is not None and len(rows) > limit:
            rows = np.sort(np.random.default_rng(5).permutation(rows)[:limit])
        found[name] = data.take(rows)
    return found


def sizes(sets: Mapping[str, Dataset]) -> list[tuple[str, int, int]]:
    """Return the name of each set with the numbers of its pictures and sites."""
    return [(name, len(data), len(np.unique(sites_of(data)[0]))) for name, data in sets.items()]


def columns_of(
    sets: Mapping[str, Dataset], classes: tuple[str, ...], preprocessing: Preprocessing
) -> dict[str, Column]:
    """Return the test sets in memory, their labels in the order of `classes`."""
    return {
        name: Column(data, prepared([data], preprocessing, classes), classes)
        for name, data in sets.items()
    }


def compete(
    name: str,
    data: Pictures,
    validation: Pictures,
    columns: dict[str, Column],
    budget: Budget,
    clock: Callable[[], float] = time.process_time,
) -> Entry:
    """Train a contestant and test it on every column.

    Raises:
        MissingLibraryError: scikit-learn is needed and not installed.
    """
    started = clock()
    trained = train(name, data, validation, budget)
    return Entry(
        name=name,
        how=trained.how,
        pictures_seen=trained.pictures_seen,
        weights=trained.weights,
        training_cpu_s=None if trained.resumed else clock() - started,
        columns={title: judged(trained, tested) for title, tested in columns.items()},
    )


def judged(trained: Trained, tested: Column) -> GroupScore:
    """Return how a contestant does on a column."""
    site, _ = sites_of(tested.data)
    pictures = tested.pictures
    return main_figures(
        Answers(tested.classes, trained.answer(pictures.gray), pictures.label, site, site)
    )


def unknown_sites(comparison: Comparison) -> list[str]:
    """Return the paragraph about columns whose sites are unknown, if there are any."""
    if not comparison.sites_unknown:
        return []
    names = ", ".join(comparison.sites_unknown)
    text = (
        f"The sites of {names} are unknown (samples.csv may tell them): clips, or else single "
        "pictures, were counted and drawn instead, and the intervals are too narrow."
    )
    return [text, ""]
