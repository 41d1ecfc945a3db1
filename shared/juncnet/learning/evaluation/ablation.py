"""What each step of the preprocessing is worth: the same training, one thing changed at a time."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Literal

from torch import nn

from juncnet.features import Preprocessing
from juncnet.learning.datasets import Dataset
from juncnet.learning.evaluation.compare import (
    Comparison,
    Entry,
    columns_of,
    judged,
    unknown_sites,
)
from juncnet.learning.evaluation.contestants import Budget, Rival, train_network
from juncnet.learning.evaluation.protocols import Parts
from juncnet.learning.evaluation.tables import percent, table
from juncnet.learning.pictures import prepared
from juncnet.learning.recipes import PRESETS
from juncnet.network import PaperNet, build

BASE = Preprocessing(standardisation="per_image")
"""What is changed: grayscale and reconstruction, sharpened, 180 angles, ramp, 64x64, no circle."""
REFERENCE = "gray and Radon (reference)"
VARIANTS: dict[str, Preprocessing] = {
    REFERENCE: BASE,
    "gray only": BASE.model_copy(update={"channels": ("gray",)}),
    "Radon only": BASE.model_copy(update={"channels": ("radon",)}),
    "no sharpening": BASE.model_copy(update={"sharpening": 0.0}),
    "circle": BASE.model_copy(update={"circle": True}),
    "18 angles": BASE.model_copy(update={"angles": 18}),
    "60 angles": BASE.model_copy(update={"angles": 60}),
    "filter Hann": BASE.model_copy(update={"filter": "hann"}),
    "filter Shepp-Logan": BASE.model_copy(update={"filter": "shepp-logan"}),
    "no filter": BASE.model_copy(update={"filter": None}),
    "32x32": BASE.model_copy(update={"size": 32}),
    "96x96": BASE.model_copy(update={"size": 96}),
    "not standardised": BASE.model_copy(update={"standardisation": "none"}),
}
Base = Literal["tuned", "robust"]


@dataclass(frozen=True)
class Subject:
    """What is trained and tested in every variant."""

    base: Base
    """The recipe: `tuned` is the paper's network, `robust` the better one."""
    parts: Parts
    sets: Mapping[str, Dataset]
    """What it is tested on, by name."""


def variants(base: Base) -> dict[str, Preprocessing]:
    """Return the variants that this network takes: `robust` is made for 64x64 alone."""
    return {name: p for name, p in VARIANTS.items() if base == "tuned" or p.size == BASE.size}


def ablate(
    name: str, subject: Subject, budget: Budget, clock: Callable[[], float] = time.process_time
) -> Entry:
    """Train and test a variant.

    Raises:
        DatasetError: a picture cannot be read.
    """
    preprocessing = VARIANTS[name]
    train, validation = (
        prepared([part], preprocessing) for part in (subject.parts.train, subject.parts.validation)
    )
    columns = columns_of(subject.sets, subject.parts.train.classes, preprocessing)
    preset = PRESETS[subject.base]
    recipe = preset.model_copy(update={"preprocessing": preprocessing, "mask_weight": 0})

    def make(channels: int, classes: int, dropout: float) -> nn.Module:
        if subject.base == "tuned":
            return PaperNet(channels, classes, preprocessing.size, dropout)
        return build("robust", channels, classes, dropout)

    started = clock()
    rival = Rival(make, recipe, f"preset {subject.base}")
    trained = train_network(name, rival, train, validation, budget)
    spent = clock() - started
    return Entry(
        name=name,
        how=trained.how,
        pictures_seen=trained.pictures_seen,
        weights=trained.weights,
        training_cpu_s=None if trained.resumed else spent,
        columns={title: judged(trained, tested) for title, tested in columns.items()},
    )


def markdown(ablation: Comparison, picture: str) -> str:
    """Return the table, differences to the reference in points of balanced accuracy."""
    reference = next((e for e in ablation.entries if e.name == REFERENCE), None)
    names = list(ablation.entries[0].columns)
    rows: list[list[str]] = []
    for entry in ablation.entries:
        cells = [entry.name]
        for name in names:
            own = entry.columns[name]
            text = percent(own.balanced_accuracy, own.balanced_accuracy_interval)
            if reference is not None and entry is not reference:
                change = own.balanced_accuracy - reference.columns[name].balanced_accuracy
                text += f", {100 * change:+.1f}"
            auc = "" if own.auc is None else f"{own.auc:.3f}"
            cells += [text, auc]
        rows.append(cells)
    heads = ["variant"]
    for name in names:
        size = ablation.entries[0].columns[name]
        heads += [f"{name} ({size.n} of {size.sites} sites): balanced accuracy", "AUC"]
    return "\n".join(
        [
            f"# What the preprocessing is worth, on {ablation.data}",
            "",
            f"The same training ({ablation.entries[0].how}) on the same {ablation.n_train} "
            f"pictures of {ablation.train_sites} sites, one step of the preprocessing changed at "
            "a time; behind the comma the change in points. Intervals: 95 %, whole sites drawn "
            "with replacement; one seed, whose own spread is not in them: changes smaller than "
            "the intervals mean nothing.",
            "",
            table(heads, rows),
            "",
            *unknown_sites(ablation),
            f"![Balanced accuracy]({picture})",
            "",
            f"Made by `{ablation.command}` on {ablation.machine}; seed {ablation.seed}.",
            "",
        ]
    )
