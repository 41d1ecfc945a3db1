"""What every message is made of: JSON or bulk data, decoded strictly; replies.

Conventions: SI units; x forward, y left, z up; yaw counter-clockwise positive (ROS REP 103).
Small messages are JSON. Messages with bulk data (`BulkMessage`) carry it as the raw payload with
their JSON beside it. `decode` raises `MessageError` that names the field for anything malformed:
wrong shape or dtype, NaN, out of range, unknown field.
"""

from typing import Annotated, Any, ClassVar, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, PrivateAttr, StringConstraints, ValidationError

NAME_PATTERN = r"^[A-Za-z0-9_.:+-]+$"
NAME_LENGTH = 128
Name = Annotated[str, StringConstraints(min_length=1, max_length=NAME_LENGTH, pattern=NAME_PATTERN)]
"""Lengths stand beside the pattern, not in it: it is checked often, and faster so."""
Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Metres = Annotated[float, Field(ge=-1e7, le=1e7)]
Sha256 = Annotated[str, StringConstraints(pattern=r"^[0-9a-f]{64}$")]


class MessageError(ValueError):
    """A payload is not the message it should be; the text names the message, the field and why."""


class Message(BaseModel):
    """A message that travels as JSON. Frozen; unknown fields and NaN are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    @classmethod
    def schema_name(cls) -> str:
        """Name of the schema as it stands in the Zenoh encoding."""
        return f"juncnet.{cls.__name__}.v1"

    @classmethod
    def encoding(cls) -> str:
        """Zenoh encoding of the payload."""
        return f"application/json;{cls.schema_name()}"

    def encode(self) -> tuple[bytes, bytes | None]:
        """Return (payload, attachment) as `decode` takes them."""
        return self.model_dump_json().encode(), None

    @classmethod
    def decode(cls, payload: bytes, attachment: bytes | None = None) -> Self:
        """Return the message in `payload`.

        Raises:
            MessageError: it is not this message; the text names the field.
        """
        del attachment
        return _validated(cls, payload)


M = TypeVar("M", bound=Message)


def _validated(cls: type[M], text: bytes) -> M:
    try:
        return cls.model_validate_json(text)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "payload"
        why = first.get("ctx", {}).get("error", first["msg"])  # without pydantic's "Value error, "
        raise MessageError(f"{cls.__name__}.{where}: {why}") from error


class BulkMessage(Message):
    """A message whose raw payload is bulk data and whose fields travel as JSON beside it."""

    media_type: ClassVar[str] = "application/octet-stream"
    _payload: bytes | memoryview = PrivateAttr(default=b"")

    @classmethod
    def encoding(cls) -> str:
        return f"{cls.media_type};{cls.schema_name()}"

    @property
    def payload(self) -> bytes | memoryview:
        """The bulk data, as it travels."""
        return self._payload

    @classmethod
    def of(cls, payload: bytes | memoryview, **fields: Any) -> Self:
        """Return the message with this bulk data and these fields, both checked."""
        message = cls(**fields)
        message._payload = payload
        message.check_payload()
        return message

    def check_payload(self) -> None:
        """Raise `MessageError` when the bulk data does not fit the fields."""
        if len(self._payload) == 0:
            raise MessageError(f"{type(self).__name__}.payload: empty")

    def encode(self) -> tuple[bytes, bytes | None]:
        return bytes(self._payload), self.model_dump_json().encode()

    @classmethod
    def decode(cls, payload: bytes, attachment: bytes | None = None) -> Self:
        if attachment is None:
            raise MessageError(f"{cls.__name__}.attachment: missing, the fields travel in it")
        message = _validated(cls, attachment)
        message._payload = payload
        message.check_payload()
        return message


class Reply(Message):
    """The answer to a request."""

    accepted: bool
    reason: str = Field(default="", max_length=4000)
    """Why not, and what to do about it."""
