"""H.264 as far as a forwarder needs it: NAL units, parameter sets, lost pictures.

Source: ITU-T H.264, 7.3.1 (NAL unit), 7.3.2.1 (sequence parameter set), 7.3.3 (slice header),
7.4.3 (frame_num), Annex B (byte stream); ISO/IEC 14496-15 5.3.3 (avcC).
"""

from dataclasses import dataclass, field

START_CODE = b"\x00\x00\x00\x01"
SLICE, IDR, SPS, PPS = 1, 5, 7, 8
HIGH_PROFILES = frozenset({100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135})
HEADER_BYTES = 64
"""Bytes of a NAL unit that are read; SPS and slice headers up to frame_num fit by far, but for
scaling lists of unusual encoders (`_Bits` then raises, and gaps are not counted)."""


class _Bits:
    """Reads bits and Exp-Golomb codes of a NAL unit, emulation prevention removed.

    Raises IndexError at the end of the data.
    """

    def __init__(self, nal: bytes, limit: int = HEADER_BYTES) -> None:
        self.data = nal[1:limit].replace(b"\x00\x00\x03", b"\x00\x00")
        self.position = 0

    def bits(self, count: int) -> int:
        value = 0
        for _ in range(count):
            byte = self.data[self.position >> 3]
            value = value << 1 | byte >> (7 - (self.position & 7)) & 1
            self.position += 1
        return value

    def ue(self) -> int:
        zeros = 0
        while self.bits(1) == 0:
            zeros += 1
        return (1 << zeros) - 1 + self.bits(zeros)

    def skip_ue(self, count: int) -> None:
        for _ in range(count):
            self.ue()

    def se(self) -> int:
        code = self.ue()
        return (code + 1) // 2 if code % 2 else -(code // 2)


@dataclass(frozen=True)
class _Sequence:
    """What of a sequence parameter set tells lost pictures."""

    colour_planes: bool
    frame_num_bits: int
    gaps_allowed: bool


def _parse_sps(nal: bytes) -> _Sequence:
    bits = _Bits(nal, limit=4 * HEADER_BYTES)
    profile = bits.bits(8)
    bits.bits(16)
    bits.ue()
    colour_planes = False
    if profile in HIGH_PROFILES:
        chroma = bits.ue()
        colour_planes = chroma == 3 and bits.bits(1) == 1
        bits.skip_ue(2)
        bits.bits(1)
        if bits.bits(1):
            for index in range(12 if chroma == 3 else 8):
                _skip_scaling_list(bits, 16 if index < 6 else 64)
    frame_num_bits = bits.ue() + 4
    order_type = bits.ue()
    if order_type == 0:
        bits.ue()
    elif order_type == 1:
        bits.bits(1)
        bits.skip_ue(2)
        bits.skip_ue(bits.ue())
    bits.ue()
    return _Sequence(colour_planes, frame_num_bits, gaps_allowed=bits.bits(1) == 1)


def _skip_scaling_list(bits: _Bits, size: int) -> None:
    if not bits.bits(1):
        return
    last = following = 8
    for _ in range(size):
        if following != 0:
            following = (last + bits.se() + 256) % 256
        last = following or last


def nal_type(nal: bytes) -> int:
    """Return nal_unit_type, 0..31."""
    return nal[0] & 0x1F


def split_annex_b(data: bytes) -> list[bytes]:
    """Return the NAL units of a byte stream, without start codes and trailing zeros."""
    parts = (part.rstrip(b"\x00") for part in data.split(b"\x00\x00\x01"))
    return [part for part in parts if part]


def split_avcc(data: bytes, length_size: int) -> list[bytes]:
    """Return the NAL units that follow big-endian lengths of `length_size` bytes."""
    units: list[bytes] = []
    position = 0
    while position + length_size < len(data):
        size = int.from_bytes(data[position : position + length_size], "big")
        position += length_size
        if size:
            units.append(data[position : position + size])
        position += size
    return units


def parse_extradata(extradata: bytes) -> tuple[list[bytes], int]:
    """Return (parameter sets, size of NAL lengths) of a container's header; size 0: Annex B."""
    if len(extradata) < 7 or extradata[0] != 1:
        return split_annex_b(extradata), 0
    sets: list[bytes] = []
    position, count = 6, extradata[5] & 0x1F
    for last in (False, True):
        for _ in range(count):
            size = int.from_bytes(extradata[position : position + 2], "big")
            sets.append(extradata[position + 2 : position + 2 + size])
            position += 2 + size
        if not last and position < len(extradata):
            count = extradata[position]
            position += 1
    return [unit for unit in sets if unit], (extradata[4] & 3) + 1


@dataclass
class H264Track:
    """Follows one H.264 stream: makes Annex B access units and counts lost reference pictures."""

    extradata: bytes = b""
    _sets: list[bytes] = field(default_factory=list[bytes])
    _length_size: int = 0
    _sequence: _Sequence | None = None
    _previous: int | None = None

    def __post_init__(self) -> None:
        self._sets, self._length_size = parse_extradata(self.extradata)
        self._learn(self._sets)

    def split(self, packet: bytes) -> list[bytes]:
        """Return the NAL units of a packet of this stream."""
        if self._length_size:
            return split_avcc(packet, self._length_size)
        return split_annex_b(packet)

    def annex_b(self, units: list[bytes], key_frame: bool) -> bytes:
        """Return the access unit as a byte stream; a key frame carries its parameter sets."""
        own = any(nal_type(unit) == SPS for unit in units)
        before = self._sets if key_frame and not own else []
        return b"".join(START_CODE + unit for unit in (*before, *units))

    def lost_before(self, units: list[bytes]) -> int | None:
        """Return how many reference pictures are missing before this access unit, by frame_num.

        None where frame_num cannot tell: an IDR picture, no parameter set yet, no slice.
        """
        self._learn([unit for unit in units if nal_type(unit) in (SPS, PPS)])
        picture = next((unit for unit in units if nal_type(unit) in (SLICE, IDR)), None)
        if picture is None or self._sequence is None:
            return None
        if nal_type(picture) == IDR:
            self._previous = 0
            return None
        try:
            number = self._frame_num(picture, self._sequence)
        except IndexError:
            return None
        before, self._previous = self._previous, self._after(picture, number)
        if before is None or number == before or self._sequence.gaps_allowed:
            return 0
        return (number - before - 1) % (1 << self._sequence.frame_num_bits)

    def _after(self, picture: bytes, number: int) -> int | None:
        is_reference = picture[0] & 0x60 != 0
        return number if is_reference or self._previous is None else self._previous

    @staticmethod
    def _frame_num(picture: bytes, sequence: _Sequence) -> int:
        bits = _Bits(picture)
        bits.skip_ue(3)
        bits.bits(2 if sequence.colour_planes else 0)
        return bits.bits(sequence.frame_num_bits)

    def _learn(self, sets: list[bytes]) -> None:
        for unit in sets:
            if nal_type(unit) == SPS:
                try:
                    self._sequence = _parse_sps(unit)
                except IndexError:
                    self._sequence = None
