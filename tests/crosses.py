"""Pictures of noise, in those of junctions a bright cross, and trainings on them."""

# Torch leaves these of its own members without types.
# pyright: reportUnknownMemberType=false

from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from juncnet.features import Extractor, Preprocessing
from juncnet.learning.datasets import DatasetInfo, Row, write_dataset
from juncnet.learning.fit import Trainer
from juncnet.learning.pictures import Pictures
from juncnet.learning.recipes import Recipe
from juncnet.network import build

GRAY = Preprocessing(channels=("gray",), standardisation="per_image")
QUICK = Recipe(preprocessing=GRAY, epochs=7, batch=32, rate=4e-3, average=0.9, bfloat16=False)


def cross(n: int, seed: int) -> tuple[NDArray[np.uint8], NDArray[np.int64]]:
    """Return pictures of noise and labels; in those of junctions there is a bright cross."""
    rng = np.random.default_rng(seed)
    gray = rng.integers(60, 120, (n, 64, 64), dtype=np.uint8)
    label = np.arange(n) % 2
    gray[label == 1, 28:36, :] = 220
    gray[label == 1, :, 28:36] = 220
    return gray, label


def pictures(n: int, seed: int, masked: bool = True) -> Pictures:
    gray, label = cross(n, seed)
    mask = np.zeros((n, 32, 32), np.uint8)
    mask[label == 1, 14:18] = 2
    target = np.eye(2, dtype=np.float32)[label]
    return Pictures(gray, target, label, mask, np.full(n, masked))


def trainer(
    recipe: Recipe = QUICK,
    seed: int = 3,
    n: int = 96,
    seen: tuple[int, int] = (0, 1),
    start: int | None = None,
) -> Trainer:
    """Return a training; `seen` are the seeds of its two parts, `start` that of its weights."""
    torch.manual_seed(seed if start is None else start)
    network = build(recipe.architecture, len(recipe.preprocessing.channels))
    extractor = Extractor(recipe.preprocessing)
    own, judged = pictures(n, seen[0]), pictures(32, seen[1])
    return Trainer(network, own, judged, recipe, seed, extractor)


def write(
    folder: Path, n: int = 48, sites: int = 6, classes: tuple[str, str] | None = None
) -> Path:
    """Write a dataset of pictures larger than the network's."""
    names = classes or ("none", "junction")
    gray, label = cross(n, 5)
    folder.mkdir(parents=True)
    rows: list[Row] = []
    for i in range(n):
        picture = np.asarray(gray[i], np.uint8)
        cv2.imwrite(str(folder / f"{i}.png"), cv2.resize(picture, (160, 90)))
        site = f"site{(i // 2) % sites}"
        rows.append(Row(f"{i}.png", names[int(label[i])], f"{site}-a", site))
    write_dataset(folder, DatasetInfo(classes=names), rows)
    return folder
