"""Packets to pictures that can be trusted: none before a key frame, none from damage."""

from collections import deque
from collections.abc import Iterator
from statistics import median
from typing import Any

from av.codec.context import Flags
from av.error import InvalidDataError
from av.packet import Packet
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from juncnet_services.frame_capture.contract import UNITS_KEPT, AccessUnit, Counts
from juncnet_services.frame_capture.h264 import H264Track

EXACT = ("h264", "hevc")
"""Codecs whose decoder is told to fail on damage instead of inventing pixels."""
GAP = 1.5
"""A time stamp step of more than this many usual steps means lost pictures."""


class TimeSteps:
    """Counts pictures missing between time stamps that usually advance by a constant step."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._steps: deque[int] = deque(maxlen=25)

    def lost_before(self, stamp: int | None) -> int:
        """Return how many steps are missing before `stamp` (any unit, rising); 0 where unknown."""
        if stamp is None:
            return 0
        step = 0 if self._last is None else stamp - self._last
        self._last = stamp
        if step <= 0:
            return 0
        self._steps.append(step)
        usual = median(self._steps)
        return round(step / usual) - 1 if step > GAP * usual else 0


class Decoder:
    """Decodes one video stream, packet by packet.

    Whatever damages the references (a missing frame number, a damaged packet, a failed decode)
    ends the trust: packets are skipped until the next key frame. H.264 access units are kept for
    `take_units`.
    """

    def __init__(
        self, stream: VideoStream, counts: Counts, *, low_delay: bool, decode: bool = True
    ) -> None:
        context = stream.codec_context
        name = context.name.removesuffix("dec")
        context.thread_count = 1
        if name in EXACT:
            context.options = {"err_detect": "explode"}
        if low_delay:
            context.flags |= Flags.low_delay
        self._units: deque[AccessUnit] = deque(maxlen=UNITS_KEPT)
        self._context = context
        self._decode = decode
        self._counts = counts
        self._track = H264Track(context.extradata or b"") if name == "h264" else None
        self._steps = TimeSteps()
        self._trusted = False
        self._arrivals: dict[int | None, int] = {}

    def feed(self, packet: "Packet[Any]", arrived_ns: int) -> Iterator[tuple[VideoFrame, int]]:
        """Yield (frame, arrival of its packet in ns) of what this packet completes.

        An empty packet (the end of the stream) yields what is left.
        """
        if packet.size and not self._admit(packet, arrived_ns):
            return
        if not self._decode:
            return
        self._arrivals[packet.pts] = arrived_ns
        try:
            frames = self._context.decode(packet)  # pyright: ignore[reportUnknownMemberType]  # av: bare Packet
        except InvalidDataError:
            self._counts.corrupt += 1
            self._distrust()
            return
        for frame in frames:
            if frame.is_corrupt:
                self._counts.corrupt += 1
                self._distrust()
                return
            yield frame, self._arrival(frame.pts, arrived_ns)

    def take_units(self) -> list[AccessUnit]:
        """Remove and return the access units fed since the last call, damaged ones included."""
        units = list(self._units)
        self._units.clear()
        return units

    def _admit(self, packet: "Packet[Any]", arrived_ns: int) -> bool:
        """Follow the stream and return whether this packet may be decoded."""
        lost = self._steps.lost_before(packet.dts)
        by_number = None
        if self._track is not None:
            units = self._track.split(bytes(packet))
            by_number = self._track.lost_before(units)
            lost = lost if by_number is None else by_number
            payload = self._track.annex_b(units, packet.is_keyframe)
            if payload:
                self._units.append(AccessUnit(payload, packet.is_keyframe, arrived_ns, lost))
        self._counts.lost += lost
        if packet.is_corrupt:
            self._counts.corrupt += 1
            self._distrust()
            return False
        if by_number:
            self._distrust()
        if not self._trusted and not packet.is_keyframe:
            self._counts.skipped += 1
            return False
        self._trusted = True
        return True

    def _distrust(self) -> None:
        if self._trusted and self._decode:
            self._context.flush_buffers()
        self._trusted = False
        self._arrivals.clear()

    def _arrival(self, stamp: int | None, arrived_ns: int) -> int:
        """Return when the packet of this time stamp arrived, and forget all older ones."""
        arrival = self._arrivals.pop(stamp, arrived_ns)
        if stamp is not None and len(self._arrivals) > UNITS_KEPT:
            self._arrivals.clear()
        return arrival
