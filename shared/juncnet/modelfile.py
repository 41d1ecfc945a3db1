"""What stands in a JuncNet ONNX file beside the network: all that is needed to run it.

The metadata travel in the file itself, as JSON in one property, so that a model cannot be separated
from the preprocessing that it was trained with.
"""

from collections.abc import Mapping
from typing import Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from juncnet.features import Preprocessing
from juncnet.messages import Name

INPUT = "features"
OUTPUT = "probabilities"
PROPERTY = "juncnet"


class ModelFileError(ValueError):
    """A file is not a model that can be served; the text says why and what to do."""


class ModelMetadata(BaseModel):
    """The metadata of a JuncNet ONNX file."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: Name
    architecture: str
    classes: tuple[Name, ...] = Field(min_length=2)
    """In the order of the network's outputs; `none` is one of them."""
    preprocessing: Preprocessing
    near_row: float
    """`juncnet.camera.NEAR_ROW` that the labels were made with."""
    far_heights: float
    """`juncnet.camera.FAR_HEIGHTS` that the labels were made with."""
    recipe: str = ""
    """How it was trained, one line."""
    mirror_mean: bool | None = None
    """Whether it answers the mean over picture and mirror image; None: a file from before this was
    told, when all of the architecture `robust` did."""

    @property
    def is_mirror_mean(self) -> bool:
        """Whether it answers the mean over picture and mirror image."""
        return self.architecture == "robust" if self.mirror_mean is None else self.mirror_mean

    def to_properties(self) -> dict[str, str]:
        """Return the metadata as ONNX properties."""
        return {PROPERTY: self.model_dump_json()}

    @classmethod
    def from_properties(cls, properties: Mapping[str, str]) -> Self:
        """Return the metadata of ONNX properties.

        Raises:
            ModelFileError: there are none, or they are not valid; the text names the field.
        """
        if PROPERTY not in properties:
            raise ModelFileError("the file has no JuncNet metadata: export it with `juncnet train`")
        try:
            return cls.model_validate_json(properties[PROPERTY])
        except ValidationError as error:
            problems = "; ".join(
                f"{'.'.join(str(part) for part in problem['loc'])}: {problem['msg']}"
                for problem in error.errors(include_url=False)
            )
            raise ModelFileError(f"metadata: {problems}") from error
