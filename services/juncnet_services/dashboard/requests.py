"""What a page may ask for: the bodies of its POST requests, checked strictly."""

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from juncnet.messages import Mission, Name


class Asked(BaseModel):
    """A request for one robot."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    robot: Name


class OrderAsked(Asked):
    """Hold, land or resume. Cutting the motors is no button."""

    do: Literal["hold", "land", "resume"]


class MissionAsked(Asked):
    """A new mission; the count starts at 0."""

    do: Literal["mission"]
    mission: Mission


class ModelAsked(Asked):
    """Another junction model: a shipped one's name, or a path on the robot's host."""

    do: Literal["model"]
    model: str = Field(min_length=1, max_length=4096)


class FollowerAsked(Asked):
    """Another road follower, `package.module:Class`."""

    do: Literal["follower"]
    follower: str = Field(min_length=1, max_length=256)
    options: dict[str, Any] = Field(default_factory=dict)


AnyAsked = Annotated[
    OrderAsked | MissionAsked | ModelAsked | FollowerAsked, Field(discriminator="do")
]
_ADAPTER: TypeAdapter[AnyAsked] = TypeAdapter(AnyAsked)


def asked(body: bytes) -> AnyAsked:
    """Return the request in `body` (JSON).

    Raises:
        ValueError: it is none; the text names the field.
    """
    try:
        return _ADAPTER.validate_json(body)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "body"
        raise ValueError(f"{where}: {first['msg']}") from error
