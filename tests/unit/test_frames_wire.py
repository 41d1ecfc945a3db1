"""The prefix of a frame: what it keeps, and what it refuses."""

import dataclasses
import struct
import zlib

import pytest

from juncnet.frames import FrameLayout
from juncnet.frames_wire import PREFIX_BYTES, PrefixPacker, SerialGate, number, unpack
from juncnet.messages import MessageError, PixelFormat, Stamp

STAMP = Stamp(epoch=2**62, sequence=7, time_ns=2**63 - 1, clock="boot-1", uncertainty_ns=40)
LAYOUT = FrameLayout.packed(PixelFormat.I420, 64, 48)


def sealed(prefix: bytes, at: int, value: bytes) -> bytes:
    """Return the prefix with other bytes from `at` on and the checksum that belongs to them."""
    body = prefix[:at] + value + prefix[at + len(value) : -4]
    return body + struct.pack("<I", zlib.crc32(body))


def test_what_changes_from_frame_to_frame_arrives() -> None:
    packer = PrefixPacker(2**64 - 1)
    wide = FrameLayout(PixelFormat.BGR8, 640, 480, 2048)
    frames = [
        (STAMP, LAYOUT),
        (dataclasses.replace(STAMP, sequence=8, time_ns=0, uncertainty_ns=0), LAYOUT),
        (dataclasses.replace(STAMP, epoch=1), LAYOUT),
        (dataclasses.replace(STAMP, clock="c" * 128), LAYOUT),
        (STAMP, wide),
        (STAMP, LAYOUT),
    ]
    for serial, (header, layout) in enumerate(frames):
        prefix = packer.pack(header, layout)
        assert len(prefix) == PREFIX_BYTES
        assert unpack(prefix + b"pixels") == (header, layout, 2**64 - 1, serial)
        assert number(prefix) == (2**64 - 1, serial)


@pytest.mark.parametrize("at", range(PREFIX_BYTES))
def test_any_damaged_byte_is_found(at: int) -> None:
    prefix = bytearray(PrefixPacker(1).pack(STAMP, LAYOUT))
    unpack(bytes(prefix))
    prefix[at] ^= 0x10
    for read in (unpack, number):
        with pytest.raises(MessageError, match="checksum"):
            read(bytes(prefix))


@pytest.mark.parametrize(
    ("at", "value", "named"),
    [
        (0, b"JNCFRAMA", "version"),
        (8, b"\x01\x00", "version"),
        (10, b"\x09", "format"),
        (12, struct.pack("<I", 63), "even"),
        (16, struct.pack("<I", 50), "nbytes"),
        (40, struct.pack("<Q", 2**63), "header.epoch"),
        (49, b"a b", "header.clock"),
        (208, struct.pack("<Q", 2**63), "header.time_ns"),
    ],
)
def test_an_impossible_prefix_names_what_is_wrong(at: int, value: bytes, named: str) -> None:
    prefix = PrefixPacker(1).pack(STAMP, LAYOUT)
    with pytest.raises(MessageError, match=named):
        unpack(sealed(prefix, at, value))


def test_too_short_a_prefix_is_refused() -> None:
    with pytest.raises(MessageError, match="255 bytes"):
        unpack(PrefixPacker(1).pack(STAMP, LAYOUT)[:-1])


def test_frames_that_nobody_took_are_counted_by_writer() -> None:
    gate = SerialGate()
    for writer, serial in ((1, 5), (1, 6), (1, 9), (2, 0), (2, 1)):
        assert not gate.is_taken(writer, serial)
        gate.passed(writer, serial)
    assert gate.drops == 2
    assert gate.is_taken(2, 1)
    assert not gate.is_taken(2, 2)
