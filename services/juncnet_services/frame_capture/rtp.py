"""RTP as a camera sends it: packets out of datagrams, in order, losses counted. Pure.

Source: RFC 3550, 5.1 (header), A.1 (validity of sequence numbers); RFC 4585, 6.3.1 (PLI).
"""

import struct
from dataclasses import dataclass, field

MAX_BEHIND = 64
"""A packet that is further behind than this is not a late one: the sender has begun anew."""
MAX_AHEAD = 1000
"""A packet that is further ahead than this is believed only when the next one follows it."""
WAITING = 16
"""Packets that are held back for a missing one at most; more say that it is lost."""


class RtpError(ValueError):
    """A datagram is not an RTP packet; the text says why."""


@dataclass(frozen=True, slots=True)
class RtpPacket:
    """What of an RTP packet matters: its place, its picture, and its payload."""

    sequence: int
    timestamp: int
    marker: bool
    payload_type: int
    source: int
    payload: bytes


def parse_rtp(datagram: bytes) -> RtpPacket:
    """Return the packet in `datagram`, padding and extensions removed.

    Raises:
        RtpError: it is none.
    """
    if len(datagram) < 12:
        raise RtpError(f"{len(datagram)} bytes are too few for RTP")
    first, second, sequence, timestamp, source = struct.unpack_from(">BBHII", datagram)
    if first >> 6 != 2:
        raise RtpError(f"version {first >> 6} is not RTP's, 2")
    begin, end = 12 + 4 * (first & 0x0F), len(datagram)
    if first & 0x10:
        if begin + 4 > end:
            raise RtpError("the header extension is cut off")
        begin += 4 + 4 * int.from_bytes(datagram[begin + 2 : begin + 4], "big")
    if first & 0x20:
        end -= datagram[-1]
    if begin > end:
        raise RtpError("header and padding are longer than the packet")
    payload = bytes(datagram[begin:end])
    return RtpPacket(sequence, timestamp, second >= 0x80, second & 0x7F, source, payload)


@dataclass
class RtpOrder:
    """Puts the packets of one sender in order; what does not come in time is lost."""

    _expected: int | None = None
    _source: int | None = None
    _waiting: dict[int, RtpPacket] = field(default_factory=dict[int, RtpPacket])
    _suspect: int | None = None

    def push(self, packet: RtpPacket) -> list[tuple[int, RtpPacket]]:
        """Take a packet; return (packets lost before it, packet) of all that are in turn now.

        A sender that has begun anew counts as one lost packet.
        """
        if packet.source != self._source or self._expected is None:
            return self._begin(packet)
        ahead = (packet.sequence - self._expected + 0x8000) % 0x10000 - 0x8000
        if ahead > MAX_AHEAD or ahead < -MAX_BEHIND:
            if packet.sequence == self._suspect:
                return self._begin(packet)
            self._suspect = (packet.sequence + 1) % 0x10000
            return []
        self._suspect = None
        if ahead < 0:
            return []
        self._waiting[packet.sequence] = packet
        lost = 0
        if ahead > 0 and len(self._waiting) > WAITING:
            lost = self._nearest()
            self._expected = (self._expected + lost) % 0x10000
        return self._in_turn(self._expected, lost)

    def _begin(self, packet: RtpPacket) -> list[tuple[int, RtpPacket]]:
        lost = 0 if self._source is None else 1
        self._source, self._suspect = packet.source, None
        self._expected = (packet.sequence + 1) % 0x10000
        self._waiting.clear()
        return [(lost, packet)]

    def _nearest(self) -> int:
        """Return how many packets are missing before the first that waits."""
        expected = self._expected or 0
        return min((sequence - expected) % 0x10000 for sequence in self._waiting)

    def _in_turn(self, expected: int, lost: int) -> list[tuple[int, RtpPacket]]:
        released: list[tuple[int, RtpPacket]] = []
        while (packet := self._waiting.pop(expected, None)) is not None:
            released.append((lost, packet))
            expected, lost = (expected + 1) % 0x10000, 0
        self._expected = expected
        return released


def picture_loss_indication(media_source: int) -> bytes:
    """Return the RTCP packet that asks the sender `media_source` for a key frame."""
    return struct.pack(">BBHII", 0x81, 206, 2, 0, media_source)


def is_picture_loss_indication(datagram: bytes) -> bool:
    """Return whether a datagram is an RTCP packet that asks for a key frame."""
    return len(datagram) >= 12 and datagram[0] == 0x81 and datagram[1] == 206
