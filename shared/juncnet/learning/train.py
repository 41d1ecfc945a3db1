"""From datasets to a model file: split, train, export, and say how it went."""

# Torch leaves these of its own members without types.
# pyright: reportUnknownMemberType=false

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from pydantic import TypeAdapter, ValidationError

from juncnet.camera import FAR_HEIGHTS, NEAR_ROW
from juncnet.features import Extractor
from juncnet.inference import Network
from juncnet.learning.datasets import Dataset, DatasetError, sites_of
from juncnet.learning.export import Exported, export
from juncnet.learning.fit import CheckpointError, Point, Trainer, predict
from juncnet.learning.footage.intervals import FootageError
from juncnet.learning.footage.splits import deal_groups
from juncnet.learning.pictures import prepared
from juncnet.learning.recipes import FINE_TUNING_RATE, Recipe
from juncnet.learning.weights import WeightsError, start_from
from juncnet.messages import Name
from juncnet.modelfile import ModelFileError, ModelMetadata
from juncnet.network import Architecture, build

HELD_OUT = 0.15
"""Share of the sites that is judged and not trained on, where a dataset has no validation part."""
_NAME: TypeAdapter[str] = TypeAdapter(Name)
Progress = Callable[[int, int, list[Point]], None]


@dataclass(frozen=True)
class Parts:
    """What is trained on and what is judged."""

    training: Dataset
    validation: Dataset
    how: str
    """How they were divided, for the card."""


@dataclass(frozen=True)
class Outcome:
    """What became of a training."""

    finished: bool
    curve: list[Point]
    pictures: int
    parts: tuple[str, ...]
    """How each dataset was divided."""
    exported: Exported | None


@dataclass(frozen=True)
class Order:
    """What is to be trained."""

    recipe: Recipe
    seed: int
    name: str
    out: Path
    start: Path | None = None
    """A model file to go on from."""
    int8: bool = False
    """Whether the file's large weights are stored as int8."""

    def __post_init__(self) -> None:
        """Refuse what no model may be called, before anything is done.

        Raises:
            ValueError: the name cannot stand in a model file.
        """
        try:
            _NAME.validate_python(self.name)
        except ValidationError as error:
            raise ValueError(
                f"a model cannot be called {self.name!r}: give it another name with --name, of "
                "letters, digits, '_', '-' and '.'"
            ) from error

    @property
    def checkpoint(self) -> Path:
        """Where the state is kept while training."""
        return self.out.with_suffix(".checkpoint")


def divide(dataset: Dataset, seed: int) -> Parts:
    """Return the parts to train on and to judge: the dataset's own, or whole sites or clips.

    Pictures of the part *test* are in neither. Where there are too few sites and clips to hold any
    back, everything is trained on, and judged on the same: `how` says so.

    Raises:
        DatasetError: all pictures are of the parts validation and test.
    """
    own = dataset.where(dataset.split != "test")
    judged = own.split == "validation"
    if judged.all():
        raise DatasetError(
            f"no picture to train on: all {len(dataset)} are of the parts validation and test; "
            "leave this dataset out, or extract it with other --shares"
        )
    if judged.any():
        return Parts(own.where(~judged), own.where(judged), "its own validation part")
    site, known = sites_of(own)
    for word, groups in (("sites" if known else "clips and sites", site), ("clips", own.clip)):
        held = _held_out(own, groups, seed)
        if held is not None:
            count = len(np.unique(groups[held]))
            how = f"{count} of {len(np.unique(groups))} {word} held out"
            return Parts(own.where(~held), own.where(held), how)
    return Parts(own, own, "nothing held out: too few sites and clips; judged on what it saw")


def _held_out(dataset: Dataset, groups: np.ndarray, seed: int) -> np.ndarray | None:
    """Return which pictures are held out, or None: both parts would not have every class."""
    counts: dict[str, dict[str, int]] = {}
    for group in np.unique(groups):
        labels = dataset.label[groups == group]
        counts[str(group)] = {
            name: int((labels == k).sum()) for k, name in enumerate(dataset.classes)
        }
    try:
        split = deal_groups(counts, {}, (1 - HELD_OUT, HELD_OUT, 0.0), seed)
    except FootageError:
        return None
    held = np.array([split[str(group)] == "validation" for group in groups])
    for part in (dataset.label[held], dataset.label[~held]):
        if any(not (part == k).any() for k in range(len(dataset.classes))):
            return None
    return held


def train(
    datasets: Sequence[Dataset],
    order: Order,
    resume: bool = False,
    progress: Progress | None = None,
    stop: Callable[[], bool] = lambda: False,
    watched: Dataset | None = None,
    judging: Callable[[int, int], None] | None = None,
) -> Outcome:
    """Train on all datasets and write the model file; where `stop` says so, a checkpoint only.

    `watched` is judged at every point of the curve; it is never trained on and decides nothing.
    `judging` is told how many of the pictures were given to the model that the training starts
    from, where its mistakes are looked for.

    Raises:
        DatasetError, WeightsError, CheckpointError, ModelFileError, DivergedError: what is wrong
            and what to do.
    """
    if order.checkpoint.exists() and not resume:
        raise CheckpointError(
            f"{order.checkpoint}: a training that was not finished: go on with --resume, or remove "
            "it to start anew"
        )
    classes = datasets[0].classes
    if classes[0] != "none":
        raise DatasetError(f"the first class must be none, for plain road: {', '.join(classes)}")
    recipe, extractor = order.recipe, Extractor(order.recipe.preprocessing)
    parts = [divide(dataset, order.seed) for dataset in datasets]
    training = prepared([p.training for p in parts], recipe.preprocessing)
    validation = prepared([p.validation for p in parts], recipe.preprocessing)
    if not len(training) or not (validation.label >= 0).any():
        raise DatasetError("no picture says what it shows: label some (`juncnet dataset label`)")
    torch.manual_seed(order.seed)
    channels = len(recipe.preprocessing.channels)
    network = build(recipe.architecture, channels, len(classes), recipe.dropout, recipe.mirror_mean)
    if order.start is not None:
        start_from(network, order.start, _metadata_of(order.start).classes == classes)
    if recipe.repeat_wrong > 1:
        given = predict(network, training.gray, extractor, judging)
        training = training.with_wrong_repeated(given, recipe.repeat_wrong)
    seen = None if watched is None else prepared([watched], recipe.preprocessing, classes)
    trainer = Trainer(network, training, validation, recipe, order.seed, extractor, seen)
    if resume and order.checkpoint.exists():
        trainer.resume(order.checkpoint)
    divided = tuple(part.how for part in parts)
    if not trainer.run(order.checkpoint, progress, stop):
        return Outcome(False, trainer.curve, len(training), divided, None)
    exported = export(network, _metadata(order, classes, len(training)), order.out, order.int8)
    order.checkpoint.unlink()
    return Outcome(True, trainer.curve, len(training), divided, exported)


def _metadata(order: Order, classes: tuple[str, ...], pictures: int) -> ModelMetadata:
    before = f", from {_metadata_of(order.start).name}" if order.start else ""
    return ModelMetadata(
        name=order.name,
        architecture=order.recipe.architecture,
        classes=classes,
        preprocessing=order.recipe.preprocessing,
        near_row=NEAR_ROW,
        far_heights=FAR_HEIGHTS,
        mirror_mean=order.recipe.mirror_mean,
        recipe=f"{order.recipe.describe()}; {pictures} pictures, seed {order.seed}{before}",
    )


def _metadata_of(path: Path) -> ModelMetadata:
    try:
        return ModelMetadata.from_properties(Network(path.read_bytes()).properties)
    except (OSError, ValueError) as error:
        raise ModelFileError(f"{path}: {error}") from error


def recipe_from(recipe: Recipe, start: Path) -> Recipe:
    """Return a preset's recipe for going on from the model in `start`.

    Its preprocessing, and whether it looks at the mirror image, are the model's, its rate a
    fraction of the preset's.

    Raises:
        ModelFileError: no model there.
        WeightsError: its architecture is another.
    """
    metadata = _metadata_of(start)
    architectures: tuple[Architecture, ...] = ("paper", "robust")
    if metadata.architecture != recipe.architecture and metadata.architecture in architectures:
        raise WeightsError(
            f"{start} has the architecture {metadata.architecture}, the preset "
            f"{recipe.architecture}: name a preset of the same one"
        )
    changed = {
        "preprocessing": metadata.preprocessing,
        "rate": recipe.rate * FINE_TUNING_RATE,
        "keep_best": True,
        "mirror_mean": metadata.is_mirror_mean,
    }
    return recipe.model_copy(update=changed)


def write_report(order: Order, outcome: Outcome, command: str) -> None:
    """Write the model's card and its curve as data beside it, `.md` and `.json`."""
    losses = [f"{p.loss:.4f}" if p.samples else "-" for p in outcome.curve]
    rows = "\n".join(
        f"| {p.samples} | {loss} | {100 * p.balanced_accuracy:.2f} % |"
        for p, loss in zip(outcome.curve, losses, strict=True)
    )
    metadata = _metadata_of(order.out)
    mean = ": the mean over the picture and its mirror image" if metadata.is_mirror_mean else ""
    p, size = metadata.preprocessing, order.out.stat().st_size
    text = f"""# {metadata.name}

Tells {", ".join(metadata.classes)} apart in a forward camera's picture.

| | |
|---|---|
| file | `{order.out.name}`, {size / 1e6:.1f} MB{", large weights as int8" if order.int8 else ""} |
| architecture | `{metadata.architecture}` in `juncnet/network.py`{mean} |
| input | {", ".join(p.channels)}; {p.size}x{p.size}, sharpening {p.sharpening}, \
{p.angles} angles, filter {p.filter}, circle {p.circle}, standardisation {p.standardisation} |
| recipe | {metadata.recipe} |
| validation | {"; ".join(outcome.parts)} |
| checked | onnxruntime deviates from torch by {_deviation(outcome)} |

| pictures seen | loss | balanced accuracy on the validation part |
|---|---|---|
{rows}

Made by `{command}`. Judge it with `juncnet evaluate {order.out.name} DATA`.
"""
    order.out.with_suffix(".md").write_text(text, encoding="utf-8")
    data = {
        "command": command,
        "recipe": order.recipe.model_dump(mode="json"),
        "seed": order.seed,
        "pictures": outcome.pictures,
        "validation": outcome.parts,
        "curve": [asdict(point) for point in outcome.curve],
    }
    report = json.dumps(data, indent=1, allow_nan=False) + "\n"
    order.out.with_suffix(".json").write_text(report, encoding="utf-8")


def _deviation(outcome: Outcome) -> str:
    if outcome.exported is None:
        return "nothing: not exported"
    rounding = outcome.exported.rounding
    rounded = f"; rounding to int8 changed a probability by {rounding:.1e}" if rounding else ""
    return f"{outcome.exported.deviation:.1e}{rounded}"
