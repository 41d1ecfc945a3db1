"""How a network is trained: everything but the data, and the presets of `juncnet train`."""

from typing import Literal, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from juncnet.features import Preprocessing
from juncnet.network import Architecture

Preset = Literal["paper", "tuned", "robust"]


class Recipe(BaseModel):
    """How a network is trained. The defaults are those of the preset `robust`."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    architecture: Architecture = "robust"
    preprocessing: Preprocessing = Preprocessing(standardisation="per_image")
    epochs: float = Field(default=8.0, gt=0)
    batch: int = Field(default=128, ge=2)
    optimiser: Literal["adam", "adamw"] = "adamw"
    rate: float = Field(default=3e-3, gt=0)
    """Learning rate; with `one_cycle` its highest."""
    weight_decay: float = Field(default=1e-2, ge=0)
    schedule: Literal["constant", "one_cycle"] = "one_cycle"
    """`one_cycle`: a tenth of the steps up to `rate`, then a cosine to zero."""
    dropout: float = Field(default=0.2, ge=0, lt=1)
    mirror_mean: bool = False
    """Whether `robust` answers the mean over picture and mirror image, in twice the time."""
    augmentation: float = Field(default=1.0, ge=0, le=2)
    """0: pictures as they are; 1: see `juncnet.learning.augment`."""
    balanced: bool = True
    """Whether the classes weigh the same in the loss, however many pictures each has."""
    average: float = Field(default=0.998, ge=0, lt=1)
    """Decay of the running average of the weights, which is what is exported; 0: none."""
    keep_best: bool = False
    """Whether the weights that did best on the validation part are exported, those at the start
    included, instead of the last ones. For fine-tuning: few pictures are soon learnt by heart."""
    repeat_wrong: int = Field(default=1, ge=1, le=20)
    """How often an epoch sees the pictures that the network at its start is wrong or unsure about:
    gives their class less than `juncnet.learning.pictures.UNSURE`."""
    mask_weight: float = Field(default=0.5, ge=0)
    """Of the second output, where road and junction lie, on pictures that come with masks."""
    bfloat16: bool = True
    """Whether convolutions multiply in bfloat16: nearly twice as fast on processors that can."""

    @model_validator(mode="after")
    def _has_what_it_asks_for(self) -> Self:
        if self.mirror_mean and self.architecture != "robust":
            raise ValueError("mirror_mean: only the architecture robust answers such a mean")
        return self

    def describe(self) -> str:
        """Return the recipe as one line for the model card."""
        extras = [
            f"dropout {self.dropout:g}" if self.dropout else "no dropout",
            "answers the mean over the mirror image" if self.mirror_mean else "",
            f"weights averaged with {self.average}" if self.average else "",
            "classes balanced" if self.balanced else "",
            f"augmentation {self.augmentation:g}" if self.augmentation else "no augmentation",
            "the best on the validation part kept" if self.keep_best else "",
            f"what the start got wrong {self.repeat_wrong} times" if self.repeat_wrong > 1 else "",
            f"mask loss {self.mask_weight:g}" if self.mask_weight else "",
            "bfloat16" if self.bfloat16 else "",
        ]
        name = {"adam": "Adam", "adamw": "AdamW"}[self.optimiser]
        first = f"{name}, {self.rate:g}, {self.schedule.replace('_', '-')}, batches of {self.batch}"
        return ", ".join([first, f"{self.epochs:g} epochs", *(e for e in extras if e)])


PAPER = Recipe(
    architecture="paper",
    preprocessing=Preprocessing(),
    epochs=200,
    batch=30,
    optimiser="adam",
    rate=1e-5,
    weight_decay=0,
    schedule="constant",
    dropout=0.5,
    augmentation=0,
    balanced=False,
    average=0,
    mask_weight=0,
    bfloat16=False,
)
"""As the paper states it: Adam, 1e-5, categorical cross-entropy, 200 epochs, batches of 30."""

TUNED = Recipe(
    architecture="paper",
    epochs=20,
    rate=1e-3,
    dropout=0.5,
    augmentation=0.5,
    mask_weight=0,
)
"""The paper's architecture with pictures standardised, one cycle and mild augmentation: with the
strong one it no longer learns (it has no batch normalisation)."""

PRESETS: dict[Preset, Recipe] = {"paper": PAPER, "tuned": TUNED, "robust": Recipe()}

FINE_TUNING_RATE = 0.2
"""Of the preset's rate, when training starts from a trained model."""
