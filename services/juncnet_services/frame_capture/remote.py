"""The vehicle's camera on another host: camera/video, decoded here under the vehicle's stamps."""

from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import replace

from juncnet.bus import Bus
from juncnet.clocks import NS_PER_S
from juncnet.h264_decoder import AccessUnitDecoder
from juncnet.messages import KeyFrameRequest, VideoPacket
from juncnet.topics import CAMERA_KEY_FRAME, CAMERA_VIDEO
from juncnet_services.frame_capture.contract import UNITS_KEPT, AccessUnit, Counts, Picture
from juncnet_services.frame_capture.planes import picture_of

ASK_EVERY_S = 0.5
"""Between requests for a key frame."""


class Order:
    """Tells which access units are missing between those that arrive."""

    def __init__(self) -> None:
        self._newest: tuple[int, int] | None = None

    def missing_before(self, packet: VideoPacket) -> int | None:
        """Return how many are missing before `packet`; None: it is the first of its sender."""
        header, newest = packet.header, self._newest
        self._newest = (header.epoch, header.sequence)
        if newest is None or newest[0] != header.epoch:
            return None
        return header.sequence - newest[1] - 1 + packet.lost_before


class RemoteCamera:
    """Decodes all that arrives, gives the newest picture, and asks for a key frame if need be."""

    live = True
    ended = False

    def __init__(self, bus: Bus, stall_s: float) -> None:
        self.counts = Counts()
        self._bus = bus
        self._packets = bus.subscribe(CAMERA_VIDEO, UNITS_KEPT)
        self._decoder, self._order = AccessUnitDecoder(), Order()
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
            missing = self._order.missing_before(packet)
            self.counts.lost += max(missing or 0, 0)
            for frame, stamp in self._decoder.feed(packet, follows=missing == 0):
                self.counts.late += newest is not None
                newest = replace(picture_of(frame, stamp.time_ns), header=stamp)
        self.counts.skipped, self.counts.corrupt = self._decoder.skipped, self._decoder.corrupt
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
