"""From a camera's luminance to the network's input: the one function that flight and training call.

`Preprocessing` writes down every step, `Extractor` does them. The order is: crop, resize to the
network's size by area, scale to [0, 1], sharpen, stack the channels, standardise.
"""

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from juncnet.radon import FilterName, evenly_spaced_angles, radon
from juncnet.radon_cache import load_reconstruction
from juncnet.radon_geometry import MAX_SIZE, Geometry
from juncnet.shrink import shrink

F32 = NDArray[np.float32]
Luminance = NDArray[np.uint8]
Fraction = Annotated[float, Field(ge=0.0, lt=1.0)]
Degrees = Annotated[float, Field(ge=-360.0, le=360.0)]


class Crop(BaseModel):
    """What is cut off the picture, as fractions of its height (top, bottom) and width."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    top: Fraction = 0.0
    bottom: Fraction = 0.0
    left: Fraction = 0.0
    right: Fraction = 0.0

    @model_validator(mode="after")
    def _leaves_something(self) -> Self:
        if self.top + self.bottom > 0.95 or self.left + self.right > 0.95:
            raise ValueError("crop: less than a twentieth of the picture would be left")
        return self


class Preprocessing(BaseModel):
    """Every step from luminance to network input, in the order of its fields.

    A model file carries it as JSON, features carry its `hash`. The defaults are the paper's:
    a sharpened grayscale picture together with its Radon reconstruction, 64x64.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    source: Literal["luminance"] = "luminance"
    """The camera's Y as it comes, uint8 in 0..255."""
    crop: Crop = Crop()
    size: int = Field(default=64, ge=8, le=MAX_SIZE)
    """Side of the network's input in pixels; resized by area average, then divided by 255."""
    sharpening: float = Field(default=1.0, ge=0.0, le=10.0)
    """Amount of the Laplacian added, then clipped to [0, 1]; 0: none; 1: the usual 3x3 kernel with
    5 in its middle. At the network's size: area averaging would undo it at the camera's."""
    channels: tuple[Literal["gray", "radon"], ...] = Field(default=("gray", "radon"), min_length=1)
    """In this order: the sharpened picture; its filtered back-projection."""
    angles: int | tuple[Degrees, ...] = 180
    """A number of angles that divide the half turn evenly, or the angles in degrees."""
    filter: FilterName | None = "ramp"
    """The window on the ramp of the filtered back-projection; null: no filter at all."""
    circle: bool = False
    """Whether the reconstruction is black outside the inscribed circle."""
    standardisation: Literal["none", "per_image"] = "none"
    """`per_image`: each channel shifted and scaled to mean 0 and deviation 1 (flat ones to 0)."""

    @model_validator(mode="after")
    def _has_angles(self) -> Self:
        count = self.angles if isinstance(self.angles, int) else len(self.angles)
        if not 1 <= count <= 720:
            raise ValueError(f"angles: {count} of them, outside 1..720")
        if len(set(self.channels)) != len(self.channels):
            raise ValueError("channels: one is named twice")
        return self

    @property
    def angles_deg(self) -> tuple[float, ...]:
        """The angles of the projections in degrees."""
        return evenly_spaced_angles(self.angles) if isinstance(self.angles, int) else self.angles

    @property
    def hash(self) -> str:
        """SHA-256 of the canonical JSON, as hexadecimal."""
        fields = self.model_dump(mode="json")
        text = json.dumps(fields, sort_keys=True, separators=(",", ":"), allow_nan=False)
        return hashlib.sha256(text.encode()).hexdigest()


class Extractor:
    """Turns pictures into network input as `preprocessing` says; any sizes, call after call.

    Args:
        preprocessing: what to do.
        cache: directory of built reconstruction maps; None: the user's cache directory.
    """

    def __init__(self, preprocessing: Preprocessing, cache: Path | None = None) -> None:
        self.preprocessing = preprocessing
        geometry = Geometry(
            preprocessing.size,
            preprocessing.angles_deg,
            preprocessing.filter,
            preprocessing.circle,
        )
        wanted = "radon" in preprocessing.channels
        self._reconstruct = load_reconstruction(geometry, cache) if wanted else None

    def __call__(self, luminance: Luminance) -> F32:
        """Return the features (C, S, S), float32, of a picture (H, W), uint8 of at least 2x2.

        Raises:
            ValueError: not such a picture.
        """
        return self.batch([luminance])[0]

    def batch(self, luminances: Luminance | Sequence[Luminance]) -> F32:
        """Return the features (N, C, S, S), float32, of (N, H, W), or of a list of any sizes.

        Raises:
            ValueError: one of them is not a uint8 picture (H, W) of at least 2x2.
        """
        gray = self.gray(luminances)
        planes = {"gray": gray}
        if self._reconstruct is not None:
            planes["radon"] = self._reconstruct(gray)
        features = np.stack([planes[name] for name in self.preprocessing.channels], axis=1)
        if self.preprocessing.standardisation == "per_image":
            return standardised(features)
        return features

    def gray(self, luminances: Luminance | Sequence[Luminance]) -> F32:
        """Return the cropped, resized and sharpened pictures (N, S, S), float32 in [0, 1]."""
        size, crop = self.preprocessing.size, self.preprocessing.crop
        gray = np.empty((len(luminances), size, size), np.float32)
        for target, luminance in zip(gray, luminances, strict=True):
            target[:] = shrink(cropped(luminance, crop), size)
        gray *= np.float32(1.0 / 255.0)
        return sharpened(gray, self.preprocessing.sharpening)

    def sinogram(self, luminance: Luminance) -> F32:
        """Return the sinogram (R, A), float32, of the sharpened picture; see `juncnet.radon`."""
        gray = self.gray([luminance])[0]
        return radon(gray, self.preprocessing.angles_deg, self.preprocessing.circle)


def cropped(luminance: Luminance, crop: Crop) -> Luminance:
    """Return the part of a picture (H, W) that `crop` leaves: a view.

    Edges are rounded to whole pixels.

    Raises:
        ValueError: not a uint8 picture of at least 2x2.
    """
    if luminance.ndim != 2 or luminance.dtype != np.uint8 or min(luminance.shape) < 2:
        raise ValueError(
            f"needs a uint8 picture (H, W) of at least 2x2, got {luminance.dtype} {luminance.shape}"
        )
    rows = _span(luminance.shape[0], crop.top, crop.bottom)
    columns = _span(luminance.shape[1], crop.left, crop.right)
    return luminance[rows, columns]


def _span(length: int, before: float, after: float) -> slice:
    start, stop = round(length * before), length - round(length * after)
    return slice(start, stop) if stop > start else slice(0, length)


def sharpened(pictures: F32, amount: float) -> F32:
    """Return pictures (N, S, S) plus `amount` times their negative Laplacian, clipped to [0, 1].

    The Laplacian is the four-neighbour one; beyond the border the border's pixels are repeated.
    """
    if amount == 0.0:
        return pictures
    padded = np.pad(pictures, ((0, 0), (1, 1), (1, 1)), mode="edge")
    neighbours = padded[:, :-2, 1:-1] + padded[:, 2:, 1:-1]
    neighbours += padded[:, 1:-1, :-2]
    neighbours += padded[:, 1:-1, 2:]
    result: F32 = pictures * np.float32(1.0 + 4.0 * amount)
    result -= neighbours * np.float32(amount)
    result.clip(0.0, 1.0, out=result)
    return result


def standardised(features: F32) -> F32:
    """Return features (N, C, S, S), each channel with mean 0 and deviation 1; a flat one is 0."""
    centred = features - features.mean(axis=(2, 3), keepdims=True)
    deviation = np.maximum(centred.std(axis=(2, 3), keepdims=True), 1e-3)
    return (centred / deviation).astype(np.float32)
