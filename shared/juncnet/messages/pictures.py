"""Pictures as they travel beyond this host: JPEG and H.264."""

from enum import StrEnum
from typing import ClassVar

from pydantic import Field

from juncnet.messages.base import BulkMessage, Message, MessageError
from juncnet.messages.stamp import Stamp


class PixelFormat(StrEnum):
    """Layout of a picture's bytes. I420: Y plane, then U, then V at half resolution; NV12: U and V
    interleaved; BGR8: three bytes a pixel; GRAY8: one."""

    I420 = "I420"
    NV12 = "NV12"
    BGR8 = "BGR8"
    GRAY8 = "GRAY8"


class JpegImage(BulkMessage):
    """A camera picture as JPEG (payload), for viewers and for followers in any language."""

    media_type: ClassVar[str] = "image/jpeg"
    header: Stamp
    width: int = Field(ge=1, le=16384)
    height: int = Field(ge=1, le=16384)

    def check_payload(self) -> None:
        if bytes(self.payload[:2]) != b"\xff\xd8":
            raise MessageError("JpegImage.payload: not a JPEG (it must begin with FF D8)")


class KeyFrameRequest(Message):
    """Somebody cannot decode camera/video before the next key frame: it had better come soon."""

    at: Stamp


class VideoPacket(BulkMessage):
    """One H.264 access unit in Annex B form (payload), as the camera gave it."""

    media_type: ClassVar[str] = "video/h264"
    header: Stamp
    key_frame: bool
    """Whether decoding can start here; parameter sets are in the payload then."""
    lost_before: int = Field(default=0, ge=0)
    """Packets known to be lost since the access unit before this one."""
