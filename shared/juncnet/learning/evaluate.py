"""Asks a model file about the pictures of a dataset, and times it."""

import hashlib
import os
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from juncnet.features import Extractor
from juncnet.inference import Network
from juncnet.learning.datasets import Dataset, sites_of
from juncnet.learning.evaluation.answers import NONE, Answers
from juncnet.learning.evaluation.metrics import balanced_accuracy, confusion_matrix
from juncnet.learning.evaluation.scores import Latency
from juncnet.modelfile import INPUT, OUTPUT, ModelFileError, ModelMetadata

AT_ONCE = 128
TIMED = 200
"""Pictures that latency is measured on, after `WARM_UP` others."""
WARM_UP = 10
Grouping = Literal["clip", "site"]


@dataclass(frozen=True)
class LoadedModel:
    """A model file, ready to answer."""

    name: str
    sha256: str
    metadata: ModelMetadata
    network: Network
    extractor: Extractor

    def probabilities(self, pictures: list[NDArray[np.uint8]]) -> NDArray[np.float32]:
        """Return the probabilities (N, K) of luminance pictures of any sizes."""
        return self.network.run(self.extractor.batch(pictures), INPUT, OUTPUT)


def load_model(path: Path) -> LoadedModel:
    """Return the model in an ONNX file.

    Raises:
        ModelFileError: it is no JuncNet model; the text says why.
    """
    try:
        data = path.read_bytes()
        network = Network(data)
    except (OSError, ValueError) as error:
        raise ModelFileError(f"{path}: {error}") from error
    metadata = ModelMetadata.from_properties(network.properties)
    return LoadedModel(
        metadata.name,
        hashlib.sha256(data).hexdigest(),
        metadata,
        network,
        Extractor(metadata.preprocessing),
    )


def answers(model: LoadedModel, data: Dataset, grouping: Grouping = "clip") -> Answers:
    """Return what the model answers to every picture of a dataset.

    Where their classes differ and one of both only tells `none` from the rest, the other's classes
    are merged to the same.

    Raises:
        ValueError: the classes cannot be brought together.
        DatasetError: a picture cannot be read.
    """
    parts = [model.probabilities(data.luminances(chunk)) for chunk in _chunks(len(data))]
    classes, probability, label = _common_classes(
        model.metadata.classes, np.concatenate(parts), data.classes, data.label
    )
    site, _ = sites_of(data)
    group = site if grouping == "site" else data.clip
    return Answers(classes, probability, label, site, group)


def with_band(given: Answers, data: Dataset) -> float | None:
    """Return the balanced accuracy with the transition band judged by the middle of its ramp.

    Pictures of which nobody could say anything stay out. None for data without such a band, and
    for more than two classes.
    """
    band = (given.label < 0) & np.isfinite(data.target).all(axis=1)
    positive = given.positive
    if positive is None or NONE not in data.classes or not band.any():
        return None
    plain = data.target[:, data.classes.index(NONE)] >= 0.5
    label = np.where(band, np.where(plain, 1 - positive, positive), given.label)
    judged = label >= 0
    answer = given.probability.argmax(axis=1)
    return balanced_accuracy(confusion_matrix(label[judged], answer[judged], 2))


def latency(model: LoadedModel, data: Dataset) -> Latency:
    """Return how long the model takes for one picture of this dataset, pictures one by one."""
    count = min(len(data), TIMED)
    pictures = data.luminances(np.linspace(0, len(data) - 1, count).astype(int))
    for picture in pictures[:WARM_UP]:
        model.probabilities([picture])
    features_s, network_s = np.empty(count), np.empty(count)
    for i, picture in enumerate(pictures):
        start = time.perf_counter()
        features = model.extractor.batch([picture])
        between = time.perf_counter()
        model.network.run(features, INPUT, OUTPUT)
        features_s[i], network_s[i] = between - start, time.perf_counter() - between
    total = features_s + network_s
    return Latency(
        n=count,
        features_p50_ms=1e3 * float(np.median(features_s)),
        network_p50_ms=1e3 * float(np.median(network_s)),
        total_p50_ms=1e3 * float(np.median(total)),
        total_p99_ms=1e3 * float(np.percentile(total, 99)),
        load=os.getloadavg()[0],
    )


def _chunks(n: int) -> Iterator[range]:
    return (range(first, min(first + AT_ONCE, n)) for first in range(0, n, AT_ONCE))


def _common_classes(
    of_model: tuple[str, ...],
    probability: NDArray[np.float32],
    of_data: tuple[str, ...],
    label: NDArray[np.int64],
) -> tuple[tuple[str, ...], NDArray[np.float32], NDArray[np.int64]]:
    """Return classes, probabilities (N, K) and labels (N,) that mean the same."""
    if set(of_model) == set(of_data):
        places = np.array([*(of_model.index(name) for name in of_data), -1])
        return of_model, probability, places[label]
    two = next((c for c in (of_model, of_data) if len(c) == 2 and NONE in c), None)
    if two is None or NONE not in of_model or NONE not in of_data:
        raise ValueError(
            f"the model tells {', '.join(of_model)}; the data have {', '.join(of_data)}: these "
            f"cannot be compared, unless both have {NONE!r} and one of them only one other class"
        )
    other = next(name for name in two if name != NONE)
    plain = probability[:, of_model.index(NONE)]
    merged = np.where(label < 0, -1, (label != of_data.index(NONE)).astype(np.int64))
    return (NONE, other), np.stack([plain, 1 - plain], axis=1), merged
