"""H.264 access units out of RTP packets, and back: whole ones only. Pure.

Source: RFC 6184, 5.6 (single NAL unit), 5.7.1 (STAP-A), 5.8 (FU-A); packetization modes 0 and 1.
"""

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from juncnet_services.frame_capture.contract import AccessUnit, Counts
from juncnet_services.frame_capture.h264 import IDR, PPS, SLICE, SPS, START_CODE, nal_type
from juncnet_services.frame_capture.rtp import RtpPacket

STAP_A, FU_A = 24, 28
FIRST_UNKNOWN_TYPE = 24
MAX_UNIT_BYTES = 8 << 20
"""No camera's picture is larger; what is, is damaged."""
MAX_PAYLOAD = 1200
"""Bytes of an RTP payload that we send; fits any link."""
PICTURE_KINDS = (SLICE, 2, IDR)
"""Slices, and the first partition of a slice."""


@dataclass
class _Picture:
    """The access unit that is being put together."""

    timestamp: int
    arrived_ns: int
    after_loss: bool
    """Whether its beginning may be missing."""
    whole: bool = True
    nals: list[bytes] = field(default_factory=list[bytes])
    size: int = 0

    @property
    def slices(self) -> list[bytes]:
        return [nal for nal in self.nals if nal_type(nal) in PICTURE_KINDS]


class Depacketiser:
    """Puts H.264 access units together; damaged ones are counted as lost, never given out.

    A key frame is given out with its parameter sets: those before it, if it has none of its own.
    """

    def __init__(self, counts: Counts, parameter_sets: Sequence[bytes] = ()) -> None:
        """`parameter_sets`: those that a session description told beforehand."""
        self._counts = counts
        self._picture: _Picture | None = None
        self._fragments: list[bytes] = []
        self._sets: dict[int, list[bytes]] = {}
        self._lost = 0
        self._learn(list(parameter_sets))

    def push(self, packet: RtpPacket, lost: int, arrived_ns: int) -> list[AccessUnit]:
        """Take the next packet, `lost` ones before it; return the access units that are whole now.

        `arrived_ns` of an access unit is that of its first packet.
        """
        given: list[AccessUnit] = []
        if lost:
            self._lost += lost
            self._counts.lost += lost
            self._damage()
        if self._picture is not None and self._picture.timestamp != packet.timestamp:
            given += self._finish()
        if self._picture is None:
            self._picture = _Picture(packet.timestamp, arrived_ns, after_loss=lost > 0)
        if not self._take(self._picture, packet.payload):
            self._counts.corrupt += 1
            self._damage()
        if packet.marker:
            given += self._finish()
        return given

    def _damage(self) -> None:
        self._fragments.clear()
        if self._picture is not None:
            self._picture.whole = False

    def _take(self, picture: _Picture, payload: bytes) -> bool:
        """Add a payload to `picture`; return whether it is sound."""
        picture.size += len(payload)
        if not payload or picture.size > MAX_UNIT_BYTES:
            return False
        kind = payload[0] & 0x1F
        return self._join(picture, payload) if kind == FU_A else _split(picture, payload, kind)

    def _join(self, picture: _Picture, payload: bytes) -> bool:
        """Take a part of a NAL unit (FU-A)."""
        if len(payload) < 3:
            return False
        indicator, header = payload[0], payload[1]
        begins, ends = header & 0x80, header & 0x40
        if begins:
            if self._fragments or ends:
                return False
            self._fragments.append(bytes([indicator & 0xE0 | header & 0x1F]) + payload[2:])
            return True
        if not self._fragments:
            expected = picture.after_loss or not picture.whole
            picture.whole = False
            return expected
        self._fragments.append(payload[2:])
        if ends:
            picture.nals.append(b"".join(self._fragments))
            self._fragments.clear()
        return True

    def _finish(self) -> list[AccessUnit]:
        """Return the access unit that is complete now, or nothing if it is not whole."""
        picture, self._picture = self._picture, None
        if picture is None:
            return []
        cut_off = bool(self._fragments)
        self._fragments.clear()
        slices = picture.slices
        beheaded = picture.after_loss and slices and not _begins_picture(slices[0])
        if cut_off or beheaded or not picture.whole:
            return self._drop()
        self._learn(picture.nals)
        if not slices:
            return []
        key_frame = any(nal_type(nal) == IDR for nal in picture.nals)
        sets: list[bytes] = []
        if key_frame:
            kinds = {nal_type(nal) for nal in picture.nals}
            lacking = [kind for kind in (SPS, PPS) if kind not in kinds]
            if any(kind not in self._sets for kind in lacking):
                return self._drop()  # its parameter sets have never come
            sets = [nal for kind in lacking for nal in self._sets[kind]]
        payload = b"".join(START_CODE + nal for nal in (*sets, *picture.nals))
        lost, self._lost = self._lost, 0
        return [AccessUnit(payload, key_frame, picture.arrived_ns, lost)]

    def _drop(self) -> list[AccessUnit]:
        """Give nothing, and let the next access unit say that something is missing before it."""
        self._lost = max(self._lost, 1)
        return []

    def _learn(self, nals: list[bytes]) -> None:
        """Keep the newest parameter sets, for key frames that come without."""
        for kind in (SPS, PPS):
            sets = [nal for nal in nals if nal_type(nal) == kind]
            if sets:
                self._sets[kind] = sets


def _split(picture: _Picture, payload: bytes, kind: int) -> bool:
    """Take whole NAL units: a single one, or several in a STAP-A."""
    if 0 < kind < FIRST_UNKNOWN_TYPE:
        picture.nals.append(payload)
        return True
    if kind != STAP_A:
        return False  # interleaved modes, which no camera offers unasked
    position = 1
    while position + 2 <= len(payload):
        size = int.from_bytes(payload[position : position + 2], "big")
        nal = payload[position + 2 : position + 2 + size]
        if size == 0 or len(nal) < size:
            return False
        picture.nals.append(nal)
        position += 2 + size
    return position == len(payload) and position > 1


def _begins_picture(nal: bytes) -> bool:
    """Return whether this is the first slice of its picture.

    A slice's header begins with first_mb_in_slice, Exp-Golomb: 0 is a single bit that is set.
    """
    return len(nal) > 1 and nal[1] & 0x80 != 0


def packetise(nals: list[bytes], sequence: int, timestamp: int, source: int) -> Iterator[bytes]:
    """Yield the RTP datagrams of an access unit, payload type 96, from `sequence` on."""
    payloads = [part for nal in nals for part in _payloads(nal)]
    for index, payload in enumerate(payloads):
        marker = 0x80 if index == len(payloads) - 1 else 0
        place = (sequence + index) % 0x10000
        yield struct.pack(">BBHII", 0x80, marker | 96, place, timestamp, source) + payload


def _payloads(nal: bytes) -> Iterator[bytes]:
    if len(nal) <= MAX_PAYLOAD:
        yield nal
        return
    indicator, kind, step = nal[0] & 0xE0 | FU_A, nal[0] & 0x1F, MAX_PAYLOAD - 2
    for begin in range(1, len(nal), step):
        first, last = begin == 1, begin + step >= len(nal)
        header = kind | (0x80 if first else 0) | (0x40 if last else 0)
        yield bytes([indicator, header]) + nal[begin : begin + step]
