"""Nearest neighbours and a support vector machine, with what they are good at chosen for them.

Each is tried on two descriptions of the picture (the network's input at half its size; histograms
of oriented gradients) and with several settings; the best balanced accuracy on the validation sites
is taken. Scikit-learn has no types: it is spoken to here only.
"""

# Scikit-learn leaves nearly everything without types.
# pyright: reportUnknownMemberType=false, reportUnknownVariableType=false
# pyright: reportMissingTypeStubs=false, reportUnknownArgumentType=false

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from juncnet.extras import install_command
from juncnet.features import F32, Extractor, Preprocessing
from juncnet.learning.evaluation.metrics import balanced_accuracy, confusion_matrix

Bytes = NDArray[np.uint8]
Describe = Callable[[Bytes], F32]
COMPONENTS = 128
"""Principal components that are kept of a description."""
CELL, DIRECTIONS, CLIP = 8, 9, 0.2
"""Of gradient histograms: side in pixels, number, limit of a share."""
NEIGHBOURS = (1, 5, 15, 31)
PENALTIES = (1.0, 10.0)


class MissingLibraryError(RuntimeError):
    """Scikit-learn is not installed; the text says what to do."""


class Classical:
    """A trained classifier of pictures (N, 64, 64), uint8."""

    def __init__(self, describe: Describe, pipeline: Any, calibration: Any, how: str) -> None:
        self._describe, self._pipeline, self._calibration = describe, pipeline, calibration
        self.how = how
        """What was chosen on the validation sites."""

    def __call__(self, gray: Bytes) -> NDArray[np.float32]:
        """Return the probabilities (N, K)."""
        described = self._describe(gray)
        if self._calibration is None:
            return np.asarray(self._pipeline.predict_proba(described), np.float32)
        decision = _columns(self._pipeline.decision_function(described))
        return np.asarray(self._calibration.predict_proba(decision), np.float32)


def train_neighbours(
    gray: Bytes, label: NDArray[np.int64], judged: Bytes, judged_label: NDArray[np.int64]
) -> Classical:
    """Return the best k-nearest-neighbour classifier; the last two arguments are for choosing."""
    neighbors = _library("sklearn.neighbors")
    settings = {f"k={k}": neighbors.KNeighborsClassifier(k, weights="distance") for k in NEIGHBOURS}
    return _best(settings, gray, label, judged, judged_label, calibrate=False)


def train_support_vectors(
    gray: Bytes, label: NDArray[np.int64], judged: Bytes, judged_label: NDArray[np.int64]
) -> Classical:
    """Return the best support vector machine (radial kernel), probabilities by Platt's method."""
    svm = _library("sklearn.svm")
    settings = {f"C={c:g}": svm.SVC(C=c, class_weight="balanced") for c in PENALTIES}
    return _best(settings, gray, label, judged, judged_label, calibrate=True)


def _best(
    settings: dict[str, Any],
    gray: Bytes,
    label: NDArray[np.int64],
    judged: Bytes,
    judged_label: NDArray[np.int64],
    calibrate: bool,
) -> Classical:
    make_pipeline = _library("sklearn.pipeline").make_pipeline
    decomposition, base = _library("sklearn.decomposition"), _library("sklearn.base")
    extractor = Extractor(Preprocessing(standardisation="per_image"))
    descriptions: dict[str, Describe] = {
        "gradient histograms": gradients,
        "gray and reconstruction at 32x32": lambda pictures: half_size(pictures, extractor),
    }
    classes, best = int(label.max()) + 1, (-1.0, "", gradients, None)
    for text, describe in descriptions.items():
        reduce = decomposition.PCA(min(COMPONENTS, len(gray) - 1), random_state=0)
        reduced = reduce.fit_transform(describe(gray))
        judged_reduced = reduce.transform(describe(judged))
        for name, setting in settings.items():
            classifier = base.clone(setting).fit(reduced, label)
            answer = np.asarray(classifier.predict(judged_reduced), np.int64)
            found = balanced_accuracy(confusion_matrix(judged_label, answer, classes))
            if found > best[0]:
                how = f"{name}, {reduce.n_components_} components of {text}"
                best = (found, how, describe, make_pipeline(reduce, classifier))
    _, how, describe, pipeline = best
    if pipeline is None:
        raise ValueError("no setting could be judged: the validation part is empty")
    if not calibrate:
        return Classical(describe, pipeline, None, how)
    decision = _columns(pipeline.decision_function(describe(judged)))
    logistic = _library("sklearn.linear_model").LogisticRegression()
    return Classical(describe, pipeline, logistic.fit(decision, judged_label), how)


def gradients(gray: Bytes) -> F32:
    """Return histograms of oriented gradients (N, 1764) of pictures (N, 64, 64).

    Cells of 8x8, 9 directions without sign, blocks of 2x2 cells each brought to length 1, clipped
    at 0.2 and brought to length 1 again. Source: Dalal and Triggs, 2005.
    """
    return np.concatenate(
        [_histograms(gray[i : i + 256].astype(np.float32)) for i in range(0, len(gray), 256)]
    )


def _histograms(pictures: F32) -> F32:
    n, side = len(pictures), pictures.shape[1] // CELL
    down, right = np.gradient(pictures, axis=(1, 2))
    place = np.arctan2(down, right) % np.pi * (DIRECTIONS / np.pi)
    low, length = np.floor(place), np.hypot(down, right)
    cells = np.zeros((n, side, side, DIRECTIONS), np.float32)
    for direction, share in ((low, 1 - (place - low)), (low + 1, place - low)):
        for k in range(DIRECTIONS):
            votes = length * share * (direction.astype(np.int64) % DIRECTIONS == k)
            cells[..., k] += votes.reshape(n, side, CELL, side, CELL).sum(axis=(2, 4))
    blocks = np.concatenate(
        [cells[:, i : side - 1 + i, j : side - 1 + j] for i in (0, 1) for j in (0, 1)], axis=-1
    )
    clipped = np.minimum(_unit(blocks), CLIP)
    return _unit(clipped).reshape(n, -1).astype(np.float32)


def _unit(blocks: F32) -> F32:
    return blocks / np.sqrt((blocks * blocks).sum(axis=-1, keepdims=True) + 1e-6)


def half_size(gray: Bytes, extractor: Extractor) -> F32:
    """Return standardised grayscale and reconstruction at 32x32 as rows (N, 2048)."""
    parts: list[F32] = []
    for first in range(0, len(gray), 256):
        full = extractor.batch(gray[first : first + 256])
        n, channels, size, _ = full.shape
        quarters = full.reshape(n, channels, size // 2, 2, size // 2, 2)
        parts.append(quarters.mean(axis=(3, 5)).reshape(n, -1))
    return np.concatenate(parts)


def _columns(decision: Any) -> NDArray[np.float64]:
    values = np.asarray(decision, np.float64)
    return values[:, None] if values.ndim == 1 else values


def _library(name: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise MissingLibraryError(
            f"kNN and SVM need scikit-learn: {install_command('train')}"
        ) from error
