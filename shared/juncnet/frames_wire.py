"""How a frame lies in memory and on the wire: a fixed prefix, then the pixels, in ONE sample.

Header and pixels travel together, so that no header can meet another picture's pixels. The prefix
alone is what wakes readers and tells observers that there is a new picture.
"""

import struct
import zlib
from functools import lru_cache
from typing import Any, NamedTuple

from juncnet.frames import FrameLayout
from juncnet.messages import MessageError, PixelFormat, Stamp

MAGIC = b"JNCFRAME"
VERSION = 1
PREFIX_BYTES = 256
"""A multiple of 64: the pixels after it begin on a cache line."""
ENCODING = "application/octet-stream;juncnet.Frame.v1"
PIXELS_KEY = "@pixels"
"""Chunk below a frame topic's key for whole frames; `*` and `**` never match a chunk with `@`, so
nobody asks for raw pixels by watching everything."""

_FIELDS = struct.Struct("<8sHBBIIIQQQQQQQB128s43xI")
"""The last one is the CRC-32 of the bytes before it."""
_CHECK = struct.Struct("<I")
_BODY_BYTES = PREFIX_BYTES - _CHECK.size
_FORMATS: tuple[PixelFormat, ...] = (
    PixelFormat.I420,
    PixelFormat.NV12,
    PixelFormat.BGR8,
    PixelFormat.GRAY8,
)


class FramePrefix(NamedTuple):
    """What stands before the pixels. `writer` and `serial` number the samples of one writer."""

    header: Stamp
    layout: FrameLayout
    writer: int
    serial: int

    def pack(self) -> bytes:
        """Return the prefix as `PREFIX_BYTES` bytes."""
        data = bytearray(PREFIX_BYTES)
        self.pack_into(memoryview(data))
        return bytes(data)

    def pack_into(self, data: memoryview) -> None:
        """Write the prefix into `PREFIX_BYTES` bytes, little-endian, its CRC-32 at the end."""
        clock = self.header.clock.encode()
        layout = self.layout
        _FIELDS.pack_into(
            data,
            0,
            MAGIC,
            VERSION,
            _FORMATS.index(layout.format),
            0,
            layout.width,
            layout.height,
            layout.stride,
            layout.nbytes,
            self.writer,
            self.serial,
            self.header.epoch,
            self.header.sequence,
            self.header.time_ns,
            self.header.uncertainty_ns,
            len(clock),
            clock,
            0,
        )
        _CHECK.pack_into(data, _BODY_BYTES, zlib.crc32(data[:_BODY_BYTES]))

    @classmethod
    def unpack(cls, data: bytes | memoryview) -> "FramePrefix":
        """Return the prefix that stands at the beginning of `data`.

        Raises:
            MessageError: it is not one, was damaged, or describes an impossible picture.
        """
        values = _values(data)
        layout = _layout(values[2], values[4], values[5], values[6])
        if values[7] != layout.nbytes:
            raise MessageError(f"Frame.nbytes: {values[7]}, {layout} needs {layout.nbytes}")
        header = _stamp(values[10:14], values[15][: values[14]])
        return cls(header, layout, values[8], values[9])


@lru_cache(maxsize=8)
def _layout(code: int, width: int, height: int, stride: int) -> FrameLayout:
    """Return the checked layout; a camera's does not change from frame to frame."""
    if code >= len(_FORMATS):
        raise MessageError(f"Frame.format: {code} is unknown")
    layout = FrameLayout(_FORMATS[code], width, height, stride)
    layout.check()
    return layout


def _values(data: bytes | memoryview) -> tuple[Any, ...]:
    """Return the fields of the undamaged prefix at the beginning of `data`."""
    if len(data) < PREFIX_BYTES:
        raise MessageError(f"Frame.prefix: {len(data)} bytes, needs {PREFIX_BYTES}")
    values: tuple[Any, ...] = _FIELDS.unpack_from(data)
    if values[0] != MAGIC or values[1] != VERSION:
        raise MessageError(f"Frame.prefix: not a frame of version {VERSION}")
    if values[-1] != zlib.crc32(data[:_BODY_BYTES]):
        raise MessageError("Frame.prefix: damaged, its checksum differs")
    return values


def number(data: bytes) -> tuple[int, int]:
    """Return (writer, serial) of a prefix: all that waking needs, without its other fields.

    Raises:
        MessageError: it is not the prefix of a frame, or damaged.
    """
    values = _values(data)
    return values[8], values[9]


def _stamp(numbers: tuple[int, int, int, int], clock: bytes) -> Stamp:
    epoch, sequence, time_ns, uncertainty_ns = numbers
    try:
        return Stamp(
            epoch=epoch,
            sequence=sequence,
            time_ns=time_ns,
            uncertainty_ns=uncertainty_ns,
            clock=clock.decode("ascii", "replace"),
        )
    except ValueError as error:
        raise MessageError(f"Frame.header.{error}") from error


class SerialGate:
    """Counts the frames of one writer that were replaced before anybody took them."""

    def __init__(self) -> None:
        self._writer: int = -1
        self._serial: int = -1
        self.drops = 0

    def is_taken(self, writer: int, serial: int) -> bool:
        """Return whether this frame, or a newer one of its writer, was taken."""
        return writer == self._writer and serial <= self._serial

    def passed(self, prefix: FramePrefix) -> None:
        """Note that this frame was taken."""
        if prefix.writer == self._writer and prefix.serial > self._serial:
            self.drops += prefix.serial - self._serial - 1
        self._writer, self._serial = prefix.writer, prefix.serial
