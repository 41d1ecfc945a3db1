"""What the network takes and gives, and which network it is."""

from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from juncnet.messages.base import (
    BulkMessage,
    Message,
    MessageError,
    Name,
    Probability,
    Sha256,
)
from juncnet.messages.stamp import Stamp


class Features(BulkMessage):
    """Network input: payload is a little-endian float32 array of `shape` (C, H, W), all finite."""

    header: Stamp
    preprocessing: Sha256
    """Hash of the preprocessing that made them (`juncnet.features.Preprocessing.hash`)."""
    shape: tuple[int, int, int]
    dtype: Literal["<f4"] = "<f4"

    @classmethod
    def from_array(cls, array: NDArray[np.float32], header: Stamp, preprocessing: str) -> Self:
        """Return the message of a float32 (C, H, W) array."""
        if array.dtype != np.float32 or array.ndim != 3:
            raise MessageError(
                f"Features.array: needs float32 (C, H, W), got {array.dtype} {array.shape}"
            )
        data = np.ascontiguousarray(array, dtype="<f4")
        return cls.of(
            data.view(np.uint8).reshape(-1).data,
            header=header,
            preprocessing=preprocessing,
            shape=tuple(array.shape),
        )

    @property
    def array(self) -> NDArray[np.float32]:
        """The features, float32 (C, H, W); a view of the payload."""
        return np.frombuffer(self.payload, dtype="<f4").reshape(self.shape)

    def check_payload(self) -> None:
        if any(not 1 <= n <= 4096 for n in self.shape):
            raise MessageError(f"Features.shape: {self.shape} has an axis outside 1..4096")
        expected = 4 * int(np.prod(self.shape, dtype=np.int64))
        if len(self.payload) != expected:
            raise MessageError(
                f"Features.payload: {len(self.payload)} bytes, {self.shape} needs {expected}"
            )
        if not np.isfinite(self.array).all():
            raise MessageError("Features.payload: contains NaN or infinity")


class ModelIdentity(Message):
    """Which model answered."""

    name: Name
    sha256: Sha256
    """Of the ONNX file."""


class JunctionScore(Message):
    """A probability per class for the frame of `header`."""

    header: Stamp
    model: ModelIdentity
    probabilities: dict[Name, Probability] = Field(min_length=2, max_length=1000)
    """By class; they sum to 1 within 1e-3. The class `none` is plain road."""

    @field_validator("probabilities")
    @classmethod
    def _sums_to_one(cls, value: dict[str, float]) -> dict[str, float]:
        if abs(sum(value.values()) - 1.0) > 1e-3:
            raise ValueError(f"probabilities sum to {sum(value.values()):.4f}, not 1")
        if "none" not in value:
            raise ValueError("there is no class 'none'")
        return value

    @property
    def junction(self) -> float:
        """Probability that the frame is a junction, of whichever class."""
        return 1.0 - self.probabilities["none"]

    @property
    def label(self) -> str:
        """The likeliest class other than `none`."""
        return max((p, c) for c, p in self.probabilities.items() if c != "none")[1]


class ActiveModel(Message):
    """What is served now: its identity, its classes and the preprocessing that it asks for."""

    model: ModelIdentity
    classes: tuple[Name, ...] = Field(min_length=2)
    preprocessing: str
    """The preprocessing as JSON (`juncnet.features.Preprocessing`)."""
    preprocessing_hash: Sha256


class LoadModel(Message):
    """Asks the inference to swap its model for the ONNX file at `path` on its host."""

    path: str = Field(min_length=1, max_length=4096)
