"""frame_capture on the other host: camera/video -> camera/frame, whole pictures only."""

from fractions import Fraction
from typing import Any

import av
import numpy as np
import pytest
from av.video.codeccontext import VideoCodecContext

from fakes import FakeBus
from juncnet.messages import Stamp, VideoPacket
from juncnet.topics import CAMERA_FRAME, CAMERA_KEY_FRAME, CAMERA_VIDEO
from juncnet_services.frame_capture.service import Config, run

WIDTH, HEIGHT = 64, 48
REMOTE = Config.model_validate({"source": {"kind": "remote"}, "frozen_limit": 0})


def encoded(count: int, key_every: int) -> list[tuple[bytes, bool]]:
    """Access units of pictures that differ, a key frame among every so many."""
    context = av.CodecContext.create("libx264", "w")
    assert isinstance(context, VideoCodecContext)
    context.width, context.height, context.pix_fmt = WIDTH, HEIGHT, "yuv420p"
    context.framerate, context.time_base = Fraction(25), Fraction(1, 25)
    context.gop_size = key_every
    context.options = {"preset": "ultrafast", "tune": "zerolatency", "forced-idr": "1"}
    units: list[tuple[bytes, bool]] = []
    for number in range(count):
        pixels = np.full((HEIGHT * 3 // 2, WIDTH), 16 + 4 * number, np.uint8)
        frame = av.VideoFrame.from_ndarray(pixels, format="yuv420p")
        frame.pts = number
        packets: list[Any] = context.encode(frame)  # pyright: ignore[reportUnknownMemberType, reportUnknownVariableType]
        units += [(bytes(packet), packet.is_keyframe) for packet in packets]
    assert len(units) == count
    return units


UNITS = encoded(12, 6)


def packet(number: int, epoch: int = 5, lost: int = 0, payload: bytes | None = None) -> VideoPacket:
    header = Stamp(epoch=epoch, sequence=number, time_ns=1000 + number, clock="drone")
    data, key_frame = UNITS[number]
    return VideoPacket.of(payload or data, header=header, key_frame=key_frame, lost_before=lost)


def shown(*packets: VideoPacket) -> tuple[list[int], FakeBus]:
    """The sequences of the pictures that frame_capture shows of these packets."""
    bus = FakeBus([(CAMERA_VIDEO, p) for p in packets], service="frame_capture")
    run(bus, REMOTE)
    return [frame.header.sequence for frame in bus.frames[CAMERA_FRAME.key]], bus


def test_every_picture_is_shown_under_the_vehicles_stamp() -> None:
    sequences, bus = shown(*map(packet, range(12)))
    assert sequences == list(range(12))
    header = bus.frames[CAMERA_FRAME.key][3].header
    assert header == packet(3).header
    luminance = [float(f.luminance().mean()) for f in bus.frames[CAMERA_FRAME.key]]
    assert luminance == pytest.approx([16 + 4 * n for n in range(12)], abs=2)
    assert [p.header.sequence for p in bus.published[CAMERA_VIDEO.key]] == list(range(12))


def test_who_joins_in_the_middle_waits_for_a_key_frame_and_asks_for_it() -> None:
    sequences, bus = shown(*map(packet, range(3, 12)))
    assert sequences == list(range(6, 12))
    assert bus.published[CAMERA_KEY_FRAME.key]
    assert bus.health.counters["skipped"] == 3


@pytest.mark.parametrize("told", [True, False])
def test_after_a_loss_nothing_is_shown_until_the_next_key_frame(told: bool) -> None:
    rest = [packet(n) for n in range(3, 12)]
    if told:  # the packet is not there, and nothing but its sender's word tells of it
        sent = [packet(0), packet(1), packet(2, lost=1), *map(packet, range(3, 12))]
    else:
        sent = [packet(0), packet(1), *rest]
    sequences, bus = shown(*sent)
    assert sequences == [0, 1, *range(6, 12)]
    assert bus.health.counters["lost"] == 1


def test_a_damaged_access_unit_is_not_shown_as_a_whole_picture() -> None:
    data, _ = UNITS[2]
    broken = packet(2, payload=data[: len(data) // 2])
    sequences, bus = shown(packet(0), packet(1), broken, *map(packet, range(3, 12)))
    assert sequences == [0, 1, *range(6, 12)]
    assert bus.health.counters["corrupt"] == 1


def test_a_restarted_sender_is_followed_from_its_key_frame() -> None:
    later = [packet(n, epoch=6) for n in range(6, 9)]
    sequences, _ = shown(packet(0), packet(1), *later)
    assert sequences == [0, 1, 6, 7, 8]


def test_silence_is_reported_with_what_to_check() -> None:
    bus = FakeBus([(CAMERA_VIDEO, packet(0)), *([0.5] * 10)], service="frame_capture")
    run(bus, REMOTE)
    assert any("is the link up" in text for text in bus.health.errors)
