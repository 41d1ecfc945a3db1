"""The paper's Tables II and III: its network on MNIST and CIFAR-10.

Everything is chosen on a held-out part of the training pictures; the test pictures are used once,
when a run is over, and no run is dropped.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict
from torch import nn

from juncnet.features import Extractor
from juncnet.learning.evaluation.image_sets import ImageSet, digest
from juncnet.learning.evaluation.intervals import binomial_interval
from juncnet.learning.evaluation.small_pictures import ColourExtractor, SmallPictureTrainer
from juncnet.learning.fit import Point, predict
from juncnet.learning.pictures import Pictures
from juncnet.learning.recipes import PRESETS, Recipe
from juncnet.network import build, parameters

HELD_OUT = 2500
"""Training pictures that choices are made on; a tenth of the set where that is less."""
AIMS = {"MNIST": 0.9945, "CIFAR-10": 0.8315, "JPEG CIFAR-10": 0.8315}
"""The paper's accuracies: 0.55 % error and 83.15 %."""
RECIPES = {name: PRESETS[name] for name in ("paper", "tuned")}
"""Those of roads: the same numbers for digits, objects and junctions."""


class CurvePoint(BaseModel):
    """Where training stood."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    samples: int
    """Pictures seen so far, repetitions counted."""
    loss: float
    held_out_accuracy: float
    """Balanced, of the averaged weights where the recipe averages."""

    @classmethod
    def of(cls, point: Point) -> "CurvePoint":
        """Return the point of a training."""
        return cls(
            samples=point.samples, loss=point.loss, held_out_accuracy=point.balanced_accuracy
        )


class SeedResult(BaseModel):
    """One training from one seed."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    seed: int
    test_accuracy: float
    curve: tuple[CurvePoint, ...]


class Row(BaseModel):
    """A recipe and what it gives; figures are fractions."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    recipe: Recipe
    full_epochs: float
    """What the recipe asks for; the run had `recipe.epochs`."""
    command: str
    n_train: int
    n_held_out: int
    n_test: int
    weights: int
    runs: tuple[SeedResult, ...]

    @property
    def accuracy(self) -> float:
        """The mean over seeds on the test pictures."""
        return float(np.mean([run.test_accuracy for run in self.runs]))

    @property
    def held_out_accuracy(self) -> float:
        """The mean over seeds on the held-out part."""
        return float(np.mean([run.curve[-1].held_out_accuracy for run in self.runs]))

    @property
    def spread(self) -> float | None:
        """The standard deviation over seeds; None for a single one."""
        if len(self.runs) < 2:
            return None
        return float(np.std([run.test_accuracy for run in self.runs], ddof=1))

    @property
    def interval(self) -> tuple[float, float]:
        """95 % for the mean accuracy by the number of test pictures alone."""
        return binomial_interval(self.accuracy, self.n_test)

    @property
    def length(self) -> str:
        """How long it was trained, and by how much that is shorter than the recipe asks for."""
        return length_text(self.recipe.epochs, self.full_epochs)


def length_text(epochs: float, full_epochs: float) -> str:
    """Return the length of a training, told beside the length that it should have had."""
    if epochs >= full_epochs:
        return f"{epochs:g} epochs"
    return f"{epochs:g} epochs (shortened to {100 * epochs / full_epochs:.3g} % of {full_epochs:g})"


@dataclass(frozen=True)
class Settings:
    """How a row is trained."""

    name: str
    """Of the recipe."""
    recipe: Recipe
    seeds: tuple[int, ...]
    checkpoints: Path | None
    """A folder for all runs."""


def run_row(
    images: ImageSet,
    settings: Settings,
    command: str,
    progress: Callable[[int, int, list[Point]], None] | None = None,
) -> Row:
    """Train from each seed, test each once, and return the row.

    Args:
        images: the set.
        settings: how to train.
        command: what is written beside the figures.
        progress: called after every step with the step, their number and the curve so far.

    Raises:
        CheckpointError: there is one of another run where this one's should be.
    """
    bench = _Bench(images, settings)
    runs = tuple(bench.run(seed, progress) for seed in settings.seeds)
    return Row(
        name=settings.name,
        recipe=settings.recipe,
        full_epochs=RECIPES[settings.name].epochs,
        command=command,
        n_train=len(bench.data),
        n_held_out=len(bench.held_out),
        n_test=len(images.test),
        weights=parameters(bench.network()),
        runs=runs,
    )


class _Bench:
    """What the runs of a row have in common."""

    def __init__(self, images: ImageSet, settings: Settings) -> None:
        self._images, self._settings = images, settings
        self._colour = images.train.ndim == 4
        kind = ColourExtractor if self._colour else Extractor
        self._extractor = kind(settings.recipe.preprocessing)
        self.data, self.held_out = _parts(images)

    def network(self) -> nn.Module:
        """Return the paper's network, untrained, for these channels and classes."""
        channels, classes = 4 if self._colour else 2, len(self._images.classes)
        return build("paper", channels, classes, self._settings.recipe.dropout)

    def run(
        self, seed: int, progress: Callable[[int, int, list[Point]], None] | None
    ) -> SeedResult:
        """Train from a seed, or go on, and test once."""
        images, recipe = self._images, self._settings.recipe
        torch.manual_seed(seed)  # pyright: ignore[reportUnknownMemberType]
        network = self.network()
        trainer = SmallPictureTrainer(
            network, self.data, self.held_out, recipe, seed, self._extractor, images.mirror
        )
        path = _checkpoint(images, self._settings, seed)
        if path is not None and path.exists():
            trainer.resume(path)
        trainer.run(path, progress)
        answer = predict(network, images.test, self._extractor).argmax(axis=1)
        curve = [CurvePoint.of(point) for point in trainer.curve]
        right = float((answer == images.test_label).mean())
        return SeedResult(seed=seed, test_accuracy=right, curve=tuple(curve))


def _parts(images: ImageSet) -> tuple[Pictures, Pictures]:
    order = np.random.default_rng(0).permutation(len(images.train))
    count = min(HELD_OUT, len(order) // 10)
    classes = len(images.classes)
    return (
        in_memory(images.train, images.train_label, classes, np.sort(order[count:])),
        in_memory(images.train, images.train_label, classes, order[:count]),
    )


def in_memory(
    pictures: NDArray[np.uint8],
    label: NDArray[np.int64],
    classes: int,
    rows: NDArray[np.int64],
) -> Pictures:
    """Return these rows of labelled pictures as training takes them."""
    return Pictures(
        gray=pictures[rows],
        target=np.eye(classes, dtype=np.float32)[label[rows]],
        label=label[rows],
        mask=np.zeros((len(rows), 1, 1), np.uint8),
        masked=np.zeros(len(rows), np.bool_),
    )


def _checkpoint(images: ImageSet, settings: Settings, seed: int) -> Path | None:
    if settings.checkpoints is None:
        return None
    settings.checkpoints.mkdir(parents=True, exist_ok=True)
    name = images.name.lower().replace(" ", "-")
    copy = digest(images.test[:100])
    epochs = f"{settings.recipe.epochs:g}"
    return settings.checkpoints / f"{name}-{settings.name}-{epochs}-{seed}-{copy}.pt"
