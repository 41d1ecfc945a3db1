"""How pictures that are no roads are fed and varied, the rest being as in `juncnet train`.

Of colour pictures each of red, green and blue is sharpened, and the reconstruction is that of their
luminance: four channels. Where roads must stay where they are in the picture (a junction's place is
its label), digits and objects may be shifted, turned and scaled.
"""

# Torch leaves these of its own members without types.
# pyright: reportUnknownMemberType=false

from collections.abc import Sequence

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from juncnet.features import F32, Extractor, Luminance, Preprocessing, standardised
from juncnet.learning.fit import Trainer, cross_entropy, features
from juncnet.learning.pictures import Pictures
from juncnet.learning.recipes import Recipe

Bytes = NDArray[np.uint8]
LUMINANCE = np.array([0.299, 0.587, 0.114], np.float32)
"""ITU-R BT.601, as a camera's Y."""
SHIFT, TURN_DEG, SCALE = 0.24, 16.0, 0.16
"""Limits at an augmentation of 1: of the side, in degrees, of the size."""
CONTRAST, BRIGHTNESS = 0.4, 0.2
"""Limits at an augmentation of 1; brightness in full scales."""


class ColourExtractor(Extractor):
    """Turns uint8 pictures (N, S, S, 3), red first, into features (N, 4, S, S), float32."""

    def __init__(self, preprocessing: Preprocessing) -> None:
        super().__init__(preprocessing.model_copy(update={"standardisation": "none"}))
        self._standardise = preprocessing.standardisation == "per_image"

    def batch(self, luminances: Luminance | Sequence[Luminance]) -> F32:
        """Return the features of colour pictures: red, green, blue, reconstruction."""
        pictures = np.asarray(luminances)
        luminance = np.rint(pictures @ LUMINANCE).astype(np.uint8)
        planes = [self.gray(pictures[..., k]) for k in range(3)]
        stacked = np.stack([*planes, super().batch(luminance)[:, 1]], axis=1)
        return standardised(stacked) if self._standardise else stacked


class SmallPictureTrainer(Trainer):
    """The training of roads, with variations that keep the labels of digits and objects."""

    def __init__(
        self,
        network: nn.Module,
        data: Pictures,
        validation: Pictures,
        recipe: Recipe,
        seed: int,
        extractor: Extractor,
        mirror: bool,
    ) -> None:
        """Prepare; `mirror` says whether a mirrored picture keeps its class."""
        super().__init__(network, data, validation, recipe, seed, extractor)
        self._mirror = mirror

    def _identity(self) -> dict[str, str]:
        return super()._identity() | {"variation": limits_text(self.recipe.augmentation)}

    def _loss(self, chosen: NDArray[np.int64], rng: np.random.Generator) -> Tensor:
        pictures = self._data.gray[chosen]
        if self.recipe.augmentation:
            pictures = varied(pictures, rng, self.recipe.augmentation, self._mirror)
        self._network.train()
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=self.recipe.bfloat16):
            logits: Tensor = self._network(features(pictures, self._extractor))
        target = torch.from_numpy(self._data.target[chosen])
        return cross_entropy(logits.float(), target, self._weights)


def limits_text(strength: float) -> str:
    """Return how much an augmentation of this strength moves a picture, for tables."""
    return (
        f"shifted up to {100 * SHIFT * strength:g} % of the side, turned {TURN_DEG * strength:g} "
        f"degrees, scaled {100 * SCALE * strength:g} %"
    )


def varied(pictures: Bytes, rng: np.random.Generator, strength: float, mirror: bool) -> Bytes:
    """Return pictures (N, S, S[, 3]) shifted, turned, scaled and exposed differently.

    Args:
        pictures: as they are; beyond the border its pixels are repeated.
        rng: what is drawn from, uniformly.
        strength: of all limits; 1: the ones above.
        mirror: whether half of them are mirrored left to right.
    """
    n, side = len(pictures), pictures.shape[1]
    matrices = _turned(rng, n, strength, mirror)
    middle = np.full(2, (side - 1) / 2)
    moves = rng.uniform(-1, 1, (n, 2)) * SHIFT * strength * side + middle - matrices @ middle
    warps = np.concatenate([matrices, moves[:, :, None]], axis=2)
    result = np.empty_like(pictures)
    for target, picture, warp in zip(result, pictures, warps, strict=True):
        cv2.warpAffine(
            picture,
            warp,
            (side, side),
            target,
            flags=cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        )
    shape = (n, *[1] * (pictures.ndim - 1))
    gain = (1 + rng.uniform(-1, 1, shape) * CONTRAST * strength).astype(np.float32)
    bias = (rng.uniform(-1, 1, shape) * BRIGHTNESS * strength * 255).astype(np.float32)
    exposed = (result - np.float32(127.5)) * gain + (127.5 + bias)
    return np.rint(np.clip(exposed, 0, 255)).astype(np.uint8)


def _turned(rng: np.random.Generator, n: int, strength: float, mirror: bool) -> NDArray[np.float64]:
    """Return matrices (N, 2, 2) that turn, scale and perhaps mirror."""
    angle = np.radians(rng.uniform(-1, 1, n) * TURN_DEG * strength)
    factor = 1 + rng.uniform(-1, 1, (n, 1)) * SCALE * strength
    rows = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=1)
    matrices = (rows * factor).reshape(n, 2, 2)
    if mirror:
        matrices[:, :, 0] *= np.where(rng.random(n) < 0.5, -1.0, 1.0)[:, None]
    return matrices
