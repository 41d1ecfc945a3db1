"""Notices a frozen camera: one that repeats its picture exactly, which sensor noise never does."""

import zlib

from juncnet.frames import Frame
from juncnet.messages import PixelFormat

REPORTED_REPEATS = 3
"""From this many exact repeats on, a live camera is called frozen."""
SAMPLE_STEP_PX = 8


def fingerprint(frame: Frame) -> int:
    """Return a hash of every 8th pixel of every 8th row of the luminance (green for BGR8)."""
    plane = frame.plane()[::SAMPLE_STEP_PX, ::SAMPLE_STEP_PX]
    sample = plane[..., 1] if frame.layout.format is PixelFormat.BGR8 else plane
    return zlib.crc32(sample.tobytes())


class FrozenGate:
    """Withholds pictures after `limit` exact repeats, until one differs; 0 never withholds."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._newest: int | None = None
        self._repeats = 0

    @property
    def frozen(self) -> bool:
        """Whether the newest picture is at least the third exact repeat in a row."""
        return self._repeats >= REPORTED_REPEATS

    @property
    def just_frozen(self) -> bool:
        """Whether the newest picture is the one by which the camera came to be called frozen."""
        return self._repeats == REPORTED_REPEATS

    def accept(self, picture: int) -> bool:
        """Return whether the picture with this fingerprint may be published."""
        self._repeats = self._repeats + 1 if picture == self._newest else 0
        self._newest = picture
        return self._limit == 0 or self._repeats <= self._limit
