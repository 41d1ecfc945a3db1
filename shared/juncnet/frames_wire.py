"""How a frame lies in memory and on the wire: a fixed prefix, then the pixels, in ONE sample.

Header and pixels travel together, so that no header can meet another picture's pixels. The prefix
alone is what wakes readers and tells observers that there is a new picture.
"""

import struct
import zlib
from functools import lru_cache

from juncnet.frames import FrameLayout
from juncnet.messages import MessageError, PixelFormat, Stamp

MAGIC = b"JNCFRAME"
VERSION = 2
PREFIX_BYTES = 256
"""A multiple of 64: the pixels after it begin on a cache line."""
ENCODING = f"application/octet-stream;juncnet.Frame.v{VERSION}"
PIXELS_KEY = "@pixels"
"""Chunk below a frame topic's key for whole frames; `*` and `**` never match a chunk with `@`, so
nobody asks for raw pixels by watching everything."""

_STEADY = struct.Struct("<8sHBBIIIQQQB128s15x")
"""What a camera repeats in every frame, first, so that readers decode it once."""
_MOVING = struct.Struct("<QQQQ28x")
"""Serial, and of the header sequence, time and its uncertainty in nanoseconds."""
_CHECK = struct.Struct("<I")
"""The CRC-32 of the bytes before it."""
_BODY_BYTES = PREFIX_BYTES - _CHECK.size
_FORMATS: tuple[PixelFormat, ...] = (
    PixelFormat.I420,
    PixelFormat.NV12,
    PixelFormat.BGR8,
    PixelFormat.GRAY8,
)


class PrefixPacker:
    """Makes the prefixes of one writer's frames; `writer` and a serial from 0 on number them."""

    def __init__(self, writer: int) -> None:
        self._writer, self._serial = writer, 0
        self._of: tuple[FrameLayout, int, str] | None = None
        self._steady = b""
        self._crc = 0

    def pack(self, header: Stamp, layout: FrameLayout) -> bytes:
        """Return the next frame's prefix, little-endian, its CRC-32 at the end."""
        if (layout, header.epoch, header.clock) != self._of:
            self._begin(layout, header.epoch, header.clock)
        moving = _MOVING.pack(self._serial, header.sequence, header.time_ns, header.uncertainty_ns)
        self._serial += 1
        return self._steady + moving + _CHECK.pack(zlib.crc32(moving, self._crc))

    def _begin(self, layout: FrameLayout, epoch: int, clock: str) -> None:
        self._of = (layout, epoch, clock)
        name = clock.encode()
        self._steady = _STEADY.pack(
            MAGIC,
            VERSION,
            _FORMATS.index(layout.format),
            0,
            layout.width,
            layout.height,
            layout.stride,
            layout.nbytes,
            self._writer,
            epoch,
            len(name),
            name,
        )
        self._crc = zlib.crc32(self._steady)


def unpack(data: bytes) -> tuple[Stamp, FrameLayout, int, int]:
    """Return header, layout, writer and serial of the prefix at the beginning of `data`.

    Raises:
        MessageError: it is not one, was damaged, or describes an impossible picture.
    """
    (layout, writer, epoch, clock), (serial, sequence, time_ns, uncertainty_ns) = _parts(data)
    try:
        header = Stamp(epoch, sequence, time_ns, clock, uncertainty_ns)
    except ValueError as error:
        raise MessageError(f"Frame.header.{error}") from error
    return header, layout, writer, serial


def number(data: bytes) -> tuple[int, int]:
    """Return (writer, serial) of a prefix: all that waking needs, without its other fields.

    Raises:
        MessageError: it is not the prefix of a frame, or damaged.
    """
    steady, moving = _parts(data)
    return steady[1], moving[0]


_Steady = tuple[FrameLayout, int, int, str]
_Moving = tuple[int, int, int, int]


def _parts(data: bytes) -> tuple[_Steady, _Moving]:
    """Return (layout, writer, epoch, clock) and (serial, sequence, time, its uncertainty)."""
    if len(data) < PREFIX_BYTES:
        raise MessageError(f"Frame.prefix: {len(data)} bytes, needs {PREFIX_BYTES}")
    if zlib.crc32(data[:_BODY_BYTES]) != _CHECK.unpack_from(data, _BODY_BYTES)[0]:
        raise MessageError("Frame.prefix: no frame, or damaged: its checksum differs")
    return _steady(data[: _STEADY.size]), _MOVING.unpack_from(data, _STEADY.size)


@lru_cache(maxsize=8)
def _steady(data: bytes) -> _Steady:
    code: int
    magic, version, code, _, width, height, stride, nbytes, writer, epoch, length, clock = (
        _STEADY.unpack(data)
    )
    if magic != MAGIC or version != VERSION:
        raise MessageError(f"Frame.prefix: not a frame of version {VERSION}")
    if code >= len(_FORMATS):
        raise MessageError(f"Frame.format: {code} is unknown")
    layout = FrameLayout(_FORMATS[code], width, height, stride)
    layout.check()
    if nbytes != layout.nbytes:
        raise MessageError(f"Frame.nbytes: {nbytes}, {layout} needs {layout.nbytes}")
    return layout, writer, epoch, clock[:length].decode("ascii", "replace")


class SerialGate:
    """Counts the frames of one writer that were replaced before anybody took them."""

    def __init__(self) -> None:
        self._writer: int = -1
        self._serial: int = -1
        self.drops = 0

    def is_taken(self, writer: int, serial: int) -> bool:
        """Return whether this frame, or a newer one of its writer, was taken."""
        return writer == self._writer and serial <= self._serial

    def passed(self, writer: int, serial: int) -> None:
        """Note that this frame was taken."""
        if writer == self._writer and serial > self._serial:
            self.drops += serial - self._serial - 1
        self._writer, self._serial = writer, serial
