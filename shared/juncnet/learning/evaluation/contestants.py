"""Who is compared in Table IV: each with a recipe that serves it, all shown as many pictures."""

# Torch leaves these of its own members without types.
# pyright: reportUnknownMemberType=false

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from juncnet.features import Extractor
from juncnet.learning.evaluation.benchmark import length_text
from juncnet.learning.evaluation.classical import (
    Classical,
    train_neighbours,
    train_support_vectors,
)
from juncnet.learning.evaluation.rivals import AlexNet, OneConvNet, Vgg
from juncnet.learning.fit import Trainer, predict
from juncnet.learning.pictures import Pictures
from juncnet.learning.recipes import PRESETS, Recipe
from juncnet.network import build, parameters

Bytes = NDArray[np.uint8]
Answer = Callable[[Bytes], NDArray[np.float32]]
"""From pictures (N, 64, 64) to probabilities (N, K)."""
MakeNetwork = Callable[[int, int, float], nn.Module]
"""Of channels, classes and dropout."""
TrainClassical = Callable[[Bytes, NDArray[np.int64], Bytes, NDArray[np.int64]], Classical]


@dataclass(frozen=True)
class Trained:
    """A contestant after its training."""

    answer: Answer
    how: str
    """What it is and how it was trained, for the table."""
    pictures_seen: int
    """Repetitions counted."""
    weights: int | None
    resumed: bool = False
    """Whether a part of the training was done by an earlier process."""


@dataclass(frozen=True)
class Rival:
    """A network and its recipe."""

    make: MakeNetwork
    recipe: Recipe
    what: str


@dataclass(frozen=True)
class Budget:
    """What every network gets."""

    epochs: float
    seed: int
    checkpoints: Path | None
    progress: Callable[[int, int], None]


TUNED, PAPER, ROBUST = PRESETS["tuned"], PRESETS["paper"], PRESETS["robust"]
RIVALS: dict[str, Rival] = {
    "1-CNN, 2-FCN": Rival(OneConvNet, TUNED, "one convolution, two dense layers"),
    "AlexNet": Rival(
        AlexNet, TUNED.model_copy(update={"rate": 5e-4}), "first stride 2, dense 1024 and 512"
    ),
    "VGG": Rival(
        Vgg,
        ROBUST.model_copy(update={"rate": 2e-3, "dropout": 0.5, "mask_weight": 0}),
        "VGG-11, batch normalisation, half the filters",
    ),
    "JuncNet, paper's recipe": Rival(
        lambda channels, classes, dropout: build("paper", channels, classes, dropout),
        PAPER,
        "the paper's network",
    ),
    "JuncNet, tuned": Rival(
        lambda channels, classes, dropout: build("paper", channels, classes, dropout),
        TUNED,
        "the paper's network",
    ),
    "JuncNet, robust": Rival(
        lambda channels, classes, dropout: build("robust", channels, classes, dropout),
        ROBUST.model_copy(update={"mask_weight": 0}),
        "six convolutions, batch normalisation",
    ),
}
CLASSICAL: dict[str, TrainClassical] = {"kNN": train_neighbours, "SVM": train_support_vectors}
WATCHED = 200
"""Validation pictures on which networks are watched; nothing is chosen by them."""
NAMES = (*CLASSICAL, *RIVALS)
"""In the order of the table."""


def train(name: str, data: Pictures, validation: Pictures, budget: Budget) -> Trained:
    """Train the contestant of this name.

    Args:
        name: one of `NAMES`.
        data: what all are trained on.
        validation: of other sites; kNN and SVM choose their settings on it.
        budget: of the networks.

    Raises:
        MissingLibraryError: scikit-learn is not installed.
    """
    if name in CLASSICAL:
        label = data.target.argmax(axis=1)
        known = validation.label >= 0
        found = CLASSICAL[name](data.gray, label, validation.gray[known], validation.label[known])
        return Trained(found, found.how, len(data), None)
    return train_network(name, RIVALS[name], data, validation, budget)


def train_network(
    name: str, rival: Rival, data: Pictures, validation: Pictures, budget: Budget
) -> Trained:
    """Train a network; `name` is that of its checkpoint, all else is as for `train`."""
    recipe = rival.recipe.model_copy(update={"epochs": budget.epochs})
    extractor = Extractor(recipe.preprocessing)
    torch.manual_seed(budget.seed)
    channels, classes = len(recipe.preprocessing.channels), data.target.shape[1]
    network = rival.make(channels, classes, recipe.dropout)
    trainer = Trainer(network, data, _watched(validation), recipe, budget.seed, extractor)
    checkpoint, resumed = None, False
    if budget.checkpoints is not None:
        budget.checkpoints.mkdir(parents=True, exist_ok=True)
        checkpoint = budget.checkpoints / f"{name.replace(' ', '_')}.pt"
        resumed = checkpoint.exists()
        if resumed:
            trainer.resume(checkpoint)
    trainer.run(checkpoint, lambda step, steps, curve: budget.progress(step, steps))
    length = length_text(budget.epochs, rival.recipe.epochs)
    return Trained(
        lambda gray: predict(network, gray, extractor),
        f"{rival.what}; {recipe.describe()}; {length}",
        trainer.steps * recipe.batch,
        parameters(network),
        resumed,
    )


def _watched(validation: Pictures) -> Pictures:
    known = np.flatnonzero(validation.label >= 0)
    rows = known[np.linspace(0, len(known) - 1, min(WATCHED, len(known))).astype(int)]
    return Pictures(
        validation.gray[rows],
        validation.target[rows],
        validation.label[rows],
        validation.mask[rows],
        validation.masked[rows],
    )
