"""The vehicle's camera on another host: camera/video, decoded here under the vehicle's stamps."""

from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import replace

import av
from av.codec.context import Flags
from av.error import InvalidDataError
from av.packet import Packet
from av.video.codeccontext import VideoCodecContext
from av.video.frame import VideoFrame

from juncnet.bus import Bus
from juncnet.clocks import NS_PER_S
from juncnet.messages import KeyFrameRequest, Stamp, VideoPacket
from juncnet.topics import CAMERA_KEY_FRAME, CAMERA_VIDEO
from juncnet_services.frame_capture.contract import UNITS_KEPT, AccessUnit, Counts, Picture
from juncnet_services.frame_capture.planes import picture_of

ASK_EVERY_S = 0.5
"""Between requests for a key frame."""
UNDECODED_KEPT = 64
"""Headers of pictures that the decoder still holds."""


class VideoDecoder:
    """Decodes camera/video: no picture before a key frame, none after a loss until the next one."""

    def __init__(self, counts: Counts) -> None:
        context = av.CodecContext.create("h264", "r")
        assert isinstance(context, VideoCodecContext)
        context.thread_count = 1
        context.options = {"err_detect": "explode"}
        context.flags |= Flags.low_delay
        self._context = context
        self._counts = counts
        self._newest: tuple[int, int] | None = None
        self._headers: dict[int, Stamp] = {}
        self._fed = 0
        self.waits_for_key_frame = True
        """Whether nothing can be decoded until one comes."""

    def feed(self, packet: VideoPacket) -> Iterator[tuple[VideoFrame, Stamp]]:
        """Yield (picture, header of its access unit) of what this packet completes."""
        if not self._follows(packet):
            self._distrust()
        if self.waits_for_key_frame and not packet.key_frame:
            self._counts.skipped += 1
            return
        self.waits_for_key_frame = False
        self._fed += 1
        self._headers[self._fed] = packet.header
        unit = Packet(bytes(packet.payload))
        unit.pts = self._fed
        try:
            frames = self._context.decode(unit)  # pyright: ignore[reportUnknownMemberType]  # av: bare Packet
        except InvalidDataError:
            self._counts.corrupt += 1
            self._distrust()
            return
        for frame in frames:
            header = self._headers.pop(frame.pts or 0, None)
            if frame.is_corrupt or header is None:
                self._counts.corrupt += 1
                self._distrust()
                return
            yield frame, header
        if len(self._headers) > UNDECODED_KEPT:
            self._headers.clear()

    def _follows(self, packet: VideoPacket) -> bool:
        """Return whether nothing is missing before this packet, and remember its place."""
        header, newest = packet.header, self._newest
        self._newest = (header.epoch, header.sequence)
        if newest is None or newest[0] != header.epoch:
            return False
        missing = header.sequence - newest[1] - 1 + packet.lost_before
        self._counts.lost += max(missing, 0)
        return missing == 0

    def _distrust(self) -> None:
        if not self.waits_for_key_frame:
            self._context.flush_buffers()
        self.waits_for_key_frame = True
        self._headers.clear()


class RemoteCamera:
    """Decodes all that arrives, gives the newest picture, and asks for a key frame if need be."""

    live = True
    ended = False

    def __init__(self, bus: Bus, stall_s: float) -> None:
        self.counts = Counts()
        self._bus = bus
        self._packets = bus.subscribe(CAMERA_VIDEO, UNITS_KEPT)
        self._decoder = VideoDecoder(self.counts)
        self._units: list[AccessUnit] = []
        self._stall_ns = round(stall_s * NS_PER_S)
        self._heard_ns = self._told_ns = bus.clock.now_ns()
        self._asked_ns: int | None = None

    @contextmanager
    def take(self, timeout_s: float) -> Generator[Picture | None]:
        """Give the newest picture; None after `timeout_s`, or when what came is no whole one."""
        first = self._packets.take(timeout_s)
        newest: Picture | None = None
        for packet in [] if first is None else [first, *(p for _, p in self._packets.drain())]:
            header = packet.header
            unit = AccessUnit(
                bytes(packet.payload), packet.key_frame, header.time_ns, packet.lost_before, header
            )
            self._units.append(unit)
            for frame, stamp in self._decoder.feed(packet):
                self.counts.late += newest is not None
                newest = replace(picture_of(frame, stamp.time_ns), header=stamp)
        self._watch(first is not None)
        yield newest

    def access_units(self) -> list[AccessUnit]:
        """Remove and return the access units that arrived, for listeners on this host."""
        units, self._units = self._units, []
        return units

    def want_key_frame(self) -> None:
        """Ask the vehicle for a key frame."""
        self._bus.publish(CAMERA_KEY_FRAME, KeyFrameRequest(at=self._bus.stamp()))

    def close(self) -> None:
        """Do nothing: the subscription belongs to the bus."""

    def _watch(self, heard: bool) -> None:
        """Ask for a key frame while nothing can be decoded; tell of a silence, once in a while."""
        now_ns = self._bus.clock.now_ns()
        if heard:
            self._heard_ns = now_ns
        asked_ns = self._asked_ns
        if self._decoder.waits_for_key_frame and (
            asked_ns is None or now_ns - asked_ns >= ASK_EVERY_S * NS_PER_S
        ):
            self._asked_ns = now_ns
            self.want_key_frame()
        if now_ns - max(self._heard_ns, self._told_ns) >= self._stall_ns:
            self._told_ns = now_ns
            silence_s = (now_ns - self._heard_ns) / NS_PER_S
            self.counts.problems.append(
                f"no camera/video from the vehicle for {silence_s:.1f} s: does frame_capture run "
                "there, is the link up?"
            )
