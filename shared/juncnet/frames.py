"""Pictures on one host: what a frame is, and how it gets from one process to others.

A `Frame` is a header and pixels that belong together. `FrameWriter` and `FrameReader` are the one
contract for their transport; `iceoryx2` carries them where it installs, Zenoh everywhere. Both
give the newest frame only, whole, with its own header.
"""

from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import cached_property
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from juncnet.messages import MessageError, PixelFormat, Stamp

BYTE = np.dtype(np.uint8)
"""Of nearly all arrays of bytes it is the very object, which spares comparing in every frame."""


@dataclass(frozen=True)
class FrameLayout:
    """How the bytes of a picture lie: pixel format, size, and bytes from row to row (`stride`).

    The planes of I420 follow one another without gaps: Y (H, stride), U and V (H/2, stride/2); of
    NV12: Y (H, stride), UV interleaved (H/2, stride). Width and height of both are even.
    """

    format: PixelFormat
    width: int
    height: int
    stride: int

    @classmethod
    def packed(cls, pixel_format: PixelFormat, width: int, height: int) -> "FrameLayout":
        """Return the layout without padding.

        Raises:
            MessageError: a size outside 2..16384, or an odd one where the format needs even ones.
        """
        stride = width * 3 if pixel_format is PixelFormat.BGR8 else width
        layout = cls(pixel_format, width, height, stride)
        layout.check()
        return layout

    def check(self) -> None:
        """Raise `MessageError` when no picture can lie like this."""
        if not (2 <= self.width <= 16384 and 2 <= self.height <= 16384):
            raise MessageError(f"Frame.width, height: {self.width}x{self.height} outside 2..16384")
        planar = self.format in (PixelFormat.I420, PixelFormat.NV12)
        if planar and (self.width % 2 or self.height % 2 or self.stride % 2):
            raise MessageError(f"Frame.width, height: {self.format} needs even sizes and stride")
        least = self.width * (3 if self.format is PixelFormat.BGR8 else 1)
        if not least <= self.stride <= 65536:
            raise MessageError(f"Frame.stride: {self.stride} outside {least}..65536")

    @cached_property
    def nbytes(self) -> int:
        """Number of bytes of the picture."""
        planar = self.format in (PixelFormat.I420, PixelFormat.NV12)
        return self.stride * self.height * 3 // 2 if planar else self.stride * self.height


@dataclass(slots=True)
class Frame:
    """A picture and the stamp of its capture.

    `pixels` is a flat uint8 array of `layout.nbytes`, perhaps in memory shared with others:
    read-only, and valid only until the `with` block that gave the frame ends.

    Raises:
        MessageError: `pixels` are not what `layout` needs.
    """

    header: Final[Stamp]
    layout: Final[FrameLayout]
    pixels: Final[NDArray[np.uint8]]

    def __post_init__(self) -> None:
        pixels, size = self.pixels, self.layout.nbytes
        if (pixels.dtype is not BYTE and pixels.dtype != BYTE) or pixels.shape != (size,):
            raise MessageError(
                f"Frame.pixels: {pixels.dtype} of {pixels.shape}, "
                f"{self.layout} needs uint8 of ({size},)"
            )

    @property
    def width(self) -> int:
        """Width in pixels."""
        return self.layout.width

    @property
    def height(self) -> int:
        """Height in pixels."""
        return self.layout.height

    def plane(self) -> NDArray[np.uint8]:
        """Return the first plane, uint8: (H, W) luminance, or (H, W, 3) for BGR8. A view."""
        layout = self.layout
        rows = self.pixels[: layout.stride * layout.height].reshape(layout.height, layout.stride)
        if layout.format is PixelFormat.BGR8:
            return rows[:, : layout.width * 3].reshape(layout.height, layout.width, 3)
        return rows[:, : layout.width]

    def chroma(self) -> list[NDArray[np.uint8]]:
        """Return the planes behind the luminance of a planar picture, uint8, as views.

        I420: U and V, (H/2, W/2) each; NV12: both in one, (H/2, W/2, 2); none of other formats.
        """
        layout = self.layout
        height, width, stride = layout.height // 2, layout.width // 2, layout.stride
        behind = self.pixels[layout.stride * layout.height :]
        if layout.format is PixelFormat.NV12:
            return [behind.reshape(height, stride // 2, 2)[:, :width]]
        if layout.format is PixelFormat.I420:
            return [plane[:, :width] for plane in behind.reshape(2, height, stride // 2)]
        return []

    def luminance(self) -> NDArray[np.uint8]:
        """Return the luminance, (H, W) uint8: a view without a copy unless the format is BGR8."""
        if self.layout.format is not PixelFormat.BGR8:
            return self.plane()
        import cv2

        return np.asarray(cv2.cvtColor(self.plane(), cv2.COLOR_BGR2GRAY), dtype=np.uint8)

    def bgr(self) -> NDArray[np.uint8]:
        """Return the colours, (H, W, 3) uint8, blue first; converted on demand."""
        import cv2

        layout = self.layout
        if layout.format is PixelFormat.BGR8:
            return self.plane()
        if layout.format is PixelFormat.GRAY8:
            return np.asarray(cv2.cvtColor(self.plane(), cv2.COLOR_GRAY2BGR), dtype=np.uint8)
        code = (
            cv2.COLOR_YUV2BGR_I420 if layout.format is PixelFormat.I420 else cv2.COLOR_YUV2BGR_NV12
        )
        if layout.stride != layout.width:
            raise MessageError("Frame.bgr: a padded planar picture must be packed first")
        whole = self.pixels.reshape(layout.height * 3 // 2, layout.width)
        return np.asarray(cv2.cvtColor(whole, code), dtype=np.uint8)


class FrameWriter(Protocol):
    """The sending end of a frame topic."""

    def loan(self, layout: FrameLayout) -> "FrameLoan":
        """Return memory for one frame; write its pixels there, then `send`."""
        ...

    def send(self, frame: Frame) -> None:
        """Send a frame: copies its pixels once."""
        ...


class FrameLoan(Protocol):
    """Memory of the transport, to decode or render straight into; dropped unless sent."""

    @property
    def pixels(self) -> NDArray[np.uint8]:
        """Flat uint8 array of `layout.nbytes`, writable until `send`."""
        ...

    def send(self, header: Stamp) -> None:
        """Send the pixels under this header. Waits for no reader."""
        ...


class FrameReader(Protocol):
    """The receiving end of a frame topic: the newest frame only."""

    def take(self, timeout_s: float) -> AbstractContextManager[Frame | None]:
        """Return a context that gives the newest frame not taken before, or None after `timeout_s`.

        Its pixels stay as they are until the context ends. Frames that were replaced before they
        were taken are counted as drops.
        """
        ...
