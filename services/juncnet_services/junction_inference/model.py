"""A model that answers: an ONNX file loaded, checked and run by onnxruntime. No bus, no clock."""

import hashlib
import threading
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from juncnet.features import Preprocessing
from juncnet.inference import Network
from juncnet.messages import ActiveModel, JunctionScore, ModelIdentity, Stamp
from juncnet.modelfile import INPUT, OUTPUT, ModelFileError, ModelMetadata

MAX_BATCH = 30
"""The paper's batch: more features than this are scored in several runs."""


class Model:
    """A loaded model. Safe to use from one thread at a time."""

    def __init__(self, path: Path, threads: int = 1):
        """Load the ONNX file at `path` and let it answer once.

        Raises:
            ModelFileError: the file is missing, is not ONNX, has no valid metadata or gives
                something other than a probability per class.
        """
        try:
            data = path.read_bytes()
        except OSError as error:
            raise ModelFileError(
                f"cannot read the model {path}: {error.strerror}; name an .onnx file"
            ) from error
        try:
            self._network = Network(data, threads)
        except ValueError as error:
            raise ModelFileError(f"{path} is {error}") from error
        self.metadata = ModelMetadata.from_properties(self._network.properties)
        self.identity = ModelIdentity(
            name=self.metadata.name, sha256=hashlib.sha256(data).hexdigest()
        )
        self.preprocessing: Preprocessing = self.metadata.preprocessing
        self._hash = self.preprocessing.hash
        self._check(path)

    def _check(self, path: Path) -> None:
        size = self.preprocessing.size
        probe = np.zeros((2, len(self.preprocessing.channels), size, size), np.float32)
        try:
            answer = self.probabilities(probe)
        except Exception as error:
            raise ModelFileError(f"{path} does not run on its own input: {error}") from error
        if answer.shape != (2, len(self.metadata.classes)) or not np.isfinite(answer).all():
            raise ModelFileError(f"{path} gives {answer.shape}, not a probability per class")
        if np.abs(answer.sum(axis=1) - 1).max() > 1e-3:
            raise ModelFileError(f"{path} gives values that do not sum to 1: export with softmax")

    @property
    def active(self) -> ActiveModel:
        """The announcement of this model."""
        return ActiveModel(
            model=self.identity,
            classes=self.metadata.classes,
            preprocessing=self.preprocessing.model_dump_json(),
            preprocessing_hash=self._hash,
        )

    def refusal(self, preprocessing_hash: str, shape: tuple[int, ...]) -> str | None:
        """Return why features of this hash and shape cannot be scored; None: they can."""
        if preprocessing_hash != self._hash:
            return (
                f"features made by preprocessing {preprocessing_hash[:8]}, "
                f"model {self.identity.name} needs {self._hash[:8]}"
            )
        size = self.preprocessing.size
        expected = (len(self.preprocessing.channels), size, size)
        return None if shape == expected else f"features are {shape}, the model takes {expected}"

    def probabilities(self, features: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return probabilities (N, classes) of features (N, C, H, W), float32."""
        return self._network.run(features, INPUT, OUTPUT)

    def score(self, features: list[NDArray[np.float32]]) -> list[dict[str, float]]:
        """Return a probability per class for each of the features (C, H, W), in batches."""
        rows: list[dict[str, float]] = []
        for first in range(0, len(features), MAX_BATCH):
            batch = self.probabilities(np.stack(features[first : first + MAX_BATCH]))
            clipped = np.clip(batch.astype(np.float64), 0, 1)
            rows += [dict(zip(self.metadata.classes, row.tolist(), strict=True)) for row in clipped]
        return rows

    def scores(
        self, headers: list[Stamp], features: list[NDArray[np.float32]]
    ) -> list[JunctionScore]:
        """Return the scores of features (C, H, W) under the headers of their frames."""
        return [
            JunctionScore(header=header, model=self.identity, probabilities=probabilities)
            for header, probabilities in zip(headers, self.score(features), strict=True)
        ]


class ModelSlot:
    """The model that is served now; a new one takes its place only once it has answered."""

    def __init__(self, model: Model):
        self._model = model
        self._lock = threading.Lock()

    @property
    def model(self) -> Model:
        """The model in service."""
        return self._model

    def load(self, path: Path) -> Model:
        """Put the file at `path` into service and return it; the old one answers until then.

        Raises:
            ModelFileError: it cannot be served; the old model stays.
        """
        with self._lock:
            model = Model(path)
            self._model = model
        return model
